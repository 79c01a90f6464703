"""What cameras show of the true world."""
