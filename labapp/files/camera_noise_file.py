"""The camera's calibration file: gain, noise and defects as measured, and which camera it was."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AwareDatetime, Field

from labapp.files.calibration_file import DeviceIdentityTable
from labapp.files.quantities import Amount, Finite, Nanometres, Positive
from labapp.files.reading import FileModel
from optics.camera import Sensor

Count = Annotated[int, Field(ge=0)]
Pixel = tuple[Count, Count]

_WELL_DEVIATIONS = 5.0
"""Standard deviations of read noise that a sensor's full scale lies below its well: see Sensor."""


class QuantityTable(FileModel):
    """A measured quantity of a camera, and its standard uncertainty in the same unit."""

    value: Finite
    sigma: Amount


class CurvePointTable(FileModel):
    """A point of a photon transfer curve: mean and temporal variance, less those of darkness."""

    exposure_ms: Positive
    signal_dn: Finite
    variance_dn2: Finite
    fitted: bool


class DefectTable(FileModel):
    """Defective pixels of a camera, as [row, column], and the criteria by which they are.

    hot: by dark signal; more than hot_electrons from the median at the exposure times of the light,
    or more than hot_electrons_per_s above the median dark current. bright, weak: by photo-response;
    more than response_percent off the pixels around them. dead: less than dead_percent of these.
    """

    hot: tuple[Pixel, ...] = ()
    bright: tuple[Pixel, ...] = ()
    weak: tuple[Pixel, ...] = ()
    dead: tuple[Pixel, ...] = ()
    hot_electrons: Amount
    hot_electrons_per_s: Amount
    response_percent: Amount
    dead_percent: Amount

    @property
    def pixels(self) -> list[Pixel]:
        """All defective pixels, each once, by row and column."""
        return sorted({*self.hot, *self.bright, *self.weak, *self.dead})


class CameraNoiseFile(FileModel):
    """A camera's calibration file, in terms of EMVA 1288; optics.measuring says what each is.

    record is the file of the frames, and frames their number, trials included. camera and options
    say which camera it was and with which options the bench file opened it, and sensor how the file
    described it, so that a later change can be noticed. wavelength_nm is that of the light, and
    exposures_ms its shortest and longest exposure time.

    The gains are 1/K and the overall system gain K. read_noise_electrons is the temporal dark noise
    without dark current and rounding, read_noise_is_limit whether it is only known to be less, and
    dark_noise_dn as the numbers show it. full_well_electrons, clip_number_dn and clip_limit say
    where pixels clip, and what ends there; None if no exposure was saturated.
    saturation_capacity_electrons is where the variance is largest, sensitivity_threshold_electrons
    the signal that equals its noise; dynamic_range_db is 20 log10 of their ratio, and snr_max_db of
    the largest ratio of signal to noise. linearity_error_percent is the mean deviation from a line,
    lamp_drift_percent the light's change over the run, if the order tells it, and lamp_jump_percent
    the largest within a pair. prnu_percent and dsnu_electrons leave defective pixels out.
    reduced_chi2 is of the photon transfer curve. light_unevenness_percent is the light of the
    brightest area over that of the dimmest, less 100.
    """

    version: Literal[1]
    kind: Literal["camera noise"]
    date: AwareDatetime
    bench: str
    record: str
    frames: Count
    software: str
    camera: DeviceIdentityTable
    options: dict[str, Any]
    sensor: dict[str, Any]
    wavelength_nm: Nanometres
    exposures_ms: tuple[Positive, Positive]
    gain_electrons_per_dn: QuantityTable
    system_gain_dn_per_electron: QuantityTable
    read_noise_electrons: QuantityTable
    read_noise_is_limit: bool
    dark_noise_dn: QuantityTable
    black_level_dn: QuantityTable
    dark_current_electrons_per_s: QuantityTable
    full_well_electrons: QuantityTable | None
    clip_number_dn: QuantityTable | None
    clip_limit: Literal["converter", "well"] | None
    saturation_capacity_electrons: QuantityTable | None
    sensitivity_threshold_electrons: QuantityTable
    dynamic_range_db: QuantityTable | None
    snr_max_db: QuantityTable | None
    linearity_error_percent: QuantityTable | None
    lamp_drift_percent: QuantityTable | None
    prnu_percent: QuantityTable | None
    dsnu_electrons: QuantityTable
    reduced_chi2: Amount
    degrees_of_freedom: Count
    light_unevenness_percent: Amount
    lamp_jump_percent: Amount
    defects: DefectTable
    curve: tuple[CurvePointTable, ...]

    def apply_to(self, sensor: Sensor) -> Sensor:
        """Return the sensor with these measurements in place of its description.

        Raises ValueError if the calibration is of a sensor of other size or bits.
        """
        shape = self.sensor.get("height"), self.sensor.get("width")
        if shape != sensor.shape:
            raise ValueError(
                f"it is of {shape[1]} x {shape[0]} pixels, and the sensor has {sensor.shape[1]} x "
                f"{sensor.shape[0]}"
            )
        if self.sensor.get("bits") != sensor.bits:
            raise ValueError(
                f"it is of {self.sensor.get('bits')} bits, and the sensor has {sensor.bits}"
            )
        gain, black = self.gain_electrons_per_dn.value, max(self.black_level_dn.value, 0.0)
        noise = self.read_noise_electrons.value
        changes: dict[str, Any] = {
            "gain": gain,
            "read_noise": noise,
            "black_level": black,
            "dark_current": max(self.dark_current_electrons_per_s.value, 0.0),
            "dsnu": self.dsnu_electrons.value,
        }
        if self.prnu_percent is not None:
            changes["prnu"] = self.prnu_percent.value / 100
        return replace(sensor, **changes, full_well=self._full_well(sensor, gain, black, noise))

    def _full_well(self, sensor: Sensor, gain: float, black: float, noise: float) -> float:
        """Return the full well, electrons, with which the full scale is what was measured."""
        if self.full_well_electrons is None:
            # The number at which pixels clip stays as it was described.
            return sensor.full_well * gain / sensor.gain
        if self.clip_limit == "well":
            return self.full_well_electrons.value
        # The well is larger than the converter's range, by how much is unknown.
        top = (sensor.top_number + 0.5 - black) * gain
        return top + _WELL_DEVIATIONS * noise

    def defect_mask(self) -> NDArray[np.bool_]:
        """Return where pixels are defective, (rows, columns)."""
        mask = np.zeros((self.sensor["height"], self.sensor["width"]), dtype=bool)
        for row, column in self.defects.pixels:
            mask[row, column] = True
        return mask
