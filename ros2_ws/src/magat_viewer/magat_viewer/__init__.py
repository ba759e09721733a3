"""A local web page that shows a team: live, from the topics that any tool may listen to, or recorded.

Everything here but ``node`` is free of ROS. What is shown of a recording comes from `magat_bringup.viewing`.
"""
