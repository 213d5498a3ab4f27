"""A scene's table [truth]: properties of a virtual bench that differ from its bench file.

The application reads only the bench file, as with a real bench. A calibration has to measure the
differences.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, Field, model_validator

from labapp.files.lens_table import FieldAberrationsTable, GhostTable
from labapp.files.quantities import Amount, Finite, Nanometres, Positive, Share
from labapp.files.reading import FileModel
from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.pupil import open_area
from optics.slm import PhaseResponse
from optics.zernike import require_zernike_indices
from simulator.mount import Mount
from simulator.panel_imperfections import flatness_map, illumination_map, nonlinear_response

T = TypeVar("T")


def _require_zernike_term(term: tuple[int, int, float]) -> tuple[int, int, float]:
    require_zernike_indices(*term[:2])
    return term


Zernike = Annotated[tuple[int, int, Finite], AfterValidator(_require_zernike_term)]
"""A Zernike polynomial: [n, m, nm of optical path, root mean square]."""


class TrueResponseTable(FileModel):
    """True phase response of a virtual bench's panel.

    The response is range (x^gamma + wiggle sin 2 pi x), where x is the grey level from 0 to 1.
    Alternatively, shares gives the phase of every grey level as a share of the highest phase.
    """

    gamma: Positive = 1.0
    wiggle: Finite = 0.0
    range: Positive = 1.0
    shares: list[Finite] | None = None

    @model_validator(mode="after")
    def _validate_response(self) -> TrueResponseTable:
        if self.shares is not None and self.model_fields_set != {"shares"}:
            raise ValueError("give either shares, or gamma, wiggle and range")
        # Building the response checks that it rises.
        self.build(256)
        return self

    def build(self, levels: int) -> PhaseResponse:
        if self.shares is not None:
            return PhaseResponse.from_curve(550e-9, self.shares)
        return nonlinear_response(levels, self.gamma, self.wiggle, self.range)


class IlluminationTable(FileModel):
    """True illumination of the panel: a Gaussian beam of 1/e² radius, centred at [y, x]."""

    radius_mm: Positive
    centre_mm: tuple[Finite, Finite] = (0.0, 0.0)


class TruePanelTable(FileModel):
    """True properties of a virtual bench's panel; those left out are as in the bench file.

    flatness is a list of Zernike polynomials over the circle around the panel.
    """

    fill_factor: Annotated[float, Field(gt=0, le=1)] | None = None
    unmodulated: Share | None = None
    reflectivity: Share | None = None
    coupling_um: Amount | None = None
    response_time_ms: Amount | None = None
    flicker: Share | None = None
    jitter_rad: Amount | None = None
    gap_reflection: Share | None = None
    front_reflection: Share | None = None
    response: TrueResponseTable | None = None
    flatness: list[Zernike] | None = None
    illumination: IlluminationTable | None = None

    def apply(self, panel: Panel) -> Panel:
        same = (
            "fill_factor", "unmodulated", "reflectivity", "flicker", "gap_reflection",
            "front_reflection",
        )  # fmt: skip
        changes: dict[str, Any] = {
            **{name: getattr(self, name) for name in same},
            "jitter": self.jitter_rad,
            "coupling": _times(self.coupling_um, 1e-6),
            "response_time": _times(self.response_time_ms, 1e-3),
        }
        if self.response is not None:
            changes["response"] = self.response.build(panel.levels)
        if self.flatness is not None:
            changes["flatness"] = flatness_map(panel, _scale_rows(self.flatness, 1, 1, 1e-9))
        if self.illumination is not None:
            y, x = self.illumination.centre_mm
            radius = self.illumination.radius_mm * 1e-3
            changes["illumination"] = illumination_map(panel, radius, (y * 1e-3, x * 1e-3))
        return replace(panel, **{k: v for k, v in changes.items() if v is not None})


class TrueLensTable(FileModel):
    """True properties of a virtual bench's lens; those left out are as in the bench file."""

    focal_length_mm: Positive | None = None
    f_number: Positive | None = None
    focus_distance_m: Annotated[float, Field(gt=0)] | None = None
    aberrations: list[Zernike] | None = None
    relative_illumination: list[tuple[Amount, Finite]] | None = None
    distortion: tuple[Finite, Finite] | None = None
    axial_colour: list[tuple[Nanometres, Finite]] | None = None
    field_aberrations: FieldAberrationsTable | None = None
    lateral_colour: list[tuple[Nanometres, Finite]] | None = None

    def apply(self, lens: Lens) -> Lens:
        changes: dict[str, Any] = {
            "focal_length": _times(self.focal_length_mm, 1e-3),
            "f_number": self.f_number,
            "distortion": self.distortion,
            "focus_distance": self.focus_distance_m,
            "aberrations": _scale_rows(self.aberrations, 1, 1, 1e-9),
            "relative_illumination": _scale_rows(self.relative_illumination, 1e-3, 1),
            "axial_colour": _scale_rows(self.axial_colour, 1e-9, 1e-6),
            "field_aberrations": self.field_aberrations and self.field_aberrations.build(),
            "lateral_colour": _scale_rows(self.lateral_colour, 1e-9, 1e-2),
        }
        return replace(lens, **{k: v for k, v in changes.items() if v is not None})


class TrueSensorTable(FileModel):
    """True properties of a virtual bench's sensor; those left out are as in the bench file."""

    crosstalk_percent: Annotated[float, Field(ge=0, le=25)] | None = None
    dust: list[tuple[Finite, Finite, Positive]] | None = None
    dust_distance_um: Amount | None = None

    def apply(self, sensor: Sensor) -> Sensor:
        changes: dict[str, Any] = {
            "crosstalk": _times(self.crosstalk_percent, 1e-2),
            "dust": _scale_rows(self.dust, 1e-6, 1e-6, 1e-6),
            "dust_distance": _times(self.dust_distance_um, 1e-6),
        }
        return replace(sensor, **{k: v for k, v in changes.items() if v is not None})


class TrueFilterTable(FileModel):
    """True properties of a virtual bench's filter; those left out are as in the bench file.

    effective_index is that of thin films, whose band shifts with the angle: 1.5 to 2.5 mostly.
    """

    effective_index: Annotated[float, Field(ge=1)] | None = None


class MountTable(FileModel):
    """Orientation and place of the panel: mirrored, then rotated from x towards y, then shifted.

    shift_mm is [y, x] from the lens' axis to the panel's middle, in the axes of the sensor.
    """

    rotation_deg: Finite = 0.0
    flip_x: bool = False
    flip_y: bool = False
    shift_mm: tuple[Finite, Finite] = (0.0, 0.0)

    def build(self) -> Mount:
        y, x = self.shift_mm
        return Mount(
            math.radians(self.rotation_deg % 360), self.flip_x, self.flip_y, (y * 1e-3, x * 1e-3)
        )

    def require_light(self, camera: Camera) -> None:
        """Raise ValueError if the panel is shifted out of the stop, or can't be shifted."""
        if not open_area(self.build().camera_in_panel_axes(camera)):
            y, x = self.shift_mm
            raise ValueError(
                f"shift_mm is [{y:g}, {x:g}]; the panel then lies beside the stop, and no light "
                "passes: give a smaller shift"
            )


class TrueBenchTable(FileModel):
    """The table [truth]: differences of a virtual bench from its bench file, part by part."""

    panel: TruePanelTable = TruePanelTable()
    lens: TrueLensTable = TrueLensTable()
    sensor: TrueSensorTable = TrueSensorTable()
    filter: TrueFilterTable = TrueFilterTable()
    vibration_um: Amount | None = None
    vibration_hz: Positive | None = None
    ghosts: list[GhostTable] | None = None
    focus_drift_um: Finite | None = None
    focus_drift_s: Positive | None = None
    mount: MountTable = MountTable()

    def true_camera(self, nominal: Camera) -> Camera:
        """Return the true camera of a virtual bench.

        nominal: the camera that the bench file describes.
        Raises ValueError with the table that doesn't fit the camera.
        """
        panel = _with_table_in_errors("panel", lambda: self.panel.apply(nominal.panel))
        sensor = _with_table_in_errors("sensor", lambda: self.sensor.apply(nominal.sensor))
        seen = replace(nominal, panel=panel, sensor=sensor)
        true = _with_table_in_errors(
            "lens", lambda: replace(seen, lens=self.lens.apply(nominal.lens))
        )
        changes: dict[str, Any] = {
            "vibration": _times(self.vibration_um, 1e-6),
            "vibration_frequency": self.vibration_hz,
            "ghosts": None if self.ghosts is None else tuple(one.build() for one in self.ghosts),
            "focus_drift": _times(self.focus_drift_um, 1e-6),
            "focus_drift_time": self.focus_drift_s,
        }
        true = replace(true, **{k: v for k, v in changes.items() if v is not None})
        _with_table_in_errors("mount", lambda: self.mount.require_light(true))
        return true


def _times(value: float | None, unit: float) -> float | None:
    return None if value is None else value * unit


def _scale_rows(rows: Sequence[tuple[float, ...]] | None, *units: float) -> Any:
    """Return the numbers of each row times their units; whole numbers stay so by a unit of 1."""
    if rows is None:
        return None
    return tuple(tuple(n * unit for n, unit in zip(row, units, strict=True)) for row in rows)


def _with_table_in_errors(table: str, make: Callable[[], T]) -> T:
    """Add the name of a table in [truth] to the ValueErrors of a call."""
    try:
        return make()
    except ValueError as error:
        raise ValueError(f"table 'truth.{table}': {error}") from error
