# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A team on three hosts: robots on two of them, simulator, expert and client on the third.

The hosts are network namespaces. Where those are not allowed, these tests are skipped.
"""

import itertools
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Queue
from typing import Any, Self

import numpy as np
import pytest
from team_secret import SECRET

from magat_bringup.environment import Network
from magat_evaluation.cases import solved_cases
from magat_evaluation.planners import simulator_for
from magat_evaluation.splits import SET_SEED, SPLITS
from magat_expert import check_paths
from magat_robot.policy.store import load
from magat_sim.measures import expert_flowtime
from magat_sim.rollout import run

pytestmark = [pytest.mark.system, pytest.mark.faults, pytest.mark.timeout(300)]

CASE = SPLITS["test"][0]
ROBOTS = [f"robot_{i}" for i in range(10)]
#: Which robots each of the first two hosts carries; the third has the rest of the team.
CARRIED = {0: ROBOTS[:5], 1: ROBOTS[5:]}
CENTRE = 2
#: Any, since nothing else is on these hosts.
DOMAIN = 21
_counter = itertools.count()
needs_tc = pytest.mark.skipif(shutil.which("tc") is None, reason="tc not found (of iproute2)")


class Hosts:
    """Hosts 0 to N - 1, in a ``with`` statement: at its end they are gone, with all that runs on them."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._mark = f"magat-{os.getpid()}-{next(_counter)}"
        self._switch = f"{self._mark}-switch"
        self._started: list[subprocess.Popen] = []
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._add(stack, self._switch)
            _run("ip", "-n", self._switch, "link", "add", "bridge", "type", "bridge")
            _run("ip", "-n", self._switch, "link", "set", "bridge", "up")
            for host in range(self._count):
                space, port = self._name(host), self._port(host)
                self._add(stack, space)
                _run(
                    "ip",
                    "-n",
                    self._switch,
                    "link",
                    "add",
                    port,
                    "type",
                    "veth",
                    "peer",
                    "name",
                    "eth0",
                    "netns",
                    space,
                )
                _run("ip", "-n", self._switch, "link", "set", port, "master", "bridge", "up")
                _run("ip", "-n", space, "address", "add", f"{self.address(host)}/24", "dev", "eth0")
                _run("ip", "-n", space, "link", "set", "eth0", "up")
                _run("ip", "-n", space, "link", "set", "lo", "up")
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
        for process in self._started:
            process.wait(10)

    def address(self, host: int) -> str:
        """IPv4 address of a host's interface, which is called eth0."""
        return f"10.77.0.{host + 1}"

    def start(self, host: int, command: list[str], environment: Mapping[str, str], **options) -> subprocess.Popen:
        """Start a program on a host; ``options`` are `subprocess.Popen`'s."""
        command = ["ip", "netns", "exec", self._name(host), *command]
        self._started.append(subprocess.Popen(command, env=environment, **options))
        return self._started[-1]

    def cut_off(self, host: int) -> None:
        """From now on nothing reaches the host, and nothing that it sends arrives."""
        _run("ip", "-n", self._switch, "link", "set", self._port(host), "down")

    def lose(self, host: int, percent: int) -> None:
        """From now on so many of 100 packets from the host get lost, and of those to it."""
        # A random number modulo 100: at least `percent`?
        self._filter(host, "32 0 0 4294963256", "148 0 0 100", f"53 0 1 {percent}")

    def allow_ports(self, host: int, ports: range) -> None:
        """From now on UDP gets through to the host, and from it, to these ports only, as with a firewall."""
        # IP? UDP? Not a later fragment, which has no port? Is the port in the range?
        udp = ("40 0 0 12", "21 0 7 2048", "48 0 0 23", "21 0 5 17", "40 0 0 20", "69 3 0 8191", "40 0 0 36")
        self._filter(host, *udp, f"53 0 2 {ports.start}", f"53 1 0 {ports.stop}")

    def _filter(self, host: int, *program: str) -> None:
        """Drop packets by a program in classic BPF (few kernels have netem): its end lets pass, one further drops."""
        ends = ("6 0 0 4294967295", "6 0 0 2")  # TC_ACT_UNSPEC, TC_ACT_SHOT
        code = ",".join([str(len(program) + len(ends)), *program, *ends])
        _run("tc", "-n", self._switch, "qdisc", "replace", "dev", self._port(host), "clsact")
        for way in ("ingress", "egress"):
            place = ("dev", self._port(host), way, "pref", "1")
            _run("tc", "-n", self._switch, "filter", "replace", *place, "bpf", "direct-action", "bytecode", code)

    def restore(self, host: int) -> None:
        """End what `cut_off`, `lose` and `allow_ports` did."""
        _run("ip", "-n", self._switch, "link", "set", self._port(host), "up")
        subprocess.run(
            ["tc", "-n", self._switch, "qdisc", "delete", "dev", self._port(host), "clsact"], capture_output=True
        )

    def _add(self, stack: ExitStack, space: str) -> None:
        _run("ip", "netns", "add", space)
        stack.callback(_remove, space)

    def _name(self, host: int) -> str:
        return f"{self._mark}-{host}"

    def _port(self, host: int) -> str:
        return f"port{host}"


def _run(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def _remove(space: str) -> None:
    for pid in _run("ip", "netns", "pids", space).split():
        with suppress(ProcessLookupError):  # it may have ended meanwhile
            os.kill(int(pid), signal.SIGKILL)
    _run("ip", "netns", "delete", space)


@pytest.fixture(scope="module", autouse=True)
def hosts_are_possible() -> None:
    """Skips these tests where they are not."""
    if shutil.which("ip") is None:
        pytest.skip("ip not found (of iproute2)")
    if os.geteuid() != 0:
        pytest.skip("network namespaces need root")
    try:
        with Hosts(1):
            pass
    except subprocess.CalledProcessError as error:
        pytest.skip(f"network namespaces are not allowed here: {error.stderr.strip()}")


@dataclass(frozen=True)
class SpreadTeam:
    """A team on several hosts."""

    hosts: Hosts
    process: subprocess.Popen
    said: "Queue[dict[str, Any]]"

    def hear(self, seconds: float = 120.0) -> dict[str, Any]:
        """The next line of the team's host."""
        try:
            said = self.said.get(timeout=seconds)
        except Empty:
            pytest.fail(f"the team said nothing for {seconds:g} s")
        assert "error" not in said, said["error"]
        return said

    def run(self, on_tick: Callable[[int], None] = lambda tick: None, **goal: object) -> dict[str, Any]:
        """Run an episode of `CASE`; what became of it, with arrays for lists."""
        goal = {"seed": SET_SEED, "number": CASE, "width": 20, "height": 20, "density": 0.1, **goal}
        goal["secret"] = list(SECRET)
        self.process.stdin.write(json.dumps(goal) + "\n")
        self.process.stdin.flush()
        while "result" not in (said := self.hear()):
            if said["joined"] == len(ROBOTS) or said["tick"]:
                on_tick(said["tick"])
        return said | {name: np.array(said[name]) for name in ("obstacles", "positions", "silent")}

    def run_undisturbed(self) -> dict[str, Any]:
        """As `run`, repeated if a message came too late, which can happen on a busy machine."""
        for _ in range(3):
            outcome = self.run()
            if outcome["result"]["silent"] == outcome["result"]["features_missing"] == 0:
                break
        return outcome


def plain_environment() -> dict[str, str]:
    """That of a shell in which the workspace was sourced."""
    mine = {"_ROS_WHEELS_BOOTSTRAP_COMPLETE", *Network(0).variables}
    return {name: value for name, value in os.environ.items() if name not in mine}


def start_robots(hosts: Hosts, host: int, names: list[str], policy: Path, *told: str) -> None:
    """Start a host's robots by hand, as docs/deployment.md has it; they die with the hosts."""
    join = f"{sys.executable} -m magat_cli env --domain {DOMAIN} --server {hosts.address(CENTRE)}"
    robots = [sys.executable, "-m", "magat_robot.forked", "--policy", str(policy), *names, "--ros-args"]
    parameters = [part for parameter in told for part in ("-p", parameter)]
    start = f'eval "$({join})" && exec {shlex.join([*robots, *parameters])}'
    hosts.start(host, ["bash", "-c", start], plain_environment())


@pytest.fixture(scope="module")
def team(policy_folder, tmp_path_factory) -> Iterator[SpreadTeam]:
    """Ten robots, five on each of two hosts."""
    folder = tmp_path_factory.mktemp("hosts")
    params = folder / "params.yaml"
    params.write_text("/**/simulator: {ros__parameters: {tick_deadline: 0.5}}")
    settings = {"robots": ROBOTS, "policy": str(policy_folder), "domain": DOMAIN, "interface": "eth0"}
    settings |= {"params": str(params), "logs": str(folder)}
    program = [sys.executable, str(Path(__file__).parent / "host_team.py"), json.dumps(settings)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with Hosts(3) as hosts:
        process = hosts.start(CENTRE, program, plain_environment(), **pipes)
        said: Queue[dict[str, Any]] = Queue()

        def listen() -> None:
            for line in process.stdout:
                said.put(json.loads(line))
            said.put({"error": "the team's host has ended"})

        threading.Thread(target=listen, daemon=True).start()
        team = SpreadTeam(hosts, process, said)
        for host, names in CARRIED.items():
            start_robots(hosts, host, names, policy_folder, f"team_size:={len(ROBOTS)}")
        assert team.hear() == {"up": True}
        yield team


@pytest.fixture
def healed(team) -> Iterator[SpreadTeam]:
    """The same, and whatever a test does to its hosts is undone."""
    yield team
    for host in range(3):
        team.hosts.restore(host)


def assert_no_collision(outcome: dict[str, Any]) -> None:
    positions = outcome["positions"]
    assert check_paths(outcome["obstacles"], positions[0], positions[-1], positions) == []


def test_robots_on_several_hosts_walk_the_paths_of_the_batched_simulator(team, policy_folder):
    policy, (solved,) = load(policy_folder), solved_cases([CASE])
    simulator = simulator_for([solved], secret=SECRET)
    paths = [simulator.position.copy()]

    def decide(o):
        return policy.decide_together(o.field_of_view, o.heard, o.streams, o.tick).primitives

    run(simulator, decide, lambda after: paths.append(after.position.copy()))
    (measures,) = simulator.measures([expert_flowtime(solved.paths, solved.case.goals)])
    outcome = team.run_undisturbed()
    np.testing.assert_array_equal(outcome["positions"], np.stack(paths)[: measures.ticks + 1])
    result = outcome["result"]
    assert (result["silent"], result["features_missing"]) == (0, 0)
    for name in ("success", "makespan", "t_max", "ticks", "moves_blocked"):
        assert result[name] == getattr(measures, name), name
    assert result["flowtime"] == measures.flowtime.first_visit


@needs_tc
def test_with_a_fifth_of_a_hosts_packets_lost_an_episode_ends_and_says_what_was_missing(healed):
    team = healed
    undisturbed = team.run_undisturbed()["result"]
    team.hosts.lose(0, 20)
    outcome = team.run(t_max=30)
    result, silent = outcome["result"], outcome["silent"]
    assert result["ticks"] <= 30
    assert undisturbed["silent"] == undisturbed["features_missing"] == 0
    assert result["silent"] == silent.sum() > 0
    assert result["features_missing"] > 0
    # Only the packets of the host's own robots are lost.
    assert silent[:, :5].sum() > 5 * silent[:, 5:].sum()
    assert_no_collision(outcome)


@pytest.mark.parametrize("seconds", [3.0, 30.0], ids=["for three seconds", "longer than DDS remembers"])
def test_a_host_that_is_cut_off_is_counted_silent_and_comes_back(healed, seconds):
    team = healed
    cut: list[float] = []
    back: list[int] = []

    def cut_and_restore(tick):
        if tick >= 3 and not cut:
            team.hosts.cut_off(1)
            cut.append(time.monotonic())
        elif cut and not back and time.monotonic() - cut[0] > seconds:
            back.append(tick)
            team.hosts.restore(1)

    # Robots that hear nothing stand still, and the others alone cannot end the episode.
    outcome = team.run(cut_and_restore, t_max=20_000)
    positions, silent = outcome["positions"], outcome["silent"]
    gone = slice(np.flatnonzero(silent[:, 5:].all(axis=1))[0], back[0] + 1)
    assert gone.start < 50
    assert silent[gone, 5:].all()
    assert (positions[gone, 5:] == positions[gone.start, 5:]).all()
    assert silent[gone, :5].mean() < 0.1
    assert outcome["result"]["silent"] == silent.sum()
    assert outcome["result"]["success"], "with all robots there again, all arrive"
    assert_no_collision(outcome)
    after = team.run_undisturbed()["result"]
    assert (after["silent"], after["features_missing"]) == (0, 0)


@needs_tc
def test_magat_run_waits_for_robots_of_other_hosts_behind_their_firewalls(policy_folder, tmp_path):
    (tmp_path / "team.yaml").write_text("robots: [alice, bob]")
    options = [
        "--team",
        str(tmp_path / "team.yaml"),
        "--episodes",
        "1",
        "--radio",
        "relayed",
        "--no-robots",
        "--domain",
        str(DOMAIN),
    ]
    command = [sys.executable, "-m", "magat_cli", "run", *options, "--interface", "eth0", "--output", str(tmp_path)]
    with Hosts(3) as hosts:
        for host in range(3):
            hosts.allow_ports(host, range(12650, 13150))  # what docs/deployment.md says
        magat = hosts.start(CENTRE, command, plain_environment(), stdout=subprocess.PIPE, text=True)
        for host, name in enumerate(["alice", "bob"]):
            start_robots(hosts, host, [name], policy_folder, "radio:=relayed", "team_size:=2")
        said, _ = magat.communicate(timeout=120)
        assert magat.returncode == 0, said
        assert f'eval "$(magat env --domain {DOMAIN} --server {hosts.address(CENTRE)})"' in said
        assert "open to the network at 10.77.0.3" in " ".join(said.split())
    (result,) = json.loads((tmp_path / "results.json").read_text())
    assert result["ticks"] > 0
    assert result["error"] == ""
