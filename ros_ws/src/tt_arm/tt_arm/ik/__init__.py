"""Inverse kinematics: which posture, and which joint speeds."""
