"""A PSF problem for a lens, or for a panel in the plane of its lens, with its reference.

The reference is the exact light on some of the samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.accuracy.references.coverage import open_area_shares
from labapp.accuracy.references.lens_integral import (
    lens_psf_density,
    node_count,
    pupil_phase,
    sample_positions,
)
from labapp.accuracy.references.samples import draw_samples
from optics.camera import Camera, Lens
from optics.plane import Plane
from optics.psf import METHODS, PANEL_METHODS, PSFOperator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PSFProblem:
    """A PSF problem that methods are compared on.

    optics: a camera whose panel stands in the plane of its lens, or a lens alone.
    distance, wavelength: metres.
    pixels: window on the sensor.
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
        """Return the exact light on some samples, drawn more often where `light` is bright.

        light: an approximate PSF.
        """
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
        """Return a PSF's weighted samples on the compared rows and columns.

        Their norm estimates that of the whole PSF.
        """
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
        """Return the share of light per square metre behind a panel in its lens's plane, (y, x).

        Every open pixel of the panel is a square of one modulation.
        """
        panel, lens, problem = camera.panel, camera.lens, self._problem
        scale, radius = problem.wavelength * lens.image_distance, lens.stop_diameter / 2
        nodes, weights = np.polynomial.legendre.leggauss(self._panel_nodes())
        inside, weights = nodes * panel.active_side / 2, weights * panel.active_side / 2
        amplitude = open_area_shares(lens.stop, radius, panel.plane)
        modulation = amplitude * np.exp(1j * phase)
        v, u = (sample_positions(panel.plane, axis) for axis in (0, 1))
        field = np.zeros((y.size, x.size), dtype=np.complex128)
        across = np.exp(-2j * np.pi / scale * np.outer((u[:, None] + inside).ravel(), x))
        for dv, weight in zip(inside, weights, strict=True):
            wave = np.repeat(modulation, inside.size, axis=1) * np.tile(weights, u.size)
            wave *= np.exp(1j * self._pupil_phases(v + dv, (u[:, None] + inside).ravel()))
            down = np.exp(-2j * np.pi / scale * np.outer(y, v + dv))
            field += weight * (down @ (wave @ across))
        power = amplitude.sum() * panel.active_side**2
        return np.asarray(np.abs(field) ** 2 / (scale**2 * power))

    def _pupil_phases(self, v: Array, u: Array) -> Array:
        problem, radius = self._problem, self._problem.lens.stop_diameter / 2
        rows = [
            pupil_phase(problem.lens, problem.distance, problem.wavelength, float(h), u / radius)
            for h in v / radius
        ]
        return np.stack(rows)


def window_corner_distance(problem: PSFProblem) -> float:
    """Return the distance from the axis to the window's farthest corner, in metres."""
    return math.hypot(*(np.abs(sample_positions(problem.pixels, axis)).max() for axis in (0, 1)))
