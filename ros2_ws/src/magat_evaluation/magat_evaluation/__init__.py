# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measures policies and baselines on sets of cases, and writes the page of results; no ROS."""
