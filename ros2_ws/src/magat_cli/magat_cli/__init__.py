# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The magat command: one module for each verb."""
