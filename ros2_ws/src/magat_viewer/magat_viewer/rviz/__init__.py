# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The RViz bridge: a team as standard ROS messages (map, markers, tf, diagnostics) for RViz and Foxglove."""
