"""The patterns of a plan file that are formulas: keys and units, and the phase they stand for.

What computes a phase is imported when one is asked for, so that plans are read and kinds are
listed without it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from labapp.files.reading import FileModel
from optics.zernike_order import require_zernike

if TYPE_CHECKING:
    import torch

    from optics.camera import Camera

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=100_000)]

Angle = Annotated[Finite, Field(description="direction, from x towards y")]


class PhasePattern(FileModel):
    """Waves that a pattern is made for; how many of the panel's whole waves it may use."""

    smooth: ClassVar[bool] = True
    """Whether its slope counts when it is added to others."""

    wavelength_nm: Annotated[Positive, Field(description="that it is made for")] = 550
    orders: Annotated[
        int, Field(ge=1, le=16, description="whole waves of the panel's range to use")
    ] = 1

    @property
    def wavelength(self) -> float:
        """In metres."""
        return self.wavelength_nm * 1e-9

    @property
    def varies(self) -> bool:
        """Whether another seed makes another pattern."""
        return False

    @property
    def label(self) -> str:
        """What it is called on the screen and in records: what it is, and its sizes."""
        return f"{self.sizes} for {self.wavelength_nm:g} nm"

    @property
    def sizes(self) -> str:
        """What it is and how large, in a few words."""
        raise NotImplementedError

    def quick(self) -> PhasePattern:
        """The same with as little work as shows whether it can be computed."""
        return self


class FormulaPattern(PhasePattern):
    """A pattern whose phase is known at once."""

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        """Radians on the camera's panel, (rows, columns); ValueError if it can't be shown."""
        raise NotImplementedError


class LensPattern(FormulaPattern):
    """A Fresnel lens of a focal length; negative diverges."""

    kind: Literal["lens"]
    focal_length_m: Annotated[Finite, Field(description="negative diverges")]
    centre_mm: Annotated[
        tuple[Finite, Finite], Field(description="y and x of its centre on the panel")
    ] = (0.0, 0.0)

    @property
    def sizes(self) -> str:
        return f"lens {self.focal_length_m:g} m"

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        y, x = self.centre_mm
        centre = (y * 1e-3, x * 1e-3)
        return patterns.fresnel_lens(camera.panel, self.focal_length_m, self.wavelength, centre)


class AxiconPattern(FormulaPattern):
    """A cone that sends a point to a ring of a radius on the sensor."""

    kind: Literal["axicon"]
    radius_um: Annotated[Positive, Field(description="of the ring on the sensor")]

    @property
    def sizes(self) -> str:
        return f"axicon {self.radius_um:g} µm"

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        distance = camera.lever
        return patterns.axicon(camera.panel, self.radius_um * 1e-6, distance, self.wavelength)


class CubicPattern(FormulaPattern):
    """A cubic phase, which extends the depth of field (thesis section 2.5)."""

    kind: Literal["cubic"]
    strength_rad: Annotated[Finite, Field(description="phase at the radius, along an axis")] = 60.0
    radius_mm: Annotated[
        Positive | None, Field(description="on the panel; none: half its longer side")
    ] = None

    @property
    def sizes(self) -> str:
        return f"cubic {self.strength_rad:g} rad"

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        return patterns.cubic(camera.panel, self.strength_rad, _metres(self.radius_mm))


class AnnularPattern(FormulaPattern):
    """Rings with a parabola across each, which extend the depth of field (thesis section 5.6)."""

    kind: Literal["annular"]
    rings: Annotated[Count, Field(description="how many")] = 8
    depth_rad: Annotated[Finite, Field(description="phase in the middle of a ring")] = 2 * math.pi
    radius_mm: Annotated[
        Positive | None, Field(description="of the last ring; none: to the panel's corners")
    ] = None

    @property
    def sizes(self) -> str:
        return f"annular {self.rings} rings of {self.depth_rad:.3g} rad"

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        radius = _metres(self.radius_mm)
        return patterns.annular(camera.panel, self.rings, self.depth_rad, radius)


class BlazePattern(FormulaPattern):
    """A blazed grating: all light goes to one side, by a shift or by the grating's period."""

    kind: Literal["blaze"]
    shift_um: Annotated[
        tuple[Finite, Finite] | None, Field(description="y and x on the sensor; or period_px")
    ] = None
    period_px: Annotated[Positive | None, Field(description="of the panel, a wave")] = None
    angle_deg: Annotated[Finite, Field(description="of period_px, from x towards y")] = 0.0

    @model_validator(mode="after")
    def _one_way(self) -> BlazePattern:
        if (self.shift_um is None) == (self.period_px is None):
            raise ValueError("a blaze has either shift_um or period_px")
        return self

    @property
    def sizes(self) -> str:
        if self.shift_um is None:
            return f"blaze {self.period_px:g} px at {self.angle_deg:g}°"
        y, x = self.shift_um
        return f"blaze to {y:g}, {x:g} µm"

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        if self.shift_um is None:
            assert self.period_px is not None
            angle = math.radians(self.angle_deg)
            return patterns.blazed_grating(camera.panel, self.period_px, angle)
        y, x = self.shift_um
        distance = camera.lever
        return patterns.steered(camera.panel, (y * 1e-6, x * 1e-6), distance, self.wavelength)


class BinaryPattern(FormulaPattern):
    """Stripes of two phases: half a wave splits the light in two."""

    kind: Literal["binary"]
    smooth: ClassVar[bool] = False
    period_px: Annotated[float, Field(ge=2, le=1e6, description="of both stripes")] = 16.0
    step_rad: Annotated[Finite, Field(description="between the stripes")] = math.pi
    angle_deg: Angle = 0.0

    @property
    def sizes(self) -> str:
        return f"binary {self.period_px:g} px, {self.step_rad:.3g} rad"

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        angle = math.radians(self.angle_deg)
        return patterns.binary_grating(camera.panel, self.period_px, self.step_rad, angle)


class SinePattern(FormulaPattern):
    """A wave of phase: low with a long period, high with a short one (thesis section 6.4)."""

    kind: Literal["sine"]
    amplitude_rad: Annotated[Finite, Field(description="from the mean to a crest")] = math.pi
    period_px: Annotated[float, Field(ge=4, le=1e6, description="of the panel, a wave")] = 120.0
    angle_deg: Angle = 0.0

    @property
    def sizes(self) -> str:
        return f"sine {self.period_px:g} px, {self.amplitude_rad:.3g} rad"

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        angle = math.radians(self.angle_deg)
        return patterns.sine(camera.panel, self.amplitude_rad, self.period_px, angle)


class PatchesPattern(FormulaPattern):
    """Rectangles of random phase (thesis section 6.4)."""

    kind: Literal["patches"]
    smooth: ClassVar[bool] = False
    rows: Annotated[Count, Field(description="of patches")] = 9
    columns: Annotated[Count, Field(description="of patches")] = 16
    depth_rad: Annotated[Positive, Field(description="phases lie between 0 and this")] = 2 * math.pi

    @property
    def varies(self) -> bool:
        return True

    @property
    def sizes(self) -> str:
        return f"patches {self.columns}x{self.rows}, {self.depth_rad:.3g} rad"

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        grid = (self.rows, self.columns)
        return patterns.random_patches(camera.panel, grid, generator, self.depth_rad)


class ZernikePattern(FormulaPattern):
    """Aberrations by their Zernike polynomials; negative ones undo the lens' own."""

    kind: Literal["zernike"]
    terms: Annotated[
        tuple[tuple[int, int, Finite], ...],
        Field(min_length=1, description="n, m and root mean square in nm of path"),
    ]
    radius_mm: Annotated[
        Positive | None, Field(description="of the disc; none: the stop's, or the panel's corners")
    ] = None

    @field_validator("terms")
    @classmethod
    def _exist(cls, terms: Sequence[tuple[int, int, float]]) -> Sequence[tuple[int, int, float]]:
        for n, m, _ in terms:
            require_zernike(n, m)
        return terms

    @property
    def sizes(self) -> str:
        return "zernike " + ", ".join(f"({n}, {m}) {path:g} nm" for n, m, path in self.terms)

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns
        from optics.shadow import shadowed

        terms = [(n, m, path * 1e-9) for n, m, path in self.terms]
        corner = math.hypot(*camera.panel.shape) * camera.panel.pitch / 2
        stop = shadowed(camera).lens.stop_diameter / 2
        radius = _metres(self.radius_mm) or min(stop, corner)
        return patterns.aberrated(camera.panel, terms, radius, self.wavelength)


def _metres(millimetres: float | None) -> float | None:
    return None if millimetres is None else millimetres * 1e-3
