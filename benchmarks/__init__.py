"""Measurements: speed as a ratio against a peer in the same run, diagnosis on hidden effects."""
