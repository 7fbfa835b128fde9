"""Bags of ROS 2: databases of sqlite3, and recordings in several parts with a description in YAML."""
