"""The ball in an image: place, outline and light."""
