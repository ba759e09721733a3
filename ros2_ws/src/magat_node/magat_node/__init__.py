# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared code of all nodes: topics, quality of service, parameters, actions, and running until a signal."""
