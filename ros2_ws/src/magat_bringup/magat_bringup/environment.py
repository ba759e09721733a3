"""Where a team's messages may go: by default to processes of this machine, and of this run, only."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import gettempdir

from ament_index_python.packages import get_package_share_directory

#: Domains that leave room for a hundred processes below the ports that systems hand out by themselves.
DOMAINS = range(1, 102)


class NoDomainError(RuntimeError):
    """Every ROS domain of this machine is in use by another run."""


@contextmanager
def own_domain() -> Iterator[int]:
    """A ROS domain that no other run on this machine has; given back at the end, however the run ends.

    Raises:
        NoDomainError: all are taken.
    """
    # The process's number spreads the runs of users who cannot see each other's locks.
    for offset in range(len(DOMAINS)):
        domain = DOMAINS[(os.getpid() + offset) % len(DOMAINS)]
        try:
            lock = os.open(Path(gettempdir()) / f"magat-domain-{domain}.lock", os.O_CREAT | os.O_RDWR, 0o666)
        except PermissionError:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            continue
        try:
            yield domain
        finally:
            os.close(lock)
        return
    raise NoDomainError(f"the ROS domains {DOMAINS.start} to {DOMAINS.stop - 1} are all in use: end other runs")


def loopback(domain: int) -> dict[str, str]:
    """Environment variables for nodes that speak to processes of this machine only, in ``domain``."""
    profile = Path(get_package_share_directory("magat_bringup")) / "config" / "fastdds_loopback.xml"
    return {
        "ROS_DOMAIN_ID": str(domain),
        # The profile names the interface and the peers itself; any other range would override it.
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    }
