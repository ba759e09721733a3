"""Measures policies and baselines on sets of cases, and writes the page of results; no ROS."""
