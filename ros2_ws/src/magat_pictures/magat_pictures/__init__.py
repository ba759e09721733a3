# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures and animations of episodes, and the colour table of the project."""
