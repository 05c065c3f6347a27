"""Which lane of the autopilot's filter a DataFlash log is read from: the one most in use."""

import numpy as np

from gateway.ingest.log import Log

SAYS_PRIMARY = (("XKF4", "PI"), ("NKF4", "PI"))  # message and column with the primary lane


def primary_lane(log: Log) -> int:
    """Number of the lane that was primary for most of the log; 0 where nobody says.

    One lane for the whole log: a switch between lanes is a step of the estimate, not motion.
    """
    for name, column in SAYS_PRIMARY:
        table = log.table(name)
        if len(table) and column in table.columns:
            lanes = np.asarray(table.columns[column]).astype(np.int64)
            return int(np.bincount(lanes[lanes >= 0], minlength=1).argmax())
    return 0
