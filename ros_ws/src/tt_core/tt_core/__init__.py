"""The shared vocabulary: states, physics, errors, and their messages."""
