"""A boat to try things on: a vessel played as a MAVLink boat, with an autopilot's manners.

    program → hull → sensors → streams → frames → wire

Everything but `port` and `play` is pure: a boat is a value that is moved on, seconds in, frames
out, the same for the same seed.
"""
