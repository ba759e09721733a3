# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The physics of the team: grid, field of view, radio graph, shields, episodes and their measures.

Only ``node`` and ``deployment_server`` use ROS. Training, evaluation and the simulator node run the same code.
"""
