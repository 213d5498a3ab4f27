"""The frames of a calibration's record, as its fits want them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.calibration import request as names
from labapp.calibration.request import CalibrationDesign
from labapp.common.errors import UserError
from labapp.files.reading import validate
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from optics.calibration.spots import frame_variance
from optics.camera import Camera

Array = NDArray[np.float64]

_HOT = 8.0
"""Standard deviations of read noise by which a pixel in a dark frame is hot."""


@dataclass(frozen=True)
class CalibrationFrames:
    """A record and the design that it was made by.

    camera: as it was known when the record was made.
    """

    record: Record
    design: CalibrationDesign
    camera: Camera

    @staticmethod
    def of(record: Record) -> CalibrationFrames:
        """UserError if the record isn't one of a calibration, or isn't whole."""
        text = record.plan.metadata.get(names.DESIGN_KEY)
        if not isinstance(text, str):
            raise UserError(
                f"{record.path}: is no record of a calibration. Give one that "
                "`labapp calibrate` made, or the run of a plan that it wrote."
            )
        if record.state is not State.COMPLETE:
            raise UserError(
                f"{record.path}: the run is {record.state}, and a calibration needs all of its "
                f"frames. Take them with: labapp resume {record.path}"
            )
        design = validate_design(text, str(record.path))
        return CalibrationFrames(record, design, record.bench.build_camera())

    def raw_frames(self, pattern: str, wavelength_nm: float) -> NDArray[np.uint16]:
        """All frames of a pattern at a wavelength, (frames, rows, columns)."""
        indices = self._at(wavelength_nm, target=self.design.request.star, pattern=pattern)
        if not indices:
            raise UserError(
                f"{self.record.path}: has no frame of {pattern!r} at {wavelength_nm:g} nm. "
                "Run its plan again."
            )
        return np.stack([self.record.image(index) for index in indices])

    def sweep_frames(self, wavelength_nm: float) -> list[NDArray[np.uint16]]:
        """The frames of the sweep, in the order of the design's levels."""
        levels = zip(self.design.low, self.design.high, strict=True)
        return [
            self.raw_frames(names.stripes_pattern_name(low, high), wavelength_nm)[0]
            for low, high in levels
        ]

    def mean_dark_frame(self, wavelength_nm: float, exposure_ms: float) -> Array:
        """The mean dark frame of an exposure; the sensor's black level where there is none."""
        dark = self.design.request.dark
        exposure = round(exposure_ms * 1e3) / 1e6
        indices = self._at(wavelength_nm, target=dark, exposure_asked=exposure)
        if not indices:
            sensor = self.camera.sensor
            level = sensor.black_level + sensor.dark_current * exposure / sensor.gain
            return np.full(sensor.shape, level)
        return np.mean([self.record.image(index) for index in indices], axis=0)

    def mean_light(self, pattern: str, wavelength_nm: float, dark: Array) -> tuple[Array, Array]:
        """A pattern's mean picture less its dark, and the variance of that, (rows, columns)."""
        frames = self.raw_frames(pattern, wavelength_nm).astype(np.float64)
        sensor = self.camera.sensor
        variance = frame_variance(frames, sensor).mean(axis=0) / len(frames)
        return frames.mean(axis=0) - dark, variance + frame_variance(dark, sensor) / 2

    def clipped_pixels(self, pattern: str, wavelength_nm: float) -> NDArray[np.bool_]:
        """Pixels at full scale in one of a pattern's frames, (rows, columns)."""
        brightest = self.raw_frames(pattern, wavelength_nm).max(axis=0)
        return brightest >= self.camera.sensor.full_scale

    def hot_pixels(self, dark: Array) -> NDArray[np.bool_]:
        """Pixels that are bright without light."""
        sensor = self.camera.sensor
        return dark - np.median(dark) > _HOT * sensor.read_noise / sensor.gain + 1

    def _at(self, wavelength_nm: float, **wanted: Any) -> list[int]:
        """Stored frames at a wavelength, which plans round to whole picometres."""
        away = np.abs(self._wavelengths - wavelength_nm * 1e-9)
        return [index for index in self.record.select(**wanted) if away[index] < 1e-12]

    @cached_property
    def _wavelengths(self) -> Array:
        return self.record.column("wavelength_asked")


def validate_design(text: str, source: str) -> CalibrationDesign:
    """UserError if the text isn't a design."""
    try:
        data = json.loads(text)
    except ValueError as error:
        raise UserError(f"{source}: its design is damaged: {error}. Run its plan again.") from error
    return validate(data, CalibrationDesign, f"{source}: {names.DESIGN_KEY}")
