"""Starts a team: launch file, parameters, processes, network, and the client that runs episodes."""
