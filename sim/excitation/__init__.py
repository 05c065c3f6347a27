"""Excitations: what to do with throttle and helm so that a boat shows its parameters."""
