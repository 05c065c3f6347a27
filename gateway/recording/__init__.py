"""MCAP recordings, written and read back, and the same rows for Foxglove and its kin."""
