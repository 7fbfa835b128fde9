"""Bags of ROS 1, version 2.0 (wiki.ros.org/Bags/Format/2.0)."""
