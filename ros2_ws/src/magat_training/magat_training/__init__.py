# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""From cases to policies: expert solutions, imitation, evaluation. No ROS in here."""
