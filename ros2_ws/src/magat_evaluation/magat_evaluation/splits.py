# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The splits of the cases, and the limits of the expert that solves them. Quick to import."""

from collections.abc import Mapping

from magat_sim.constants import EXPERT_W as EXPERT_W

#: Seed and size of the 30,000 cases for training, validation and tests.
SET_SEED = 2021
SET_SIZE: Mapping[str, float] = {"width": 20, "height": 20, "robots": 10, "density": 0.1}
#: Numbers of the cases of each split (70 / 15 / 15 %); no case is in two of them.
SPLITS = {"train": range(21_000), "valid": range(21_000, 25_500), "test": range(25_500, 30_000)}
#: Results are measured on test cases from this number on: with some of those before it, constants were chosen.
FIRST_RESULT = 26_000
#: The expert's limit in high-level expansions: unlike a time limit, it ends every search at the same point, so that
#: every machine solves the same cases.
EXPERT_NODE_LIMIT = 20_000
