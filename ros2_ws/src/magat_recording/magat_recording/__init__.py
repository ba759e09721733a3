"""Records a team to a rosbag2 bag, and analyses and draws what was recorded."""
