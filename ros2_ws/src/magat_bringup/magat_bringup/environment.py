# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The network of a team: by default its messages reach only processes of this run on this machine."""

import errno
import os
import socket
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil
from ament_index_python.packages import get_package_share_directory

from magat_node.errors import MagatError

LOOPBACK = "127.0.0.1"
#: Fast DDS's profiles: of nodes, and of the discovery server.
PROFILES = Path(get_package_share_directory("magat_bringup")) / "config" / "fastdds.xml"
#: With more processes than this, a team uses a discovery server: discovery is faster, and beyond the profile's
#: maxInitialPeersRange it is the only way.
MOST_PEERS = 40
#: Every second domain: each has 250 ports, two a process, and a large team runs into those of the next. All are below
#: the ports that systems hand out by themselves.
DOMAINS = range(1, 100, 2)
#: A domain's first port, and those of the domains: RTPS's rule. No process uses the third of the first ten ports.
_FIRST_PORT, _PORTS, _SERVER_PORT = 7400, 250, 2


class NoDomainError(MagatError, RuntimeError):
    """The ROS domain, or every domain on this machine, is in use by another run."""


class NetworkError(MagatError, RuntimeError):
    """The network cannot be used; the message says what is missing."""


@dataclass(frozen=True)
class Network:
    """A ROS domain, and how its processes on this host find the others.

    Without a discovery server they look for each other on this host. With one they are found wherever they reach it.
    """

    domain: int
    #: Name or IPv4 address of the host of the discovery server; there is none if empty.
    server: str = ""

    @property
    def port(self) -> int:
        """UDP port of the discovery server."""
        return _FIRST_PORT + _PORTS * self.domain + _SERVER_PORT

    @property
    def address(self) -> str:
        """IPv4 address of the one interface that processes on this host use: the one that leads to the server.

        Raises:
            NetworkError: none does.
        """
        if not self.server:
            return LOOPBACK
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.connect((self.server, self.port))  # sends nothing
                return probe.getsockname()[0]
        except OSError as error:
            raise NetworkError(
                f"this host has no route to the discovery server {self.server!r} ({error.strerror}): "
                f"give its host's name or IPv4 address"
            ) from error

    @property
    def variables(self) -> dict[str, str]:
        """Environment variables of nodes on this host.

        Raises:
            NetworkError: no interface leads to the server.
        """
        return {
            "ROS_DOMAIN_ID": str(self.domain),
            # The profile names interface and peers; any other range or variable of the shell would override it.
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
            "ROS_LOCALHOST_ONLY": "",
            "ROS_DISCOVERY_SERVER": f"{self.server}:{self.port}" if self.server else "",
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(PROFILES),
            "MAGAT_ADDRESS": self.address,
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        }

    @property
    def tool_variables(self) -> dict[str, str]:
        """As `variables`, for tools that list nodes and topics: other clients of a discovery server see only peers."""
        return self.variables | ({"ROS_SUPER_CLIENT": "TRUE"} if self.server else {})


def loopback(domain: int) -> dict[str, str]:
    """Environment variables for nodes in ``domain`` that communicate only on this machine."""
    return Network(domain).variables


def network_for(domain: int, processes: int, interface: str = "") -> Network:
    """The network of a team; its discovery server, if it needs one, runs on this host.

    Args:
        domain: ROS domain.
        processes: number of processes with a node.
        interface: that the team is opened to, by name or IPv4 address; only the loopback interface if empty.

    Raises:
        NetworkError: this host has no such interface.
    """
    if interface:
        return Network(domain, address_of(interface))
    return Network(domain, LOOPBACK if processes > MOST_PEERS else "")


def address_of(interface: str) -> str:
    """The IPv4 address of an interface of this host that is given by name or by that address.

    Raises:
        NetworkError: there is none.
    """
    own = [
        (name, one.address)
        for name, addresses in psutil.net_if_addrs().items()
        for one in addresses
        if one.family == socket.AF_INET
    ]
    for name, address in own:
        if interface in (name, address):
            return address
    there = ", ".join(f"{name} ({address})" for name, address in own) or "none"
    raise NetworkError(f"this host has no interface {interface!r} with an IPv4 address: it has {there}")


@contextmanager
def own_domain(wanted: int | None = None, namespace: str = "") -> Iterator[int]:
    """A ROS domain that no other run on this machine uses; released at the end of the run.

    Without ``wanted`` it is one in which no other process of this machine has a node, either.

    Args:
        wanted: this domain and no other.
        namespace: of the run's team, see `magat_node.names.team_namespace`. Teams of different namespaces can share
            the domain ``wanted``.

    Raises:
        NoDomainError: this domain, or every domain, is in use.
    """
    if wanted is not None:
        free, name = [wanted], f"{wanted}{namespace}"
    else:
        ports = _bound_ports()
        # The process id spreads runs that start at once.
        first = os.getpid() % len(DOMAINS)
        free, name = [domain for domain in [*DOMAINS[first:], *DOMAINS[:first]] if not occupied(domain, ports)], ""
    for domain in free:
        # An abstract socket is no file: the kernel removes it with its process, and any user may use the name next.
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
            try:
                claim.bind(f"\0magat-domain-{name or domain}")
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
                continue
            yield domain
        return
    if wanted is not None:
        where = f" under the namespace {namespace}" if namespace else ""
        raise NoDomainError(
            f"the ROS domain {wanted} is in use by another run{where}: end that, or give another domain or namespace"
        )
    raise NoDomainError(f"the ROS domains {', '.join(map(str, DOMAINS))} are all in use: end other runs")


def occupied(domain: int, ports: Collection[int] | None = None) -> bool:
    """Whether a process of this machine has a node in ``domain``, by the UDP ``ports`` that are bound."""
    own = range(_FIRST_PORT + _PORTS * domain, _FIRST_PORT + _PORTS * (domain + 1))
    return any(port in own for port in (_bound_ports() if ports is None else ports))


def _bound_ports() -> set[int]:
    """The UDP ports that processes of this machine, of any user, are bound to."""
    return {connection.laddr.port for connection in psutil.net_connections("udp") if connection.laddr}
