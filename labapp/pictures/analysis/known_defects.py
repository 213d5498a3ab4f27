"""Take the pixels that a camera's calibration lists as defective out of merged brackets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.runs.record.reader import Record
from optics.camera import Sensor

Picture = NDArray[np.float64]

_REACH = 2
"""Pixels of the same colour to either side from which a defective one is filled. Chosen."""


def known_defects(record: Record) -> NDArray[np.bool_] | None:
    """Return the defective pixels of a record's camera, (rows, columns).

    None if no calibration of the camera was in force when the frames were taken, or if it lists
    none. Raises UserError if the frames are of another size than the calibration.
    """
    calibration = record.bench.active_camera_calibration
    if calibration is None or not calibration.defects.pixels:
        return None
    readout = record.readouts[record.chosen_readout]
    mask, shape = calibration.defect_mask(), record.whole_frame
    if mask.shape != shape:
        raise UserError(
            f"{record.path}: its frames are {shape[1]} x {shape[0]} pixels, and its camera was "
            f"calibrated with {mask.shape[1]} x {mask.shape[0]}. Remove the key "
            "'camera_calibration' from the bench file, and take the pictures again."
        )
    return readout.read_mask(mask)


def fill_defects(
    rate: Picture, variance: Picture, defects: NDArray[np.bool_], sensor: Sensor
) -> None:
    """Fill defective pixels in place from those of the same colour around them.

    The rate, (rows, columns), becomes the median of the others, and the variance their mean squared
    difference from it and their own. Pixels without any other stay.
    """
    pattern = sensor.colour.pattern if sensor.colour else ("M",)
    steps = len(pattern), len(pattern[0])
    for row, column in np.argwhere(defects):
        around = tuple(
            slice(max(n - _REACH * step, n % step), n + _REACH * step + 1, step)
            for n, step in zip((row, column), steps, strict=True)
        )
        sound = ~defects[around] & np.isfinite(variance[around])
        if sound.any():
            others, own = rate[around][sound], variance[around][sound]
            rate[row, column] = np.median(others)
            variance[row, column] = np.mean((others - np.median(others)) ** 2 + own)
