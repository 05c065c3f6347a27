"""The reference velocity, and the controller that makes a plant follow it."""
