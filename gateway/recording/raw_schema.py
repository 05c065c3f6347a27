"""How raw MAVLink frames are declared in an MCAP, so that players have nothing to say against them.

Foxglove and Lichtblick show an error for every channel in an encoding that they do not know, with a
schema or without. What frames of MAVLink 1 and 2 have in common fits a message of ROS 1, which
leaves out what follows it: a player shows the first eight bytes, the message is the frame byte for
byte.
"""

ENCODING, SCHEMA_ENCODING = "ros1", "ros1msg"
METADATA = {"encoding": "mavlink"}  # what the messages really are
FRAME = (
    "mavlink/Frame",
    b"# A MAVLink frame, whole: these are the first bytes of it, for MAVLink 1 and 2 alike.\n"
    b"uint8 magic\nuint8 payload_length\nuint8[6] header\n",
)
TICK = "mavlink/Tick", b"# A moment without telemetry: nothing.\n"
