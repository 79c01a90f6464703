"""The path of the ball through flight and bounces (dissertation Chapters 3 and 4)."""
