"""From cases to policies: expert solutions, imitation, evaluation. No ROS in here."""
