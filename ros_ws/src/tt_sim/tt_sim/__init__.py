"""A simulated world in place of the hardware: ball, table, cameras and arm."""
