"""The map, the robots, tf and diagnostics of a team in ROS's common messages, for RViz and Foxglove."""
