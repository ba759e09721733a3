# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The process ``viewer`` of a team, which serves its page."""

import sys

from magat_node.imports import quiet_imports

with quiet_imports():
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from rich.console import Console

    from magat_node import interruption
    from magat_node.parameters import declare_value
    from magat_node.run import give_way
    from magat_robot.policy.models import policy_of_digest
    from magat_viewer.address import HOST, PORT, ServerError
    from magat_viewer.node import LiveTeam
    from magat_viewer.serve import wait
    from magat_viewer.server import PageServer


def main(args: list[str] | None = None) -> int:
    """Show the team of this namespace until interrupted. Returns the exit status."""
    give_way()
    interruption.watch()
    with interruption.deferred():
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        team = LiveTeam(rclpy.get_default_context(), policy_of_digest)
        try:
            host = declare_value(team.node, "host", HOST, "name or address to listen on")
            port = declare_value(team.node, "port", 0, f"TCP port to listen on; 0 is the first free one from {PORT} on")
            with PageServer(team, host, port or None) as page:
                team.node.get_logger().info(f"the page is at {page.url}")
                wait(page, Console(quiet=True))
        except KeyboardInterrupt:
            return 0
        except ServerError as error:
            team.node.get_logger().fatal(str(error))
            return 1
        finally:
            team.destroy()
            rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
