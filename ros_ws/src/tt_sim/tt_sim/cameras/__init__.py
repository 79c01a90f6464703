"""Simulated cameras: images and pixels of the true ball, and faults of the cameras."""
