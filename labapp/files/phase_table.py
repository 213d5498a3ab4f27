"""Patterns of a plan whose phase is given by a formula, or as a ring to reach.

The modules that compute a phase are imported only when one is computed, so that reading plans and
listing the kinds of patterns stay fast.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from annotated_types import Ge, Le, MinLen

from labapp.files.table import Count, Key, Nanometres, Positive, Table
from labapp.files.target_table import RingTarget
from optics.zernike_order import require_zernike_indices

if TYPE_CHECKING:
    import torch

    from optics.camera import Camera

Iterations = Annotated[int, Ge(1), Le(10_000)]
OuterRadius = Annotated[
    Positive | None, Key("on the panel; none: the stop's, or the panel's corners")
]


class PhasePattern(Table):
    """A pattern of a plan file that is given as a phase at a wavelength.

    orders is the number of whole waves of the panel's range that it may use.
    """

    smooth: ClassVar[bool] = True
    """Whether the phase is smooth, so that its slope is limited when patterns are added."""

    wavelength_nm: Annotated[Nanometres, Key("that it is made for")] = 550
    orders: Annotated[int, Ge(1), Le(16), Key("whole waves of the panel's range to use")] = 1

    @property
    def wavelength(self) -> float:
        """Wavelength that the pattern is made for, metres."""
        return self.wavelength_nm * 1e-9

    @property
    def depends_on_seed(self) -> bool:
        """Whether the phase depends on the plan's seed."""
        return False

    @property
    def label(self) -> str:
        """The description on the screen and in records: kind and sizes."""
        return f"{self.summary} for {self.wavelength_nm:g} nm"

    def with_least_work(self) -> PhasePattern:
        """Reduce the work to what shows whether the pattern can be computed."""
        return self


class FormulaPattern(PhasePattern):
    """A pattern whose phase is given by a formula, without iterations."""

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        """Return the phase on the panel, (rows, columns), radians.

        Raises ValueError if the panel can't show it.
        """
        raise NotImplementedError


class LensPattern(FormulaPattern):
    """A Fresnel lens of a focal length; negative diverges."""

    title: ClassVar = "Fresnel lens"
    summary_template: ClassVar = "lens {focal_length_m:g} m"
    kind: Literal["lens"]
    focal_length_m: Annotated[float, Key("negative diverges", "Focal length", 20, -1000, 1000)]
    centre_mm: Annotated[tuple[float, float], Key("y and x of its centre on the panel")] = (
        0.0,
        0.0,
    )

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        y, x = self.centre_mm
        centre = (y * 1e-3, x * 1e-3)
        return patterns.fresnel_lens(camera.panel, self.focal_length_m, self.wavelength, centre)


class AxiconPattern(FormulaPattern):
    """An axicon, a cone of phase whose PSF is a ring on the sensor."""

    title: ClassVar = "Axicon"
    summary_template: ClassVar = "axicon {radius_um:g} µm"
    kind: Literal["axicon"]
    radius_um: Annotated[Positive, Key("of the ring on the sensor", "Radius", 80, 1, 5000)]

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        distance = camera.ray_matrix_b
        return patterns.axicon(camera.panel, self.radius_um * 1e-6, distance, self.wavelength)


class CubicPattern(FormulaPattern):
    """A cubic phase, which extends the depth of field (thesis section 2.5)."""

    title: ClassVar = "Cubic"
    summary_template: ClassVar = "cubic {strength_rad:g} rad"
    kind: Literal["cubic"]
    strength_rad: Annotated[float, Key("phase at the radius, along an axis", "Strength", 60)] = 60.0
    radius_mm: Annotated[Positive | None, Key("on the panel; none: half its longer side")] = None

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        return patterns.cubic_phase_mask(camera.panel, self.strength_rad, _metres(self.radius_mm))


class AnnularPattern(FormulaPattern):
    """Rings with a parabola across each, which extend the depth of field (thesis section 5.6)."""

    title: ClassVar = "Annular"
    summary_template: ClassVar = "annular {rings} rings of {depth_rad:.3g} rad"
    kind: Literal["annular"]
    rings: Annotated[Count, Key("how many", "Rings", 8, 1, 500)] = 8
    depth_rad: Annotated[float, Key("phase in the middle of a ring", "Depth", 6.28)] = 2 * math.pi
    radius_mm: Annotated[Positive | None, Key("of the last ring; none: to the panel's corners")] = (
        None
    )

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        radius = _metres(self.radius_mm)
        return patterns.annular_phase_mask(camera.panel, self.rings, self.depth_rad, radius)


class LogarithmicPattern(FormulaPattern):
    """A logarithmic asphere, in focus from a near object to a far one (George and Chi 2003)."""

    title: ClassVar = "Logarithmic asphere"
    summary_template: ClassVar = "logarithmic {near_m:g} to {far_m:g} m"
    kind: Literal["logarithmic"]
    near_m: Annotated[Positive, Key("in focus by the middle of the panel", "Near", 1.8, 0.1, 1000)]
    far_m: Annotated[Positive, Key("in focus at the radius", "Far", 2.2, 0.1, 1000)]
    radius_mm: OuterRadius = None

    def __post_init__(self) -> None:
        if not self.near_m < self.far_m:
            raise ValueError(f"far_m is {self.far_m:g}; it must be more than near_m")

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns
        from optics.camera.pupil import panel_to_focus_distance

        radius = outer_radius(self.radius_mm, camera)
        distances = (self.near_m, self.far_m, panel_to_focus_distance(camera))
        return patterns.logarithmic_asphere(camera.panel, *distances, self.wavelength, radius)


class BlazePattern(FormulaPattern):
    """A blazed grating, which sends all light to one side; give the shift or the period."""

    title: ClassVar = "Blazed grating"
    kind: Literal["blaze"]
    shift_um: Annotated[tuple[float, float] | None, Key("y and x on the sensor; or period_px")] = (
        None
    )
    period_px: Annotated[Positive | None, Key("of the panel, a wave", "Period", 40, 1)] = None
    angle_deg: Annotated[
        float, Key("of period_px, from x towards y", "Direction", 0, -360, 360)
    ] = 0.0

    def __post_init__(self) -> None:
        if (self.shift_um is None) == (self.period_px is None):
            raise ValueError("a blaze has either shift_um or period_px")

    @property
    def summary(self) -> str:
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
        distance = camera.ray_matrix_b
        return patterns.steering_grating(
            camera.panel, (y * 1e-6, x * 1e-6), distance, self.wavelength
        )


class BinaryPattern(FormulaPattern):
    """A binary grating of two phases; a step of half a wave splits the light in two."""

    summary_template: ClassVar = "binary {period_px:g} px, {step_rad:.3g} rad"
    kind: Literal["binary"]
    smooth: ClassVar[bool] = False
    period_px: Annotated[float, Ge(2), Le(1e6), Key("of both stripes")] = 16.0
    step_rad: Annotated[float, Key("between the stripes")] = math.pi
    angle_deg: Annotated[float, Key("direction, from x towards y")] = 0.0

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        angle = math.radians(self.angle_deg)
        return patterns.binary_grating(camera.panel, self.period_px, self.step_rad, angle)


class SinePattern(FormulaPattern):
    """A sine wave of phase, of low or high spatial frequency (thesis section 6.4)."""

    title: ClassVar = "Sine"
    summary_template: ClassVar = "sine {period_px:g} px, {amplitude_rad:.3g} rad"
    kind: Literal["sine"]
    amplitude_rad: Annotated[float, Key("from the mean to a crest", "Amplitude", 3.14, 0)] = math.pi
    period_px: Annotated[float, Ge(4), Le(1e6), Key("of the panel, a wave", "Period", 120, 4)] = (
        120.0
    )
    angle_deg: Annotated[float, Key("from x towards y", "Direction", 0, -360, 360)] = 0.0

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        angle = math.radians(self.angle_deg)
        return patterns.sine_grating(camera.panel, self.amplitude_rad, self.period_px, angle)


class PatchesPattern(FormulaPattern):
    """Rectangles of random phase (thesis section 6.4)."""

    title: ClassVar = "Random patches"
    summary_template: ClassVar = "patches {columns}x{rows}, {depth_rad:.3g} rad"
    kind: Literal["patches"]
    smooth: ClassVar[bool] = False
    rows: Annotated[Count, Key("of patches", "Rows", 9, 1, 4096)] = 9
    columns: Annotated[Count, Key("of patches", "Columns", 16, 1, 4096)] = 16
    depth_rad: Annotated[Positive, Key("phases lie between 0 and this")] = 2 * math.pi

    @property
    def depends_on_seed(self) -> bool:
        return True

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        grid = (self.rows, self.columns)
        return patterns.random_patches(camera.panel, grid, generator, self.depth_rad)


class ZernikePattern(FormulaPattern):
    """Aberrations as Zernike polynomials, which can cancel those of the lens."""

    title: ClassVar = "Aberrations"
    kind: Literal["zernike"]
    terms: Annotated[
        tuple[tuple[int, int, float], ...],
        MinLen(1),
        Key("n, m and root mean square in nm of path"),
    ]
    radius_mm: Annotated[
        Positive | None, Key("of the disc; none: the stop's, or the panel's corners")
    ] = None

    def __post_init__(self) -> None:
        for n, m, _ in self.terms:
            require_zernike_indices(n, m)

    @property
    def summary(self) -> str:
        return "zernike " + ", ".join(f"({n}, {m}) {path:g} nm" for n, m, path in self.terms)

    def phase(self, camera: Camera, generator: torch.Generator) -> torch.Tensor:
        from optics import patterns

        terms = [(n, m, path * 1e-9) for n, m, path in self.terms]
        radius = outer_radius(self.radius_mm, camera)
        return patterns.zernike_pattern(camera.panel, terms, radius, self.wavelength)


class RingPattern(PhasePattern):
    """A pattern whose PSF is a ring, by the Gerchberg-Saxton method. Sizes are on the sensor."""

    title: ClassVar = "Ring"
    smooth: ClassVar[bool] = False
    summary_template: ClassVar = "ring {radius_um:g}/{width_um:g} µm"
    kind: Literal["ring"]
    radius_um: Annotated[Positive, Key("of the ring on the sensor", "Radius", 80, 1, 2000)]
    width_um: Annotated[Positive, Key("standard deviation of its profile", "Width", 8, 0.5, 500)]
    iterations: Annotated[Iterations, Key("of Gerchberg-Saxton")] = 30
    start: Annotated[Literal["quadratic", "random"], Key("phase that iterations start from")] = (
        "quadratic"
    )

    @property
    def depends_on_seed(self) -> bool:
        return self.start == "random"

    @property
    def target(self) -> RingTarget:
        return RingTarget(shape="ring", radius_um=self.radius_um, width_um=self.width_um)

    def with_least_work(self) -> RingPattern:
        return replace(self, iterations=1)


def _metres(millimetres: float | None) -> float | None:
    return None if millimetres is None else millimetres * 1e-3


def outer_radius(millimetres: float | None, camera: Camera) -> float:
    """Return a round pattern's outer radius, metres; by default that of the light on the panel."""
    return illuminated_radius(camera) if millimetres is None else millimetres * 1e-3


def illuminated_radius(camera: Camera) -> float:
    """Return the radius in metres of the disc on the panel whose light passes the stop.

    It is at most the distance of the panel's corners.
    """
    from optics.camera.pupil import with_stop_shadow_on_panel

    corner = math.hypot(*camera.panel.shape) * camera.panel.pitch / 2
    return min(with_stop_shadow_on_panel(camera).lens.stop_diameter / 2, corner)
