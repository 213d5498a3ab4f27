"""When each row of a sensor is exposed."""

from __future__ import annotations

import torch

from optics.sensor.sensor import Sensor
from optics.validation import require_positive


def row_starts(sensor: Sensor, first_start: float = 0.0, *, rolling: bool = True) -> torch.Tensor:
    """Seconds at which each row's exposure begins, (rows,) float64.

    first_start: of the first row. A global shutter starts all of them at once; a rolling one each
    row by its line time after the one before, from the first row to the last.
    """
    rows = torch.arange(sensor.shape[0], dtype=torch.float64)
    return first_start + rows * (row_delay(sensor) if rolling else 0.0)


def row_delay(sensor: Sensor) -> float:
    """Seconds between one row's start and the next's."""
    return sensor.line_time if sensor.shutter == "rolling" else 0.0


def frame_duration(sensor: Sensor, exposure: float) -> float:
    """Seconds from the first row's beginning to the last row's end."""
    require_positive("exposure", exposure, "s")
    return exposure + (sensor.shape[0] - 1) * row_delay(sensor)
