"""Recordings for other programs: tables, tracks, ROS 2 bags."""
