# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""A robot: its policy (`policy`), its part in the exchange of messages (`crew`, `exchange`), and its node (`node`)."""
