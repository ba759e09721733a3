# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the tests of training share."""

import pytest
import torch


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)
