"""Excitations: throttle and helm over time that make a boat show its parameters."""
