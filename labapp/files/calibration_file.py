"""The calibration file: what was fitted on a bench, how well, and on which bench."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import AwareDatetime, Field, model_validator

from labapp.files.quantities import Amount, Finite, Positive, Share
from labapp.files.reading import FileModel
from optics.calibration.registration import Registration
from optics.calibration.wavefront import zernike_path
from optics.camera import Camera
from optics.plane import Plane
from optics.slm import Panel, PanelMap, PhaseResponse

Count = Annotated[int, Field(ge=0)]
Pair = tuple[Finite, Finite]
Triple = tuple[Finite, Finite, Finite]

_FLATNESS_CELLS = 240
"""Along a panel's longer side: polynomials of the fourth degree are smoother than that."""


class DeviceIdentityTable(FileModel):
    """Which device it was."""

    model: str
    serial: str
    simulated: bool


class RegistrationTable(FileModel):
    """From panel to sensor: pixel = centre_px + matrix_px @ (cycles per panel pixel), (y, x).

    covariance_px2: of centre and matrix, the same for y and x. uncertainty_px: standard
    deviation in the corner of the frame where it is largest. residual_px: root mean square
    distance of the spots. shift_px: of all steered spots, before the response was known.
    flip, rotation_deg, shear: the matrix taken apart; the mirror comes first, the turn last.
    image_distance_mm: the lever of the panel's slopes on the sensor, from lens to sensor where
    the panel stands at the lens.
    """

    wavelength_nm: Positive
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
        """Its single residuals aren't kept."""
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
    """One region's phase, level by level, less that of level 0.

    sigma_rad: standard deviation, level by level. residual: root mean square of the light's
    misfit, as a share of its swing. chi2: mean squared misfit in units of its noise. blur_px:
    by neighbours. ripple: of the phase within a frame and the filter's band, as a share of it.
    outliers: frames that were left out.
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
    """The phase response at a wavelength; curves of the regions, row by row."""

    wavelength_nm: Positive
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
        """(rows, columns, levels), radians."""
        return np.array([curve.phase_rad for curve in self.curves]).reshape(*self.regions, -1)


class WavefrontTable(FileModel):
    """Optical path besides the pattern: Zernike polynomials over a disc about the pupil.

    terms: (n, m). path_nm: of each, root mean square over the disc; covariance_nm2: of them.
    radius_mm: of the disc, on the panel. rms_nm, sigma_nm: over the open pupil, less mean and
    tilt. focus_dioptres: how far the star is out of focus, with its standard deviation.
    """

    wavelength_nm: Positive
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
        """On cells that cover the panel."""
        cells = tuple(
            max(1, round(n * min(1, _FLATNESS_CELLS / max(panel.shape)))) for n in panel.shape
        )
        pitch = tuple(n * panel.pitch / c for n, c in zip(panel.shape, cells, strict=True))
        # A cell's centre, from the pixel that is the panel's origin.
        centre = tuple(
            ((c // 2 + 0.5) * n / c - 0.5 - n // 2) * panel.pitch
            for n, c in zip(panel.shape, cells, strict=True)
        )
        plane = Plane((cells[0], cells[1]), (pitch[0], pitch[1]), (centre[0], centre[1]))
        path = [nm * 1e-9 for nm in self.path_nm]
        return PanelMap(zernike_path(self.terms, path, self.radius_mm * 1e-3, plane))


class ZerothOrderTable(FileModel):
    """Share of the light that stays in the centre whatever the pattern."""

    wavelength_nm: Positive
    share: Share
    sigma: Amount
    frames: Count


class CalibrationFile(FileModel):
    """What was fitted on a bench, with everything that tells whether it still holds.

    bench: its name. record: of the frames. frames: how many there were, trials included.
    devices, panel, lens, sensor, polarisation: what it was made with, and how the bench file
    described it.
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
        """At which the response is known, metres, sorted."""
        return sorted(table.wavelength_nm * 1e-9 for table in self.responses)

    def apply_to(self, camera: Camera) -> Camera:
        """The camera as it was found to be. ValueError for another panel's calibration."""
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
            # What was seen to stay in the centre holds the cover glass's reflection.
            change |= {
                "unmodulated": float(np.average(shares, weights=weights)),
                "front_reflection": 0.0,
            }
        return replace(camera, panel=replace(panel, **change))


_NUMBER = r"-?[\d.]+(?:[eE][-+]?\d+)?"
_ROW = re.compile(rf"\[\s*{_NUMBER}(?:,\s*{_NUMBER})*\s*\]")


def calibration_to_json(calibration: CalibrationFile) -> bytes:
    """The file's text: a key a line, and rows of numbers on one line."""
    text = json.dumps(calibration.model_dump(mode="json"), indent=1)
    return _ROW.sub(lambda row: " ".join(row[0].split()), text).encode() + b"\n"
