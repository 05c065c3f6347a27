"""DataFlash writes the gyro as it is; the filter's own estimate of its bias is taken off here."""

from dataclasses import replace

import numpy as np

from gateway.ingest.log import Log
from gateway.samples import Samples

BIAS_IN = ("XKF1", "NKF1")  # column GZ [deg/s], column C where there are several lanes


def without_bias(samples: Samples, log: Log, lane: int) -> Samples:
    """Yaw rates of the IMU -> the same minus the bias last known at each row of the log."""
    for name in BIAS_IN:
        table = log.table(name)
        if len(table) and "GZ" in table.columns:
            lanes = np.asarray(table.columns.get("C", np.full(len(table), lane)))
            mine = lanes == lane
            bias = np.radians(np.asarray(table.columns["GZ"], np.float64)[mine])
            if len(bias):
                last = np.searchsorted(table.order[mine], samples.order) - 1
                return replace(samples, values=samples.values - bias[np.maximum(last, 0), None])
    return samples
