"""Frames of a record in the form that the fits need."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.calibration.request import DESIGN_KEY, CalibrationDesign
from labapp.common.errors import UserError
from labapp.common.plain_text import shell_word
from labapp.files.plain_data import parse_json
from labapp.files.quantities import exposure_from_ms
from labapp.files.reading import validate
from labapp.files.sensor_file import require_monochrome_sensor
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from optics.camera import Camera
from optics.measuring.spots import frame_variance

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CalibrationFrames:
    """Reads a record's frames, by the design that its plan carries.

    camera: the description of the camera when the record was made.
    """

    record: Record
    design: CalibrationDesign
    camera: Camera

    @staticmethod
    def of(record: Record) -> CalibrationFrames:
        """Read a record's design; raise UserError if it is of another kind or incomplete."""
        text = record.plan.metadata.get(DESIGN_KEY)
        if not isinstance(text, str):
            raise UserError(
                f"{record.path}: is no record of a calibration. Give one that "
                "`labapp calibrate` made, or the run of a plan that it wrote."
            )
        if record.state is not State.COMPLETE:
            raise UserError(
                f"{record.path}: the run is {record.state}, and a calibration needs all of its "
                f"frames. Take them with: labapp resume {shell_word(record.path)}"
            )
        source = f"{record.path}: {DESIGN_KEY}"
        design = validate(parse_json(text, source), CalibrationDesign, source)
        camera = record.camera
        require_monochrome_sensor(camera.sensor, "labapp calibrate")
        return CalibrationFrames(record, design, camera)

    def raw_frames(self, pattern: str, wavelength_nm: float) -> NDArray[np.uint16]:
        """Return the star's frames with a pattern at a wavelength, (frames, rows, columns)."""
        indices = self._select_frames(
            wavelength_nm, target=self.design.request.star, pattern=pattern
        )
        if not indices:
            raise UserError(
                f"{self.record.path}: has no frame of {pattern!r} at {wavelength_nm:g} nm. "
                "Run its plan again."
            )
        return np.stack([self.record.image(index) for index in indices])

    def mean_dark_frame(self, wavelength_nm: float, exposure_ms: float | None = None) -> Array:
        """Average the dark frames of an exposure, by default the star's, (rows, columns), DN.

        If there are none, the frame is computed from the sensor's black level and dark current.
        """
        dark = self.design.request.dark
        exposure = exposure_from_ms(exposure_ms or self.design.exposures_at(wavelength_nm).full_ms)
        indices = self._select_frames(wavelength_nm, target=dark, exposure_asked=exposure)
        if not indices:
            sensor = self.camera.sensor
            level = sensor.black_level + sensor.dark_current * exposure / sensor.gain
            return np.full(sensor.shape, level)
        return np.mean([self.record.image(index) for index in indices], axis=0)

    def mean_light(self, pattern: str, wavelength_nm: float, dark: Array) -> tuple[Array, Array]:
        """Average the frames of a pattern, and subtract the dark frame.

        Returns the mean and its variance, both (rows, columns).
        """
        frames = self.raw_frames(pattern, wavelength_nm).astype(np.float64)
        sensor = self.camera.sensor
        variance = frame_variance(frames, sensor).mean(axis=0) / len(frames)
        return frames.mean(axis=0) - dark, variance + frame_variance(dark, sensor) / 2

    def clipped_pixels(self, pattern: str, wavelength_nm: float) -> NDArray[np.bool_]:
        """Mark the pixels that are at full scale in any of a pattern's frames, (rows, columns)."""
        brightest = self.raw_frames(pattern, wavelength_nm).max(axis=0)
        return brightest >= self.camera.sensor.full_scale

    def hot_pixels(self, dark: Array) -> NDArray[np.bool_]:
        """Mark the hot pixels of a dark frame, (rows, columns).

        A hot pixel exceeds the frame's median by more than 8 times the read noise plus 1 DN.
        """
        sensor = self.camera.sensor
        return dark - np.median(dark) > 8.0 * sensor.read_noise / sensor.gain + 1

    def _select_frames(self, wavelength_nm: float, **wanted: Any) -> list[int]:
        """Return the indices of the frames at a wavelength.

        Plans round wavelengths to whole picometres.
        """
        away = np.abs(self._wavelengths - wavelength_nm * 1e-9)
        return [index for index in self.record.select(**wanted) if away[index] < 1e-12]

    @cached_property
    def _wavelengths(self) -> Array:
        return self.record.column("wavelength_asked")
