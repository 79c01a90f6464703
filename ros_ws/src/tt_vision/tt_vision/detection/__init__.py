"""Detection of the ball in an image: its position, its outline and the light on it."""
