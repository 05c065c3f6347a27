"""What a learned table is over, and what it acts on: the codes that a vessel file holds."""

import math

KNOTS = 9
SURGE, SWAY, YAW, THRUST = 1.0, 2.0, 3.0, 4.0
AHEAD, SIDEWAYS, TURNING, HEADING, MOTOR = 1.0, 2.0, 3.0, 4.0, 5.0

NAMES = {AHEAD: "speed ahead", SIDEWAYS: "speed sideways", TURNING: "yaw rate",
         HEADING: "heading", MOTOR: "thrust of each motor"}  # fmt: skip
# what a knot is told in: unit, and how many of it make one of the table's
UNITS = {AHEAD: ("m/s", 1.0), SIDEWAYS: ("m/s", 1.0), TURNING: ("°/s", math.pi / 180.0),
         HEADING: ("°", math.pi / 180.0), MOTOR: ("%", 0.01)}  # fmt: skip


DRAWN_AGAINST = {AHEAD: "surge", SIDEWAYS: "sway", TURNING: "turn_rate", HEADING: "heading",
                 MOTOR: "throttle"}  # fmt: skip
