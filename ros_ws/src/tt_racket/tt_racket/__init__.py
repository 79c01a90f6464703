"""The racket state that returns the ball to a goal (dissertation Chapter 4)."""
