"""The learned policy, in torch and without ROS: configuration, network, fixed-point deployment, files."""
