"""List the ways to sum the light over a panel's pixels, and predict what each takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from optics.accuracy import CandidateMethod, MachineSpeed, ToleranceError
from optics.camera import Camera
from optics.camera.pupil import defocus_curvature, panel_half_diagonal, phase_step_per_pixel
from optics.fourier import (
    ChirpTransform,
    CommensurateTransform,
    FourierGeometry,
    GriddedTransform,
    MatrixTransform,
    valid_transforms,
)
from optics.fourier.gridded import FINEST_GRIDDING
from optics.fourier.transform import PlaneTransform
from optics.psf.interpolated_pixels import InterpolatedPixelTransform
from optics.psf.pixel_waves import (
    CurvedPixelTransform,
    PixelGrid,
    PixelIntegralTransform,
    envelope_shares,
    largest_coefficient,
)
from optics.psf.request import PSFRequest

PANEL_METHODS = (
    MatrixTransform.name,
    ChirpTransform.name,
    CommensurateTransform.name,
    GriddedTransform.name,
    CurvedPixelTransform.name,
    InterpolatedPixelTransform.name,
)
"""Names of the Fourier transforms behind a panel; not all of them serve every request."""

_MOST_PIXEL_PHASE_STEP = 600.0  # rad across a pixel; beyond, the blur is larger than any sensor
_MOST_ORDERS = 500.0  # diffraction orders of the pixels to a sample; rules then take a second
_MOST_DEGREES = 80  # of the wave's expansion inside a pixel; chosen

# Shares of the tolerance, all chosen.
_TRANSFORM_TOL_SHARE = 0.05  # for the Fourier transform
_INTERPOLATION_TOL_SHARE = 0.005  # for fitted weights: a further weight costs little
_EXPANSION_TOL_SHARE = 0.5  # for the terms left out, as predicted before a pattern is known

_LARGEST_INTERPOLATION_ERROR = 1e-3  # that is planned for; chosen
# L2 error that a transform reaches, over the one it states. It is an eighteenth where it was
# measured, for gridding to 1e-2 to 1e-8; this is three times as much.
_REACHED_TRANSFORM_ERROR = 0.17

# Predicted times, in passes (MachineSpeed.touch) and calls (MachineSpeed.call). All were fitted to
# 150 random problems on one machine, whose times they predict within a factor of two.
_PIXEL_PASSES = 58.0  # over the panel's pixels in a call: the pattern's phasor, the measured error
_TERM_PASSES = 26.0  # over the panel's pixels for each term, if the transform doesn't hold the wave
_SAMPLE_PASSES = 28.0  # over the samples at the sensor in a call
_NODE_PASSES = 120.0  # over nodes inside pixels, for the wave there in double precision
_OPEN_SHARE_PASSES = 50.0  # over the panel's pixels, for the share that the stop leaves open
_LINE_PASSES = 10_000.0  # for each row and column of pixels and samples: envelopes and rules
_PLANNING_CALLS = 18.0  # that planning costs at least
_DEGREE_CALLS = 3.0  # for each degree of the wave inside a pixel


@dataclass(frozen=True)
class PanelMethod(CandidateMethod):
    """Predicts memory and time of light behind a panel, by one transform and one expansion.

    grid: parts of the panel's pixels that are summed.
    degrees: degrees of the wave inside a part that are summed; 0 if the transform holds the wave.
    expansion_error: predicted relative L2 error of the light without the other degrees.
    node_count: nodes along a side of a part from which the expansion is computed.
    separable: whether the wave is a product over both axes.
    """

    transform: PlaneTransform
    grid: PixelGrid
    degrees: int = 0
    expansion_error: float = 0.0
    node_count: int = 1
    separable: bool = True

    @property
    def name(self) -> str:  # type: ignore[override]
        return self.transform.name

    @property
    def terms(self) -> int:
        """The number of terms of the wave in a pixel, each of which takes a transform."""
        return max(self.degrees * (self.degrees + 1) // 2, 1)

    @property
    def description(self) -> str:
        """What is summed over in each panel pixel, in words; empty for its centre."""
        parts = f", {self.grid.divisions}² parts in each" if self.grid.divisions > 1 else ""
        return parts + (f", {self.terms} terms of the wave" if self.terms > 1 else "")

    @property
    def reached_transform_error(self) -> float:
        """The relative L2 error of the field that the transform is taken to reach."""
        # Weights that are fitted reach what they state.
        exact = isinstance(self.transform, PixelIntegralTransform)
        return self.transform.error if exact else _REACHED_TRANSFORM_ERROR * self.transform.error

    @property
    def _panel_pixels(self) -> int:
        if isinstance(self.transform, InterpolatedPixelTransform):
            return math.prod(self.transform.field_shape)
        return math.prod(self.transform.geometry.pupil.shape)

    @property
    def bytes(self) -> int:
        kept = 2 if self.separable else 3 + self.terms + self.degrees
        return self.transform.bytes + kept * self.transform.dtype.itemsize * self._panel_pixels

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        rows, columns = self.transform.geometry.image.shape
        terms = self.terms if self.degrees else 0
        passes = self._panel_pixels * (_PIXEL_PASSES + terms * _TERM_PASSES)
        passes += rows * columns * _SAMPLE_PASSES
        sums = self.terms * self.transform.cpu_seconds(speed)
        return passes * speed.touch * speed.slowdown(self.transform.dtype) + sums

    def straight_seconds(self, speed: MachineSpeed) -> float:
        """Predict the seconds of light without a pattern, where it is a product over both axes."""
        rows, columns = self.transform.geometry.image.shape
        return 2 * speed.call + rows * columns * _SAMPLE_PASSES * speed.touch

    def planning_seconds(self, speed: MachineSpeed) -> float:
        geometry = self.transform.geometry
        passes = sum(geometry.pupil.shape + geometry.image.shape) * _LINE_PASSES
        passes += self._panel_pixels / self.grid.divisions**2 * _OPEN_SHARE_PASSES
        if not self.separable:
            passes += self._panel_pixels * self.node_count**2 * _NODE_PASSES
        calls = _PLANNING_CALLS + _DEGREE_CALLS * self.degrees
        return calls * speed.call + passes * speed.touch + self.transform.planning_seconds(speed)


class PanelSum:
    """Poses the sum over a panel's pixels to a tolerance, and lists the methods that keep it.

    camera: in plain numbers.
    tol: relative L2 error that is planned for.

    Raises ToleranceError where a pixel's wave turns too fast, or samples are too far away.
    """

    def __init__(self, request: PSFRequest, camera: Camera, tol: float, dtype: torch.dtype) -> None:
        n = request.numeric
        self._n, self._panel, self._tol, self._dtype = n, camera.panel, tol, dtype
        self._differentiable = request.differentiable
        self._separable = n.lens.has_quadratic_phase and n.sphere is None
        self._geometry = FourierGeometry(camera.panel.plane, n.samples, n.scale)
        self._curvature = defocus_curvature(n.lens, n.distance, n.wavelength)
        step = phase_step_per_pixel(camera, n.distance, n.wavelength)
        if n.sphere is not None:
            steepest = n.sphere.largest_phase_slope(panel_half_diagonal(camera))
            step += steepest * camera.panel.pitch
        if step > _MOST_PIXEL_PHASE_STEP:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept: the wave turns by {step:.2g} rad "
                "across a panel pixel",
                "bring the object closer to the plane in focus",
            )
        orders = n.farthest_sample_radius * camera.panel.active_side / n.scale
        if orders > _MOST_ORDERS:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept: the farthest pixel lies {orders:.3g} diffraction "
                f"orders of the panel from the axis, and {_MOST_ORDERS:g} are summed at "
                "most; ask for pixels nearer to the axis, or check the panel's pitch (in metres)"
            )
        self.half_turn = step / 2
        """Half of the largest phase change of the wave across a panel pixel, radians."""

    def methods(self, name: str | None) -> list[PanelMethod]:
        """List the ways to sum over all pixels: those worth planning, and the named one."""
        steps = (math.ceil(self.half_turn / h) for h in (0.5, 1, 2))
        methods = [
            method
            for divisions in sorted({1, *(max(1, step) for step in steps)})
            for method in self._methods_by_expansion(divisions, name)
        ]
        # The matrices for curved pixels contain the lens' wave and give no derivatives in it.
        if self._separable and not self._differentiable:
            curved = CurvedPixelTransform(
                self._geometry, self._dtype, self._curvature, self._panel.active_side
            )
            methods += [PanelMethod(curved, PixelGrid(self._panel)), *self.interpolated_methods()]
        return methods

    def interpolated_methods(self, *, mirrored: bool = False) -> list[PanelMethod]:
        """List the ways by FFTs and fitted weights; the only ones for a quarter of a pattern."""
        error = _INTERPOLATION_TOL_SHARE * self._tol
        one = InterpolatedPixelTransform(
            self._geometry,
            self._dtype,
            self._curvature,
            self._panel.active_side,
            min(error, _LARGEST_INTERPOLATION_ERROR),
            mirrored=mirrored,
        )
        return [PanelMethod(one, PixelGrid(self._panel))] if one.fits else []

    def _methods_by_expansion(self, divisions: int, name: str | None) -> list[PanelMethod]:
        """List the ways to sum by an expansion of the wave in parts of the pixels."""
        grid = PixelGrid(self._panel, divisions)
        degrees, error = self._needed_degrees(grid)
        if degrees > _MOST_DEGREES:
            return []
        nodes = 1 if self._separable or (degrees == 1 and divisions == 1) else degrees + 1
        allowed = max(_TRANSFORM_TOL_SHARE * self._tol, FINEST_GRIDDING)
        geometry = FourierGeometry(grid.points, self._n.samples, self._n.scale)
        offered = valid_transforms(geometry, self._dtype, allowed, to_few_samples=name is None)
        return [PanelMethod(one, grid, degrees, error, nodes, self._separable) for one in offered]

    def _needed_degrees(self, grid: PixelGrid) -> tuple[int, float]:
        """Return how many degrees of the wave in a pixel are needed, and the error left."""
        n, error = self._n, math.inf
        half_turn = self.half_turn / grid.divisions
        shares: tuple[list[float], list[float]] = [], []
        for degrees in range(1, _MOST_DEGREES + 1):
            sizes = [largest_coefficient(half_turn, k) for k in range(degrees + 1)]
            # Without this test, the envelopes would be evaluated for degrees far too low.
            if degrees > 1 and sizes[degrees] > 1:
                continue
            if len(shares[0]) <= degrees:
                shares = envelope_shares(n.samples, degrees + 8, grid.side, n.scale)
            y, x = shares
            pairs = [(degrees - k, k) for k in range(degrees + 1)]
            error = 2 * math.hypot(*(sizes[k] * sizes[m] * (y[k] * x[m]) for k, m in pairs))
            if error <= _EXPANSION_TOL_SHARE * self._tol:
                return degrees, error
        return _MOST_DEGREES + 1, error
