"""The pages of the studio, one per file."""
