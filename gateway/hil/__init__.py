"""A vessel under a real autopilot: protocols in which firmware asks for sensors, one file each."""
