"""A spectral calibration as stored: a snapshot camera's model, its uncertainty, and its light."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import AwareDatetime, Field, model_validator

from labapp.common.errors import UserError
from labapp.files.calibration_file import DeviceIdentityTable
from labapp.files.quantities import Amount, Finite, Nanometres, Positive
from labapp.files.reading import FileModel, read_file, validate
from optics.multispectral import SnapshotCalibration, SnapshotModel

_PPM = 1e6

Share = Annotated[float, Field(ge=0, lt=1)]
Row = tuple[Finite, ...]
Stack = tuple[tuple[Row, ...], ...]

_HINT = "Give a file that `labapp calibrate --spectra` wrote, such as spectra.json"


class ParameterTable(FileModel):
    """One calibrated parameter of a snapshot camera in a spectral calibration's file.

    The unit is px, or nothing for shares and ratios; lower and upper are the ends of the 90 %
    interval, and nominal is the value of the nominal model.
    """

    name: str
    unit: str
    value: Finite
    sigma: Amount
    lower: Finite
    upper: Finite
    nominal: Finite


class BandTable(FileModel):
    """What a spectral calibration found in one band, besides the model's parameters.

    white_e_per_s is the electrons per second and pixel that the white sheet gives behind the filter
    that sees most. light_share is the share of the light that the coded pattern sends into the
    window of the PSF, over that of the neutral one: measured on the white sheet, times the computed
    share within the window. star_residual is the root mean square of what the calibrated model
    leaves of the star's picture beyond the noise, relative to the picture's own.
    """

    wavelength_nm: Nanometres
    white_e_per_s: Positive
    light_share: Positive
    star_residual: Amount


class TransmissionTable(FileModel):
    """What a spectroradiometer saw of the white sheet through the filter, for one band.

    wavelength_nm is the centroid of the spectrum, and width_nm its area over its peak, to which the
    instrument's slit adds. The radiance is integrated over the band. relative is the filter's
    transmission over that of the band that it passes most of, and sigma its standard deviation,
    from repeated measurements; None where the lamp's own spectrum isn't known.
    """

    wavelength_nm: Nanometres
    width_nm: Positive
    radiance_w_sr_m2: Positive
    relative: Positive | None = None
    sigma: Amount | None = None


class SpectraFile(FileModel):
    """A spectral calibration's file.

    The nominal PSFs are in parts per million of the light, (bands, rows, columns), with their
    origin at n // 2. `response` is (channels, bands), with the light of white in each band.
    `deviation` and `covariance` are of the parameters in the order of
    optics.multispectral.snapshot_model: zeroth orders of the bands, size of the coded PSFs,
    centres' y and x of the bands in pixels, natural logarithms of ratios.
    `indeterminate` says what frames and photographs can't tell.
    """

    version: Literal[1]
    kind: Literal["spectra"] = "spectra"
    date: AwareDatetime
    bench: str
    record: str
    frames: Annotated[int, Field(ge=0)]
    software: str
    devices: dict[str, DeviceIdentityTable]
    sensor: dict[str, Any]
    pitch_um: Positive
    coded_pattern: str
    coded_sha256: str
    nominal_source: str
    transmission_source: str
    indeterminate: tuple[str, ...]
    parameters: tuple[ParameterTable, ...]
    bands: Annotated[tuple[BandTable, ...], Field(min_length=2)]
    transmission: tuple[TransmissionTable, ...] = ()
    filters: tuple[str, ...]
    channels: str
    zeroth_order: tuple[Share, ...]
    response: tuple[Row, ...]
    deviation: Row
    covariance: tuple[Row, ...]
    psfs_ppm: Stack
    neutral_ppm: Stack

    @model_validator(mode="after")
    def _shapes_fit(self) -> SpectraFile:
        try:
            model, count = self.build_model(), len(self.bands)
        except ValueError as error:
            raise ValueError(f"the model of the camera is damaged: {error}") from error
        parameters = model.layout.count
        shapes = (len(self.deviation), *np.shape(self.covariance))
        if model.bands != count or shapes != (parameters,) * 3:
            raise ValueError(
                f"{count} bands need {count} PSFs and {parameters} deviations with their covariance"
            )
        if self.transmission and len(self.transmission) != count:
            raise ValueError(f"transmission has {len(self.transmission)} bands, not {count}")
        return self

    @property
    def wavelengths(self) -> tuple[float, ...]:
        """Wavelengths of the bands, metres."""
        return tuple(one.wavelength_nm / 1e9 for one in self.bands)

    def build_model(self) -> SnapshotModel:
        """Return the nominal model of the snapshot camera."""
        return SnapshotModel.create(
            np.array(self.psfs_ppm) / _PPM,
            np.array(self.response),
            zeroth_order=torch.tensor(self.zeroth_order, dtype=torch.float64),
            neutral=np.array(self.neutral_ppm) / _PPM,
            pattern=self.filters,
            channels=self.channels,
        )

    def build(self) -> SnapshotCalibration:
        """Return the calibration of the snapshot camera."""
        return SnapshotCalibration(
            self.build_model(),
            torch.tensor(self.deviation, dtype=torch.float64),
            torch.tensor(self.covariance, dtype=torch.float64),
            source=f"frames of {self.date:%Y-%m-%d}",
        )


@dataclass(frozen=True)
class SpectraSource:
    """A spectral calibration with the path that it was read from."""

    path: Path
    file: SpectraFile


def read_spectra_file(path: Path) -> SpectraSource:
    """Read a spectral calibration; raise UserError if the file is of another kind."""
    if path.suffix.lower() != ".json":
        raise UserError(f"--calibration {path}: is no .json file. {_HINT}.")
    plain = read_file(path, dict)
    if plain.get("kind") != "spectra":
        raise UserError(f"--calibration {path}: is no calibration of spectra. {_HINT}.")
    return SpectraSource(path, validate(plain, SpectraFile, str(path)))


def as_ppm(psfs: NDArray[np.float64]) -> Stack:
    """Return PSFs in parts per million of their light, to a tenth, far below the model's error."""
    # Adding zero makes -0.0 into 0.0.
    found: Any = (np.round(_PPM * psfs, 1) + 0.0).tolist()
    return tuple(tuple(tuple(row) for row in one) for one in found)


def name_bands(text: str, wavelengths: Sequence[float]) -> str:
    """Return "centre y of band 2" with the band's wavelength, as "centre y, 550 nm"."""
    return re.sub(
        r" of band (\d+)", lambda found: f", {wavelengths[int(found[1])] * 1e9:g} nm", text
    )
