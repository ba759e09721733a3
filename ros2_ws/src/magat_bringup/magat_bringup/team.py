# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The processes of a team and their arguments: the same for ``magat run`` and for the launch file.

Free of ROS and of launch.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import yaml

from magat_node.errors import MagatError
from magat_node.names import InvalidNameError, check_robot_name

#: Environment variables of every process. A robot computes little: threads would only wait for each other.
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}


class TeamFileError(MagatError, RuntimeError):
    """A team, or a file that describes one, cannot be used; the message says why."""


@dataclass(frozen=True)
class TeamFile:
    """The robots of a team, and how they share processes.

    Raises:
        TeamFileError: no robots, an invalid name, a name that occurs twice, or a crew of less than one.
    """

    #: Names, which are the robots' namespaces in the team's, in the simulator's order.
    robots: tuple[str, ...]
    #: Robots in each process; the last may have fewer.
    crew: int = 1

    def __post_init__(self) -> None:
        """Check what is given, whatever its types."""
        if not self.robots:
            raise TeamFileError("the team has no robots: name at least one")
        for name in self.robots:
            try:
                check_robot_name(name)
            except InvalidNameError as error:
                raise TeamFileError(str(error)) from error
        twice = sorted({name for name in self.robots if self.robots.count(name) > 1})
        if twice:
            raise TeamFileError(f"{', '.join(twice)}: named more than once: give each robot its own name")
        if not isinstance(self.crew, int) or isinstance(self.crew, bool) or self.crew < 1:
            raise TeamFileError(f"the crew is {self.crew!r}: give a number of robots for each process, at least 1")

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a YAML file with the keys ``robots`` (a list of names) and ``crew`` (a number; may be left out).

        Raises:
            TeamFileError: there is no such file, or it does not describe a team.
        """
        content = _read_yaml(path, "team file")
        try:
            if not isinstance(content, dict) or not isinstance(content.get("robots"), list):
                raise TeamFileError("it has no list of names under the key robots, such as robots: [alice, bob]")
            unknown = sorted(str(key) for key in content.keys() - {"robots", "crew"})
            if unknown:
                raise TeamFileError(f"it has the unknown keys {', '.join(unknown)}: there are robots and crew")
            return cls(tuple(content["robots"]), content.get("crew", 1))
        except TeamFileError as error:
            raise TeamFileError(f"the team file {path} cannot be used: {error}") from error

    @classmethod
    def numbered(cls, robots: int, crew: int = 1) -> Self:
        """A team of ``robots`` that are called robot_0, robot_1 and so on, with as many digits as the last one has."""
        digits = len(str(robots - 1))
        return cls(tuple(f"robot_{index:0{digits}d}" for index in range(robots)), crew)

    @property
    def processes(self) -> int:
        """In how many processes the robots run."""
        return -(-len(self.robots) // self.crew)


@dataclass(frozen=True)
class Command:
    """How one process is started."""

    #: Of the process and its log.
    name: str
    #: For `ros2 run` and launch files.
    package: str
    executable: str
    #: For `python -m`: the same program.
    module: str
    arguments: tuple[str, ...] = ()
    #: What follows `--ros-args`.
    ros_arguments: tuple[str, ...] = ()
    #: Whether the team can continue after it is restarted.
    again: bool = True
    #: Whether it only watches the team, which goes on without it.
    observer: bool = False
    #: Of the team, see `magat_node.names.team_namespace`.
    namespace: str = ""

    @property
    def python(self) -> list[str]:
        """What follows ``python -m``."""
        placed = ["-r", f"__ns:={self.namespace}"] if self.namespace else []
        return [self.module, *self.arguments, "--ros-args", *self.ros_arguments, *placed]


@dataclass(frozen=True)
class TeamPlan:
    """The processes of a team and their arguments."""

    team: TeamFile
    #: Folder of the policy that each robot carries.
    policy: Path
    #: direct: robots hear each other; relayed: through the simulator.
    radio: str = "direct"
    #: Share of the radio links that are lost in each tick, 0 to 1.
    link_loss: float = 0.0
    #: What keeps robots from colliding: idle or pibt.
    shield: str = "idle"
    #: Of messages; that of the policy's configuration if empty.
    encoding: str = ""
    #: What computes the policy, see `magat_robot.policy.backends`.
    backend: str = "onnx"
    #: ROS parameter file for every process. As usual in ROS, its node-specific entries (``/**/robot``) override the
    #: arguments given here; its ``/**`` entries do not.
    params: Path | None = None
    #: How long an episode waits for missing robots, seconds; see `patience` if None.
    ready_timeout: float | None = None
    #: Whether the bridge to RViz and Foxglove is started.
    rviz: bool = False
    #: TCP port of the page that shows the team to browsers of this machine; no page if None.
    view: int | None = None
    #: Whether processes that a signal has killed are restarted.
    respawn: bool = True
    #: Whether the robots are started here; if not, they are started separately, on this host or on others.
    robots: bool = True
    #: Whether there is a discovery server, at the address in the environment variable ROS_DISCOVERY_SERVER.
    server: bool = False
    #: Folder of the bag that a recorder writes; no recorder if None.
    record: Path | None = None
    #: Of all nodes of the team, see `magat_node.names.team_namespace`; the root if empty.
    namespace: str = ""

    @property
    def nodes(self) -> int:
        """Number of processes with a ROS node on all hosts, the client that requests episodes included."""
        return self.team.processes + 3 + self.rviz + (self.view is not None) + (self.record is not None)

    @property
    def patience(self) -> float:
        """How long an episode waits for missing robots, seconds; it grows with the number of processes."""
        return max(60.0, 2.0 * self.team.processes) if self.ready_timeout is None else self.ready_timeout

    def check(self) -> None:
        """Check the values, whatever they are taken from.

        Raises:
            TeamFileError: one is out of range, or the parameter file cannot be used.
        """
        if not 0.0 <= self.link_loss <= 1.0:  # NaN is not
            raise TeamFileError(f"the link loss is {self.link_loss:g}: give a share of the links, 0 to 1")
        if self.view is not None and not 0 < self.view < 2**16:
            raise TeamFileError(f"the port of the page is {self.view}: give a TCP port, 1 to {2**16 - 1}")
        if self.params is not None:
            _check_parameters(self.params, _read_yaml(self.params, "parameter file"))

    def command(self, name: str) -> Command:
        """How the process ``name`` is started; see `commands`."""
        return next(command for command in self.commands() if command.name == name)

    def commands(self) -> list[Command]:
        """The commands, in the order in which they are started.

        Raises:
            TeamFileError: there is no file ``params``.
        """
        if self.params is not None and not self.params.is_file():
            raise TeamFileError(f"there is no parameter file {self.params}")
        shared = ("--params-file", str(self.params.resolve())) if self.params is not None else ()
        sized = ("-p", f"team_size:={len(self.team.robots)}")
        heard = ("-p", f"radio:={self.radio}")
        carried = ("--policy", str(self.policy), "--backend", self.backend, "--shield", self.shield)
        encoded = ("--encoding", self.encoding) if self.encoding else ()
        carried_by = ("--crew", str(self.team.crew), *(("--respawn",) if self.respawn else ()), *self.team.robots)
        roster = ("-p", f"robots:=[{','.join(self.team.robots)}]")
        physics = ("-p", f"link_loss:={self.link_loss:f}", "-p", f"shield:={self.shield}")
        patience = ("-p", f"ready_timeout:={self.patience:f}")
        server = Command(
            name="discovery",
            package="magat_bringup",
            executable="discovery_server",
            module="magat_bringup.discovery",
            again=False,  # a new server would not know the participants of this one
        )
        robots = Command(
            name="robots",
            package="magat_robot",
            executable="robots",
            module="magat_robot.forked",
            arguments=(*carried, *encoded, *carried_by),
            ros_arguments=(*shared, *sized, *heard),
        )
        started = [
            *([server] if self.server else []),
            *([robots] if self.robots else []),
            Command(
                name="simulator",
                package="magat_sim",
                executable="simulator",
                module="magat_sim.node",
                ros_arguments=(*shared, *roster, *heard, *physics, *patience),
            ),
            Command(
                name="expert",
                package="magat_expert",
                executable="expert",
                module="magat_expert.node",
                ros_arguments=shared,
            ),
        ]
        if self.record is not None:
            # First, so that it misses no message.
            bag = ("-p", f"bag:={self.record.resolve()}")
            recorder = Command(
                name="recorder",
                package="magat_recording",
                executable="recorder",
                module="magat_recording.recorder",
                observer=True,
                ros_arguments=(*shared, *bag, *roster, *heard),
            )
            started.insert(0, recorder)
        if self.rviz:
            started.append(
                Command(
                    name="rviz_bridge",
                    package="magat_viewer",
                    executable="rviz_bridge",
                    module="magat_viewer.rviz.node",
                    observer=True,
                    ros_arguments=(*shared, *sized),
                )
            )
        if self.view is not None:
            started.append(
                Command(
                    name="viewer",
                    package="magat_viewer",
                    executable="viewer",
                    module="magat_viewer.main",
                    observer=True,
                    ros_arguments=(*shared, "-p", f"port:={self.view}"),
                )
            )
        return [replace(command, namespace=self.namespace) for command in started]


def _read_yaml(path: Path, what: str) -> Any:
    """The content of a YAML file; an error is one line."""
    try:
        return yaml.safe_load(path.read_text())
    except OSError as error:
        why = error.strerror or str(error)
    except UnicodeDecodeError:
        why = "it is not text"
    except yaml.MarkedYAMLError as error:
        place = f"line {error.problem_mark.line + 1}: " if error.problem_mark is not None else ""
        why = f"{place}{error.problem}"
    except yaml.YAMLError as error:
        why = " ".join(str(error).split())
    raise TeamFileError(f"the {what} {path} cannot be read: {why}")


def _check_parameters(path: Path, content: Any, node: str = "") -> None:
    """Check that a parameter file has the form that ROS expects: nodes, then ``ros__parameters``, then values."""
    if not isinstance(content, dict) or not content:
        what = f"under {node} there is" if node else "it holds"
        raise TeamFileError(
            f"the parameter file {path} cannot be used: {what} {content!r}, not the names of nodes with ros__parameters"
        )
    for name, below in content.items():
        if name != "ros__parameters":
            _check_parameters(path, below, f"{node}/{name}".replace("//", "/") if node else str(name))
        elif not node or not isinstance(below, dict):
            raise TeamFileError(
                f"the parameter file {path} cannot be used: ros__parameters of {node or 'no node'} is {below!r}, not "
                "names with values under the name of a node"
            )


class PagePlan(TeamPlan):
    """The page without its team."""

    def commands(self) -> list[Command]:
        """Of `TeamPlan.commands` the page's."""
        return [command for command in super().commands() if command.name == "viewer"]
