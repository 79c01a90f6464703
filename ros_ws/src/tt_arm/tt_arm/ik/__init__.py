"""Inverse kinematics: search for the posture (joint positions) and the joint speeds of a stroke."""
