"""Shared code of all nodes: topics, quality of service, parameters, actions, and running until a signal."""
