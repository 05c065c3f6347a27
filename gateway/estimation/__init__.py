"""From measurements at their own times and rates to motion with its uncertainty."""
