# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shows a team, live or recorded: on a web page in the browser, and in RViz and Foxglove (`magat_viewer.rviz`).

The page's modules are free of ROS, except `node`, `serve`, `main` and `replay`.
"""
