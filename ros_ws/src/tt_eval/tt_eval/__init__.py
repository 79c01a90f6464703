"""Whole rallies without ROS, and their scores."""
