"""How far a model is from a measurement, and in which regimes: trials in, `Comparison` out."""
