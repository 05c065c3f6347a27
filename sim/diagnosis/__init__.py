"""How far a model is from the measurement, and where: arrays in, arrays out."""
