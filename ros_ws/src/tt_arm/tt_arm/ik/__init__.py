"""From a racket state to joint positions and speeds."""
