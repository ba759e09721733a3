"""The physics of the team: grid, field of view, radio graph, shield, episodes and their measures.

Everything here but ``node`` is free of ROS: training, evaluation and the simulator node run the same code.
"""
