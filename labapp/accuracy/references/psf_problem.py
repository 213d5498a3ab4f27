"""PSF problems that methods are compared on, with their references.

A problem is that of a lens, of a panel in the plane of its lens, or of one apart from it. The
reference is the exact light on some of the samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.accuracy.references.chain_integral import (
    NODES_PER_CELL,
    chain_density,
    line_and_node_counts,
)
from labapp.accuracy.references.lens_integral import (
    lens_psf_density,
    node_count,
    open_area_shares,
    pupil_phase,
    sample_positions,
)
from labapp.accuracy.references.panel_integral import ImagingChain, LowRankModulations
from optics.camera import Camera, Lens
from optics.plane import Plane
from optics.psf import CHAIN_METHODS, METHODS, PANEL_METHODS, PSFOperator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PSFProblem:
    """A PSF problem of a lens, or of a panel in the plane of its lens, on a window of pixels.

    distance, wavelength: metres.
    integrate: whether the light is integrated over pixels, or taken at their centres.
    tol: requested relative L2 error.
    phase: on the panel, radians; None for a lens alone.
    """

    optics: Camera | Lens
    distance: float
    wavelength: float
    pixels: Plane
    integrate: bool
    tol: float
    phase: Array | None = None

    @property
    def lens(self) -> Lens:
        return self.optics.lens if isinstance(self.optics, Camera) else self.optics

    def operator(self, tol: float, **settings: Any) -> PSFOperator:
        return PSFOperator(
            self.optics,
            self.distance,
            self.wavelength,
            self.pixels,
            integrate=self.integrate,
            tol=tol,
            **settings,
        )

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the methods that are measured."""
        return PANEL_METHODS if isinstance(self.optics, Camera) else METHODS

    def light(self, operator: PSFOperator) -> Array:
        """Return the PSF that an operator computes, in double precision."""
        answer: Any = operator(None if self.phase is None else torch.from_numpy(self.phase))
        return np.asarray(answer, dtype=np.float64)

    def build_reference(self, light: Array) -> PSFReference:
        """Return exact light on samples, drawn more often where an approximate PSF is bright."""
        return PSFReference(self, light)


class PSFReference:
    """The exact light on some rows and columns of a PSF problem.

    Half of the rows and columns are drawn in proportion to their light and half evenly. They are
    weighted by the inverse of their probabilities, so that errors estimate those of the whole
    window.
    """

    def __init__(self, problem: PSFProblem, light: Array) -> None:
        self._problem = problem
        self._nodes = self._pixel_quadrature_nodes()
        # At most 8 rows and 8 columns are compared, and half of that if pixels are integrated.
        count = max(2, 8 // (1 if self._nodes.size == 1 else 2))
        rng = np.random.default_rng(1)
        self._rows, self._row_weight = draw_samples(rng, np.abs(light).sum(1), count)
        self._columns, self._column_weight = draw_samples(rng, np.abs(light).sum(0), count)

    def _pixel_quadrature_nodes(self) -> Array:
        """Return the nodes along an axis of a sensor pixel, in pixels."""
        if not self._problem.integrate:
            return np.zeros(1)
        lens, pitch = self._problem.lens, max(self._problem.pixels.pitch)
        cutoff = lens.stop_diameter / (self._problem.wavelength * lens.image_distance)
        return np.polynomial.legendre.leggauss(math.ceil(0.7 * math.pi * cutoff * pitch) + 8)[0] / 2

    @property
    def product_count(self) -> float:
        """Estimated number of products that the exact light takes."""
        problem, side = self._problem, self._columns.size * self._nodes.size
        if isinstance(problem.optics, Camera):
            shape = problem.optics.panel.shape
            # Phases cost most; the sums are fast products of matrices.
            return float(np.prod(shape)) * self._panel_nodes() ** 2 * (1 + side / 10)
        corner = window_corner_distance(problem)
        return node_count(problem.lens, problem.distance, problem.wavelength, corner) * side

    def error(self, light: Array) -> float:
        """Return the relative L2 error of a PSF, (rows, columns)."""
        return float(
            np.linalg.norm(self.weighted_samples(light) - self.exact_samples)
            / np.linalg.norm(self.exact_samples)
        )

    def weighted_samples(self, light: Array) -> Array:
        """Return a PSF's compared samples, weighted so that their norm estimates that of all."""
        return self._apply_weights(light[np.ix_(self._rows, self._columns)])

    def _apply_weights(self, samples: Array) -> Array:
        return np.sqrt(np.outer(self._row_weight, self._column_weight)) * samples

    @cached_property
    def exact_samples(self) -> Array:
        """The exact light as `weighted_samples` would give it."""
        pixels, y, x = self._problem.pixels, *self._node_positions()
        density = self.density(y, x)
        count = self._nodes.size
        weights = np.ones(1)
        if self._problem.integrate:
            weights = np.polynomial.legendre.leggauss(count)[1] / 2
        blocks = density.reshape(self._rows.size, count, self._columns.size, count)
        area = pixels.pitch[0] * pixels.pitch[1]
        return self._apply_weights(np.einsum("iajb,a,b->ij", blocks, weights, weights) * area)

    def _node_positions(self) -> tuple[Array, Array]:
        """Return y and x of all nodes in the compared pixels, in metres."""
        pixels = self._problem.pixels
        y, x = (
            (
                sample_positions(pixels, axis)[chosen][:, None] + self._nodes * pixels.pitch[axis]
            ).ravel()
            for axis, chosen in ((0, self._rows), (1, self._columns))
        )
        return y, x

    def density(self, y: Array, x: Array) -> Array:
        """Return exact shares of the light per square metre at y and x, (y, x)."""
        problem = self._problem
        if isinstance(problem.optics, Lens):
            return lens_psf_density(problem.optics, problem.distance, problem.wavelength, y, x)
        camera = problem.optics
        assert problem.phase is not None
        share = camera.panel.unmodulated
        modulated = self.density_behind_panel(camera, problem.phase, y, x)
        straight = self.density_behind_panel(camera, np.zeros(camera.panel.shape), y, x)
        return (1 - share) * modulated + share * straight

    def _panel_nodes(self) -> int:
        """Return how many Gauss-Legendre nodes across a panel pixel are needed."""
        problem = self._problem
        assert isinstance(problem.optics, Camera)
        panel, lens = problem.optics.panel, problem.lens
        reach = min(lens.stop_diameter / 2, math.hypot(*panel.shape) * panel.pitch / 2)
        vergence = abs(1 / problem.distance - 1 / lens.focus_distance)
        far = max(float(np.abs(sample_positions(problem.pixels, axis)).max()) for axis in (0, 1))
        waves = (vergence * reach + far / lens.image_distance) / problem.wavelength * panel.pitch
        aberrated = sum(abs(path) for _, _, path in lens.aberrations) / problem.wavelength
        waves += 30 * aberrated * panel.pitch / (lens.stop_diameter / 2)
        return math.ceil(2 * waves) + 6

    def density_behind_panel(self, camera: Camera, phase: Array, y: Array, x: Array) -> Array:
        """Return the light per square metre behind a panel of square pixels at its lens, (y, x)."""
        panel, lens, problem = camera.panel, camera.lens, self._problem
        scale, radius = problem.wavelength * lens.image_distance, lens.stop_diameter / 2
        nodes, weights = np.polynomial.legendre.leggauss(self._panel_nodes())
        inside, weights = nodes * panel.active_side / 2, weights * panel.active_side / 2
        amplitude = open_area_shares(lens.stop, radius, panel.plane)
        modulation = np.repeat(amplitude * np.exp(1j * phase), inside.size, axis=1)
        v, u = (sample_positions(panel.plane, axis) for axis in (0, 1))
        field = np.zeros((y.size, x.size), dtype=np.complex128)
        u = (u[:, None] + inside).ravel()
        across = np.exp(-2j * np.pi / scale * np.outer(u, x))
        for dv, weight in zip(inside, weights, strict=True):
            wave = modulation * np.tile(weights, panel.shape[1])
            heights = (v + dv) / radius
            rows = [
                pupil_phase(lens, problem.distance, problem.wavelength, float(h), u / radius)
                for h in heights
            ]
            wave *= np.exp(1j * np.stack(rows))
            down = np.exp(-2j * np.pi / scale * np.outer(y, v + dv))
            field += weight * (down @ (wave @ across))
        power = amplitude.sum() * panel.active_side**2
        return np.asarray(np.abs(field) ** 2 / (scale**2 * power))


def window_corner_distance(problem: PSFProblem) -> float:
    """Return the distance from the axis to the window's farthest corner, in metres."""
    return math.hypot(*(np.abs(sample_positions(problem.pixels, axis)).max() for axis in (0, 1)))


@dataclass(frozen=True)
class ChainProblem(PSFProblem):
    """A PSF problem for a camera whose panel may stand apart from its lens.

    off_axis: position (y, x) of the point's image on the sensor, from the axis, metres.
    sphere: whether the wave of the point is an exact sphere instead of a parabola.
    """

    off_axis: tuple[float, float] = (0.0, 0.0)
    sphere: bool = False

    @property
    def camera(self) -> Camera:
        assert isinstance(self.optics, Camera)
        return self.optics

    @property
    def chain(self) -> ImagingChain:
        return ImagingChain(self.camera, self.distance, self.wavelength, self.off_axis, self.sphere)

    @property
    def methods(self) -> tuple[str, ...]:
        return CHAIN_METHODS if self.camera.separation else super().methods

    def operator(self, tol: float, **settings: Any) -> PSFOperator:
        return super().operator(tol, field=self.off_axis, sphere=self.sphere, **settings)

    def build_reference(self, light: Array) -> PSFReference:
        return ChainReference(self, light) if self.camera.separation else PSFReference(self, light)

    @property
    def description(self) -> str:
        """The problem in one line, for reports."""
        camera, lens, pixels = self.camera, self.lens, self.pixels
        rows, columns = camera.panel.shape
        return (
            f"{rows}x{columns} of {camera.panel.pitch * 1e6:.3g} µm, fill "
            f"{camera.panel.fill_factor:.2f}, z1 {camera.separation * 1e3:.3g} mm, "
            f"{lens.focal_length * 1e3:.3g} mm f/{lens.f_number:.3g} (stop "
            f"{lens.stop_diameter * 1e3:.3g} mm, {lens.kind}), focus {lens.focus_distance:.3g} m, "
            f"d {self.distance:.3g} m, {self.wavelength * 1e9:.0f} nm, field "
            f"{self.off_axis[0] * 1e3:.3g}, {self.off_axis[1] * 1e3:.3g} mm, window "
            f"{pixels.shape[0]}x{pixels.shape[1]} of {pixels.pitch[0] * 1e6:.3g} µm, integrate "
            f"{self.integrate}, sphere {self.sphere}, aberrations {len(lens.aberrations)}, "
            f"tol {self.tol:.1e}"
        )


class ChainReference(PSFReference):
    """The exact light of a chain on some rows and columns of the window."""

    _problem: ChainProblem

    @property
    def product_count(self) -> float:
        """Estimated number of products that the exact light takes."""
        # Costs of a Fresnel integral, of an exponential, and of a line besides both, as the number
        # of products that take the same time.
        fresnel_cost, exponential_cost, line_cost = 1000, 500, 2e6
        (y, x), problem = self._node_positions(), self._problem
        lines, nodes = line_and_node_counts(problem.chain, y, x)
        rows, columns = problem.camera.panel.shape
        ranks = LowRankModulations(self._modulations()).left.shape[1]
        if problem.sphere:
            inside = problem.chain.nodes_per_pixel
            rows, columns, ranks = rows * inside, columns * inside, ranks * inside
            place = exponential_cost
        else:
            place = 2 * fresnel_cost
        line = rows * (ranks + place) + line_cost
        if problem.lens.has_quadratic_phase:
            line += ranks * (2 * NODES_PER_CELL + x.size)
        else:
            line += nodes * (ranks + x.size + exponential_cost)
        return lines * line + nodes * columns * place

    def _modulations(self) -> list[NDArray[np.complex128]]:
        """Return the pattern's modulation, and then that of unmodulated light, if there is any."""
        assert self._problem.phase is not None
        shown = np.exp(1j * self._problem.phase)
        return [shown, np.ones_like(shown)] if self._problem.camera.panel.unmodulated else [shown]

    def density(self, y: Array, x: Array) -> Array:
        """Return exact shares of the light at y and x, (y, x), per m²."""
        share = self._problem.camera.panel.unmodulated
        found = chain_density(self._problem.chain, self._modulations(), y, x)
        return np.asarray((1 - share) * found[0] + share * found[-1])


def draw_samples(
    rng: np.random.Generator, light: Array, count: int
) -> tuple[NDArray[np.int64], Array]:
    """Draw samples of a picture's light; return flat indices and weights.

    Half of a sample's probability is in proportion to its light, and half the same for all. Weights
    are the inverse probabilities: a weighted sum over the drawn samples estimates that over all.
    """
    light = light.ravel()
    if light.size <= count:
        return np.arange(light.size), np.ones(light.size)
    chance = np.full(light.size, 1 / light.size)
    if light.sum() > 0:
        chance = 0.5 * chance + 0.5 * light / light.sum()
    chosen = rng.choice(light.size, count, p=chance / chance.sum())
    return chosen, 1 / chance[chosen]
