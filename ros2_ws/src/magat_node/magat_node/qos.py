"""Quality of service of the team's topics; docs/protocol.md is the same table in words."""

from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy


def newest(depth: int) -> QoSProfile:
    """Best effort, for the tick's own messages: one that is lost is worthless by the time it could be sent again."""
    return QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def reliable(depth: int) -> QoSProfile:
    """Lost messages are sent again, for what people and tools watch."""
    return QoSProfile(depth=depth, reliability=QoSReliabilityPolicy.RELIABLE)


def latched(depth: int) -> QoSProfile:
    """Reliable, and whoever comes late is given the last messages."""
    return QoSProfile(
        depth=depth, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL
    )


def shared_depth(robots: int) -> int:
    """Queue depth of a topic on which a team of ``robots`` speaks at once: some ticks, and room for strangers."""
    return 4 * robots + 64
