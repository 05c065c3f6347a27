"""simulated_boat."""
