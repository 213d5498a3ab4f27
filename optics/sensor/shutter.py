"""When each row is exposed, by a global or a rolling shutter."""

from __future__ import annotations

import torch

from optics.sensor.sensor import Sensor
from optics.validation import require_positive


def row_starts(sensor: Sensor, first_start: float = 0.0, *, rolling: bool = True) -> torch.Tensor:
    """Return when the shutter begins to expose each row, in seconds.

    A global shutter starts all rows at once. A rolling shutter starts each row by the sensor's line
    time after the one before, from the first row to the last.

    Parameters
    ----------
    sensor : Sensor
        The sensor, with its shutter and line time.
    first_start : float, default 0.0
        Start of the first row, seconds.
    rolling : bool, default True
        Whether a rolling shutter's delays count; False starts all rows at once.

    Returns
    -------
    torch.Tensor, (rows,), float64
        Seconds.
    """
    rows = torch.arange(sensor.shape[0], dtype=torch.float64)
    return first_start + rows * (row_delay(sensor) if rolling else 0.0)


def row_delay(sensor: Sensor) -> float:
    """Return the delay between the starts of two neighbouring rows, in seconds."""
    return sensor.line_time if sensor.shutter == "rolling" else 0.0


def frame_duration(sensor: Sensor, exposure: float) -> float:
    """Return how long a shutter takes to expose all rows of a frame, in seconds.

    A rolling shutter exposes the rows one after the other.
    """
    require_positive("exposure", exposure, "s")
    return exposure + (sensor.shape[0] - 1) * row_delay(sensor)
