"""The calibration file: a bench's fitted quantities, their uncertainties, and the bench itself."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import AwareDatetime, Field, model_validator

from labapp.files.quantities import Amount, Finite, Nanometres, Positive, Share
from labapp.files.reading import FileModel
from optics.camera import Camera
from optics.measuring.registration import Registration
from optics.measuring.wavefront import zernike_path
from optics.plane import Plane
from optics.slm import Panel, PanelMap, PhaseResponse

Count = Annotated[int, Field(ge=0)]
Pair = tuple[Finite, Finite]
Triple = tuple[Finite, Finite, Finite]


class DeviceIdentityTable(FileModel):
    """The identity of a device that a calibration was made with."""

    model: str
    serial: str
    simulated: bool


class RegistrationTable(FileModel):
    """Registration of panel and sensor in a calibration file, with its uncertainty.

    The sensor pixel (y, x) of a grating on the panel is centre_px + matrix_px @ (cycles per panel
    pixel). covariance_px2 is that of one row of centre and matrix, the same for y and x,
    uncertainty_px the standard deviation of a registered position in the corner of the frame where
    it is largest, and residual_px the root mean square distance of the measured spots from the fit.
    shift_px [y, x] is common to all steered spots, before the phase response was known. flip,
    rotation_deg and shear are the matrix as a mirror, followed by a shear and a rotation.
    image_distance_mm is element B of the ray matrix, the shift on the sensor for a unit slope at
    the panel: the distance from lens to sensor if the panel stands at the lens.
    """

    wavelength_nm: Nanometres
    centre_px: Pair
    matrix_px: tuple[Pair, Pair]
    covariance_px2: tuple[Triple, Triple, Triple]
    uncertainty_px: Amount
    residual_px: Amount
    shift_px: Pair
    spots: Count
    outliers: Count
    flip: Literal["none", "left-right", "up-down", "both"]
    rotation_deg: Finite
    shear: Finite
    image_distance_mm: Positive

    def build(self) -> Registration:
        """Return the registration without the spots' residuals, whose rms alone is stored."""
        return Registration(
            self.wavelength_nm * 1e-9,
            self.centre_px,
            np.array(self.matrix_px),
            np.array(self.covariance_px2),
            self.shift_px,
            np.zeros((0, 2)),
            np.zeros(0, dtype=bool),
        )


class CurveTable(FileModel):
    """Phase response of one region of the panel in a calibration file.

    phase_rad is the phase of every grey level, less that of level 0, and sigma_rad its standard
    deviation. residual is the root mean square misfit of the measured light as a share of its
    modulation, chi2 the mean squared one over the noise's variance. blur_px is that of the phase by
    neighbouring panel pixels, ripple the change of the phase within a frame and the filter's band
    as a share of it, and outliers are the frames that the fit left out.
    """

    phase_rad: Annotated[tuple[Finite, ...], Field(min_length=2)]
    sigma_rad: tuple[Amount, ...]
    residual: Amount
    chi2: Amount
    blur_px: Amount
    ripple: Amount
    frames: Count
    outliers: Count

    @model_validator(mode="after")
    def _rises(self) -> CurveTable:
        if len(self.sigma_rad) != len(self.phase_rad):
            raise ValueError("phase_rad and sigma_rad need a value for every level")
        if (np.diff(self.phase_rad) < 0).any():
            raise ValueError("phase_rad falls from one level to the next; it must not")
        return self


class MeasuredResponseTable(FileModel):
    """Phase response of the panel at a wavelength, with a curve for each region, row by row."""

    wavelength_nm: Nanometres
    regions: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]]
    curves: tuple[CurveTable, ...]

    @model_validator(mode="after")
    def _require_all_regions(self) -> MeasuredResponseTable:
        if len(self.curves) != math.prod(self.regions):
            raise ValueError(
                f"there are {len(self.curves)} curves, and {math.prod(self.regions)} regions"
            )
        if len({len(curve.phase_rad) for curve in self.curves}) > 1:
            raise ValueError("the curves don't have the same number of levels")
        return self

    @property
    def phases(self) -> Any:
        """The phases of the panel's regions, (rows, columns, levels), radians."""
        return np.array([curve.phase_rad for curve in self.curves]).reshape(*self.regions, -1)


class WavefrontTable(FileModel):
    """Wavefront in a calibration file: optical path besides the pattern, as Zernike polynomials.

    terms are their indices (n, m) over a disc around the pupil, of radius_mm on the panel, and
    path_nm their optical paths, root mean square over the disc. rms_nm and sigma_nm are those of
    the wavefront over the open pupil, without mean and tilt; focus_dioptres is the vergence error
    of the star. residual and chi2 are as in CurveTable.
    """

    wavelength_nm: Nanometres
    terms: tuple[tuple[int, int], ...]
    path_nm: tuple[Finite, ...]
    covariance_nm2: tuple[tuple[Finite, ...], ...]
    radius_mm: Positive
    rms_nm: Amount
    sigma_nm: Amount
    focus_dioptres: Finite
    focus_sigma_dioptres: Amount
    residual: Amount
    chi2: Amount

    def build(self, panel: Panel) -> PanelMap:
        """Return the wavefront as optical path on cells that cover the panel."""
        # 240 cells along the panel's longer side resolve polynomials of the fourth degree.
        cells = tuple(max(1, round(n * min(1, 240 / max(panel.shape)))) for n in panel.shape)
        pitch = tuple(n * panel.pitch / c for n, c in zip(panel.shape, cells, strict=True))
        # The centre of the middle cell, relative to the panel pixel n // 2, which is the origin.
        centre = tuple(
            ((c // 2 + 0.5) * n / c - 0.5 - n // 2) * panel.pitch
            for n, c in zip(panel.shape, cells, strict=True)
        )
        plane = Plane((cells[0], cells[1]), (pitch[0], pitch[1]), (centre[0], centre[1]))
        path = [nm * 1e-9 for nm in self.path_nm]
        return PanelMap(zernike_path(self.terms, path, self.radius_mm * 1e-3, plane))


class ZerothOrderTable(FileModel):
    """Share of the light that stays in the zeroth order whatever the pattern."""

    wavelength_nm: Nanometres
    share: Share
    sigma: Amount
    frames: Count


class CalibrationFile(FileModel):
    """A calibration file: fitted quantities, and the bench that they were measured on.

    record is the file of the frames, and frames their number, trials included. devices, panel,
    lens, sensor and polarisation say how the bench file described the bench at that time, so that
    a later change of the bench can be noticed.
    """

    version: Literal[1]
    date: AwareDatetime
    bench: str
    record: str
    frames: Count
    software: str
    devices: dict[str, DeviceIdentityTable]
    panel: dict[str, Any]
    lens: dict[str, Any]
    sensor: dict[str, Any]
    polarisation: dict[str, Any] | None = None
    registrations: tuple[RegistrationTable, ...] = ()
    responses: tuple[MeasuredResponseTable, ...] = ()
    wavefront: WavefrontTable | None = None
    zeroth: tuple[ZerothOrderTable, ...] = ()

    @property
    def wavelengths(self) -> list[float]:
        """Wavelengths of the phase responses, metres, sorted."""
        return sorted(table.wavelength_nm * 1e-9 for table in self.responses)

    def apply_to(self, camera: Camera) -> Camera:
        """Return the camera with these measurements in place of its description.

        Raises ValueError if the calibration belongs to another panel.
        """
        panel = camera.panel
        change: dict[str, Any] = {}
        if self.responses:
            wavelengths = [table.wavelength_nm * 1e-9 for table in self.responses]
            phases = np.stack([table.phases for table in self.responses])
            change["response"] = PhaseResponse.from_phases(
                panel, wavelengths, torch.from_numpy(phases)
            )
        if self.wavefront:
            change["flatness"] = self.wavefront.build(panel)
        if self.zeroth:
            weights = [max(table.sigma, 1e-4) ** -2 for table in self.zeroth]
            shares = [table.share for table in self.zeroth]
            # The measured share of the zeroth order includes the cover glass's reflection.
            change |= {
                "unmodulated": float(np.average(shares, weights=weights)),
                "front_reflection": 0.0,
            }
        return replace(camera, panel=replace(panel, **change))


_NUMBER = r"-?[\d.]+(?:[eE][-+]?\d+)?"
_ROW = re.compile(rf"\[\s*{_NUMBER}(?:,\s*{_NUMBER})*\s*\]")


def calibration_to_json(calibration: FileModel) -> bytes:
    """Encode a calibration as JSON: a key per line, and rows of numbers on one line."""
    text = json.dumps(calibration.model_dump(mode="json"), indent=1)
    return _ROW.sub(lambda row: " ".join(row[0].split()), text).encode() + b"\n"
