# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The secret of episodes that tests repeat, on a team or in the batched simulator."""

SECRET = bytes(range(32))
