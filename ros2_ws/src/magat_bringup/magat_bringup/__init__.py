# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Starts a team: launch file, parameters, processes, network, and the client that runs episodes."""
