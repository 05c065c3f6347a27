"""Every number that decides in a diagnosis, with its unit and the evidence for it."""

RELIEF = 3.0  # whitened rows that count as one independent row
