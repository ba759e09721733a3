# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Policies in POGEMA, the environment in which others compare theirs (Skrynnik et al., 2022)."""
