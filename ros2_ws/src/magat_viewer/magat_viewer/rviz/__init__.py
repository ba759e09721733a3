"""The RViz bridge: a team as standard ROS messages (map, markers, tf, diagnostics) for RViz and Foxglove."""
