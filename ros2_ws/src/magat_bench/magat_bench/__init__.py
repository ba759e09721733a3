"""Benchmarks of the expert, the simulator, training, a running team and its page."""
