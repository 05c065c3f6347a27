"""Watching shadows over zenoh, on this machine or another: what `shadow monitor` is made of."""
