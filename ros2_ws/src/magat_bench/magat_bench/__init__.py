# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks of the expert, the simulator, training, a running team and its page."""
