"""Indices of the state and of what is kept per measurement; kinds of measurements; flags."""

from enum import IntEnum, IntFlag

from sim.trial import MOTION


class State(IntEnum):
    """Components of the filter's state; the first nine are the motion of a `Trial`."""

    NORTH = 0  # m
    EAST = 1  # m
    YAW = 2  # rad, continuous
    U = 3  # m/s, over ground
    V = 4  # m/s
    R = 5  # rad/s
    U_DOT = 6  # m/s², derivative of the body component
    V_DOT = 7  # m/s²
    R_DOT = 8  # rad/s²
    POSITION_ERROR_NORTH = 9  # m, reported − true
    POSITION_ERROR_EAST = 10  # m
    VELOCITY_ERROR_FIRST = 11  # m/s, north; forward where the source reports body velocity
    VELOCITY_ERROR_SECOND = 12  # m/s, east; starboard


STATES = len(State)
assert State.R_DOT + 1 == MOTION


class MeasurementKind(IntEnum):
    """What an event measures."""

    TICK = 0  # nothing: prediction only
    YAW = 1  # rad
    YAW_RATE = 2  # rad/s
    VELOCITY = 3  # north, east over ground [m/s]
    POSITION = 4  # north, east [m]
    BODY_VELOCITY = 5  # forward, starboard over ground [m/s]; instead of VELOCITY, not beside it
    ACCELERATION = 6  # forward, starboard [m/s²], free of gravity


KINDS = len(MeasurementKind)


class Flag(IntFlag):
    """What became of an event, and whether the row's estimate can be used."""

    VALID = 1  # the estimate rests on yaw and on velocity or position
    USED = 2
    GATED = 4  # an outlier or no number: not used
    WAITING = 8  # not used: heading is not known (yet, or any more)
    LATE = 16  # used after rewinding the filter
    REFUSED = 32  # too late, or no valid time or kind
    JUMP = 64  # states re-initialised after a discontinuity of the source
    RESTART = 128  # everything forgotten: a long gap, or the boat's clock stepped


class GateRecord(IntEnum):
    """What is kept about the gate of each kind of measurement."""

    SEEN = 0  # 1.0 once a measurement was used
    GATED_RUN = 1  # number gated in a row
    GATED_SINCE = 2  # time of the first of them [s]


GATE_RECORDS = len(GateRecord)
