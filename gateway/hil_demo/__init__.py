"""The closed story of the loop in one command: `shadow hil-demo`."""
