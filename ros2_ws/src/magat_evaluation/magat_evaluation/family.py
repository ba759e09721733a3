# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The trainings behind docs/results.md: the paper's 20 policies, a control that never talks, and further seeds."""

from dataclasses import dataclass

#: Taps of the paper's policies: messages travel K - 1 hops.
PAPER_TAPS = 2


@dataclass(frozen=True)
class Training:
    """One training by the recipe that all share."""

    #: Of the policy, see `PolicyConfig`.
    policy: str
    seed: int = 0
    taps: int = PAPER_TAPS

    @property
    def name(self) -> str:
        """Name of its folder: the policy's, with -K1 if it has one tap, and -S2 if it has the seed 2."""
        taps = "" if self.taps == PAPER_TAPS else f"-K{self.taps}"
        return f"{self.policy}{taps}" + (f"-S{self.seed}" if self.seed else "")

    @property
    def shipped(self) -> bool:
        """Whether models/ has its policy. Of the others, only the measures are published."""
        return self in PAPER


#: Policies whose differences the paper's claims are about; each is trained with three seeds.
REPEATED = ("MAGAT-F-128", "GNN-F-128", "MAGAT-F-32-P4", "MAGAT-F-16", "GNN-F-16", "GAT-F-128")
_OTHERS = (
    *("GNN_baseline-F-128", "MAGAT-F-32", "MAGAT-B-32-P4", "MAGAT-B-32", "GNN-F-32", "MAGAT-B-128", "GNN-B-128"),
    *("MAGAT-B-16", "GNN-B-16", "GNN-B-32", "MAGAT-F-64", "GNN-F-64", "MAGAT-B-64", "GNN-B-64"),
)
#: The paper's policies; those that decide most come first.
PAPER = tuple(Training(policy) for policy in (*REPEATED, *_OTHERS))
#: Robots that never talk: one tap, so that a policy sees only its own observation.
CONTROL = Training("MAGAT-F-128", taps=1)
#: All trainings, in the order of `magat train --all`.
FAMILY = (*PAPER, CONTROL, *(Training(policy, seed) for seed in (1, 2) for policy in REPEATED))
