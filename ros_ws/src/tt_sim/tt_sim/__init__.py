"""A simulated world that stands in for the hardware: ball, table, cameras and arm."""
