"""Studies: what is measured for the page of results. A module of this package for each, or for each kind.

A module registers its studies with `magat_evaluation.studies.study.register`.
"""
