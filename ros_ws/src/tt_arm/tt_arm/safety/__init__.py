"""What keeps the arm, and the people near it, safe."""
