"""A PSF problem for a camera whose panel may stand apart from its lens, with its reference.

The reference is the exact light on some of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.accuracy.references.chain_integral import SETTINGS, chain_density, line_and_node_counts
from labapp.accuracy.references.panel_integral import ImagingChain, LowRankModulations
from labapp.accuracy.references.psf_problem import PSFProblem, PSFReference
from optics.camera import Camera
from optics.psf import CHAIN_METHODS, PSFOperator

Array = NDArray[np.float64]


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
            line += ranks * (2 * SETTINGS.nodes_per_cell + x.size)
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
