"""What a link counts: shown by health and by `shadow monitor`, never hidden."""

from dataclasses import dataclass


@dataclass
class Counts:
    """Since the link was opened. The receiver adds; others read a copy."""

    datagrams: int = 0
    bytes: int = 0
    frames: int = 0  # accepted
    unknown: int = 0  # kept, never used
    bad_checksum: int = 0
    junk_bytes: int = 0
    dropped: int = 0  # datagrams for which the inbox had no room
    unsigned: int = 0  # refused, as the next two
    wrong_signature: int = 0
    old_signature: int = 0
    faults: int = 0
    losses: int = 0  # of the connection
    sent: int = 0
    unsent: int = 0  # nobody to send to, or the line was full
