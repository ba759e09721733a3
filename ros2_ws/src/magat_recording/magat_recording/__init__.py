"""Records teams to rosbag2 bags, and analyses and draws recordings."""
