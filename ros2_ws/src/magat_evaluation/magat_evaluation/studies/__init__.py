# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Studies: what is measured for the page of results, a module for each study or group of studies.

To add a study, add a module that registers it, see `magat_evaluation.studies.study.register`. Its section is at the end
of the page, unless ``results_template.md`` has one with its placeholder.
"""
