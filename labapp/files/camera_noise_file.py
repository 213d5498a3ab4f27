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
    """A point of a camera's photon transfer curve: all pixels at one exposure time.

    signal_dn: mean less that of darkness. variance_dn2: temporal, less that of darkness.
    """

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

    Attributes
    ----------
    gain_electrons_per_dn, system_gain_dn_per_electron
        Conversion gain 1/K and overall system gain K.
    read_noise_electrons, read_noise_is_limit, dark_noise_dn
        Temporal dark noise without dark current and rounding; whether it is only known to be less;
        and as the numbers show it.
    black_level_dn, dark_current_electrons_per_s
        Mean number without light and exposure; electrons without light.
    full_well_electrons, clip_number_dn, clip_limit
        Where pixels clip, and what ends there; None if no exposure was saturated.
    saturation_capacity_electrons
        Where the variance is largest.
    sensitivity_threshold_electrons, dynamic_range_db, snr_max_db
        Signal that equals its noise; 20 log10 of saturation capacity over it, and of the largest
        ratio of signal to noise.
    linearity_error_percent, lamp_drift_percent
        Mean deviation from a line; the light's change over the run, if the order tells it.
    prnu_percent, dsnu_electrons
        PRNU1288 and DSNU1288, without defective pixels.
    reduced_chi2, degrees_of_freedom
        Misfit of the photon transfer curve.
    light_unevenness_percent, lamp_jump_percent
        Light of the brightest area over that of the dimmest, less 100; largest change of the light
        within a pair.
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
        self._require_same(sensor)
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

    def _require_same(self, sensor: Sensor) -> None:
        """Raise ValueError unless the sensor has the size and bits of the calibrated one."""
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

    def _full_well(self, sensor: Sensor, gain: float, black: float, noise: float) -> float:
        """Return the full well, electrons, with which the full scale is what was measured.

        gain: electrons per number. black: black level, number. noise: read noise, electrons.
        """
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
