"""What the tests of training share: a few cases that the expert has solved."""

import pytest
import torch

from magat_training.cases import SolvedCase, solved_cases

#: Small enough to solve, learn and play in no time; crowded enough to need the others.
SIZE = {"width": 9, "height": 9, "robots": 5, "density": 0.15}


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def solved() -> list[SolvedCase]:
    """Eight small cases with the expert's solutions."""
    return list(solved_cases(range(8), workers=1, **SIZE))
