"""The policy that the robots of a process carry, and another one on its way to them. Free of ROS."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

from magat_robot.policy.backends import load_policy
from magat_robot.policy.config import ModelError, PolicyConfig
from magat_robot.policy.folder import write_files
from magat_robot.policy.interface import RobotPolicy
from magat_robot.policy.payload import encoded_bytes


def longest_payload(config: PolicyConfig, encoding: str) -> int:
    """Bytes of the longest payload that a robot with this policy sends."""
    return max(encoded_bytes(size, encoding) for size in config.message_sizes)


class PolicySlot:
    """A process's policy, which deployments replace: each is prepared, then switched to, and may be rolled back.

    Every deployment has a number. Doing again what is done changes nothing.
    """

    def __init__(self, policy: RobotPolicy, backend: str, max_payload: int = 0) -> None:
        """Carry ``policy``.

        Args:
            policy: that the process was started with. Its encoding stays, whatever is deployed: it is the team's.
            backend: one of `magat_robot.policy.backends.BACKENDS`.
            max_payload: bytes, the longest payload that a policy may send; as long as that of ``policy`` if 0.

        Raises:
            ModelError: ``policy`` sends longer ones.
        """
        longest = longest_payload(policy.config, policy.config.encoding)
        self.policy = policy
        self.max_payload = max_payload or longest
        #: Number of the deployment that `policy` came by; 0 for the first one.
        self.deployment = 0
        #: Number of the last deployment that was prepared, or refused, and why it was; empty if it was not.
        self.prepared, self.refusal = 0, ""
        self._backend = backend
        self._before: tuple[int, RobotPolicy] | None = None
        self._next: RobotPolicy | None = None
        self._check(policy.config)

    def prepare(self, number: int, digest: str, files: Mapping[str, bytes]) -> None:
        """Load the policy of deployment ``number``, or refuse it.

        Args:
            number: not 0.
            digest: SHA-256 that its weights must have, hexadecimal.
            files: of its folder, as `magat_robot.policy.folder.read_files` reads them.
        """
        if number in (self.deployment, self.prepared):
            return
        self.prepared, self.refusal, self._next = number, "", None
        try:
            self._next = self._load(digest, files)
        except (ModelError, OSError) as error:  # or there is no room for its files
            self.refusal = str(error)

    def switch(self, number: int) -> bool:
        """Carry the policy of deployment ``number``, if it was prepared; True if that is a change."""
        if number != self.prepared or self._next is None:
            return False
        self._before = self.deployment, self.policy
        self.deployment, self.policy, self._next = number, self._next, None
        return True

    def roll_back(self, number: int) -> bool:
        """Carry what was carried before deployment ``number``, and forget that; True if that is a change."""
        if number == self.prepared:
            self.prepared, self.refusal, self._next = 0, "", None
        if number != self.deployment or self._before is None:
            return False
        (self.deployment, self.policy), self._before = self._before, None
        return True

    def _load(self, digest: str, files: Mapping[str, bytes]) -> RobotPolicy:
        with tempfile.TemporaryDirectory(prefix="magat_policy_") as name:
            folder = Path(name)
            write_files(files, folder)
            policy = load_policy(folder, self._backend, encoding=self.policy.config.encoding)
        if policy.digest != digest:
            raise ModelError(f"the weights have the SHA-256 {policy.digest}, not {digest} as announced")
        self._check(policy.config)
        return policy

    def _check(self, config: PolicyConfig) -> None:
        longest = longest_payload(config, config.encoding)
        if longest > self.max_payload:
            raise ModelError(
                f"{config.name} sends up to {longest} bytes in a message, as {config.encoding}, and the robots' limit "
                f"is {self.max_payload}: start them with -p max_payload:={longest} or another encoding"
            )
