"""Joint motion in time within limits."""
