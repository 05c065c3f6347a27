"""A vessel as a MAVLink boat without a boat: for `shadow simulate --live`, tests and benchmarks."""
