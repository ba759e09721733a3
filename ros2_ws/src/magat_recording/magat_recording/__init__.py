# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records teams to rosbag2 bags, and analyses and draws recordings."""
