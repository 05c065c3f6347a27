"""Parameters of a vessel from trials, with intervals that hold."""
