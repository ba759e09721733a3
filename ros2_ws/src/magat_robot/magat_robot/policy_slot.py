# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The robots' side of a deployment: prepares a new policy, switches to it, rolls it back. Free of ROS."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

from magat_node.text import shortened
from magat_robot.policy.backends import load_policy
from magat_robot.policy.config import ModelError, PolicyConfig
from magat_robot.policy.folder import read_temperature, write_files
from magat_robot.policy.interface import RobotPolicy
from magat_robot.policy.payload import longest_payload

#: Most characters of a refusal, which may quote the files of a stranger.
_LONGEST_REFUSAL = 500


class PolicySlot:
    """Holds the current policy of a process, and during a deployment also the next and the previous one.

    Each deployment has a number. It is prepared, then switched to, and may be rolled back. Repeated orders have no
    effect.
    """

    def __init__(self, policy: RobotPolicy, backend: str, max_payload: int = 0, shield: str = "") -> None:
        """Hold ``policy``.

        Args:
            policy: the policy that the process starts with. Its encoding is kept for all deployed policies.
            backend: one of `magat_robot.policy.config.BACKENDS`; also for deployed policies.
            max_payload: the longest payload in bytes that a policy may send; 0: as long as that of ``policy``.
            shield: the simulator's; deployed policies get their temperatures for it, see `read_temperature`.

        Raises:
            ModelError: the payloads of ``policy`` are longer than ``max_payload``.
        """
        longest = longest_payload(policy.config, policy.config.encoding)
        self.policy = policy
        self.max_payload = max_payload or longest
        #: Number of the deployment that installed `policy`; 0 for the policy that the process started with.
        self.deployment = 0
        #: Number of the last deployment that was prepared or refused, and the reason if it was refused.
        self.prepared, self.refusal = 0, ""
        self._backend, self._shield = backend, shield
        self._before: tuple[int, RobotPolicy] | None = None
        self._next: RobotPolicy | None = None
        self._check(policy.config)

    def prepare(self, number: int, digest: str, files: Mapping[str, bytes]) -> None:
        """Load the policy of deployment ``number``, or refuse it.

        Args:
            number: of the deployment, not 0.
            digest: expected SHA-256 of the weights, hexadecimal.
            files: as `magat_robot.policy.folder.read_files` returns them.
        """
        if number in (self.deployment, self.prepared):
            return
        self.prepared, self.refusal, self._next = number, "", None
        try:
            self._next = self._load(digest, files)
        except (ModelError, OSError) as error:  # OSError: e.g. the disk is full
            self.refusal = shortened(error, _LONGEST_REFUSAL)

    def switch(self, number: int) -> bool:
        """Switch to the policy of deployment ``number`` if it is prepared; True if the policy changes."""
        if number != self.prepared or self._next is None:
            return False
        self._before = self.deployment, self.policy
        self.deployment, self.policy, self._next = number, self._next, None
        return True

    def roll_back(self, number: int) -> bool:
        """Return to the policy before deployment ``number`` and discard that deployment; True if the policy changes."""
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
            temperature = read_temperature(folder, self._shield)
            kept = self.policy.config.encoding
            policy = load_policy(folder, self._backend, temperature=temperature, encoding=kept)
        if policy.digest != digest:
            raise ModelError(f"the weights have the SHA-256 {policy.digest}, not {digest} as announced")
        self._check(policy.config)
        return policy

    def _check(self, config: PolicyConfig) -> None:
        longest = longest_payload(config, config.encoding)
        if longest > self.max_payload:
            raise ModelError(
                f"{config.name} sends up to {longest} bytes in a message, as {config.encoding}, and the robots' limit "
                f"is {self.max_payload}: start them with -p max_payload:={longest}, or with a shorter encoding"
            )
