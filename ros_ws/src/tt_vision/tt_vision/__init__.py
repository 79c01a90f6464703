"""Position, velocity and spin of the ball from two high speed cameras (dissertation Chapter 2)."""
