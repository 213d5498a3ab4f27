"""Compute the Fourier integral over panel pixels, inside which a lens' wave is curved."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import MachineSpeed
from optics.camera import Panel
from optics.camera.pupil import Scalar, defocus_curvature, pupil_phase
from optics.camera.stop_nodes import gauss_node_count
from optics.fourier import FourierGeometry, MatrixTransform, unit_phasor
from optics.fourier.transform import PASSES_PER_PHASOR, PlaneTransform
from optics.gauss_legendre import gauss_legendre
from optics.plane import Plane, RectilinearGrid
from optics.psf.phase_factor import phase_factor
from optics.psf.request import PSFRequest
from optics.validation import records_gradient

Array = NDArray[np.float64]

_BLOCK_POINTS = 1 << 18  # points of the wave that are computed at a time


@dataclass(frozen=True)
class WaveTerm:
    """Holds one term of the wave in panel pixels: P_k(y) P_l(x) times a factor per pixel.

    envelopes: of the term's field on the samples, along y and x (see `pixel_envelopes`).
    column: the factor, complex, (rows, columns), or (rows, 1) if `row` holds the rest.
    row: (columns,), by which `column` is multiplied, or None.
    """

    envelopes: tuple[torch.Tensor, torch.Tensor]
    column: torch.Tensor
    row: torch.Tensor | None = None

    def under_envelope(
        self, field: torch.Tensor, rows: slice | torch.Tensor = slice(None)
    ) -> torch.Tensor:
        """Multiply the term's field on some rows of the samples by its envelope."""
        y, x = (one.to(field) for one in self.envelopes)
        return field * y[rows, None] * x

    def times(self, field: torch.Tensor) -> torch.Tensor:
        """Multiply a field on the panel by the term, (..., rows, columns)."""
        column = self.column.to(field.device)
        if self.row is None:
            return field * column
        row = self.row.to(field.device)
        if records_gradient(field, column, row) or field.ndim != 2:
            return field * column * row
        product = torch.empty_like(field)
        # Blocks of rows fit in the cache.
        step = max(1, _BLOCK_POINTS // (4 * field.shape[1]))
        for start in range(0, field.shape[0], step):
            part = slice(start, start + step)
            factor = column[part] if column.shape[0] > 1 else column
            torch.mul(field[part], factor, out=product[part])
            product[part] *= row
        return product

    def project(self, kernel: torch.Tensor, field: torch.Tensor) -> torch.Tensor:
        """Multiply a matrix (n, rows) by the product of the term and a field."""
        if self.row is None:
            return kernel @ self.times(field)
        column = self.column[:, 0].to(field.device)
        return ((kernel * column) @ field) * self.row.to(field.device)


@dataclass(frozen=True)
class PixelGrid:
    """Divides the active square of every panel pixel into `divisions`² equal squares."""

    panel: Panel
    divisions: int = 1

    @property
    def side(self) -> float:
        """The side of a square, metres."""
        return self.panel.active_side / self.divisions

    @property
    def points(self) -> Plane | RectilinearGrid:
        """The centres of all squares."""
        if self.divisions == 1:
            return self.panel.plane
        index = torch.arange(self.divisions, dtype=torch.float64)
        inside = (index - (self.divisions - 1) / 2) * self.side
        y, x = ((self.panel.plane.coordinates(axis)[:, None] + inside).ravel() for axis in (0, 1))
        return RectilinearGrid(y, x)

    def repeat(self, values: torch.Tensor) -> torch.Tensor:
        """Repeat each panel pixel's value for all squares in the pixel."""
        if self.divisions == 1:
            return values
        return values.repeat_interleave(self.divisions, -2).repeat_interleave(self.divisions, -1)


class PixelWaveExpansion:
    """Expands the wave of a point and its lens inside each panel pixel in Legendre polynomials.

    In a pixel with its centre at p and an active square of `side` metres,

        wave(p + side t / 2) = sum over (k, l) of b_kl(p) P_k(t_y) P_l(t_x),   -1 <= t <= 1.

    The Fourier integral over the pixels then is a sum of transforms of b_kl times the pattern, each
    under an envelope of its own (`pixel_envelopes`). If the phase changes by s radians across a
    pixel, terms of degree n = k + l are of the size of (s / 2)^n / n!, so that few terms suffice
    for any window. If the wave is a product of a function of y and one of x, so are its terms.
    """

    def __init__(
        self, request: PSFRequest, grid: PixelGrid, degrees: int, dtype: torch.dtype
    ) -> None:
        self._request, self._grid, self._dtype = request, grid, dtype
        self._degrees = degrees
        self.separable = request.lens.has_quadratic_phase and request.sphere is None

    def terms(self, node_count: int) -> tuple[list[WaveTerm], list[WaveTerm]]:
        """Return the terms below the number of degrees, and the first that are left out."""
        degrees, count = self._degrees, self._degrees * (self._degrees + 1) // 2
        pairs = [(n - k, k) for n in range(degrees + 1) for k in range(n + 1)]
        factors: list[tuple[torch.Tensor, torch.Tensor | None]]
        if self.separable:
            down, along = self.axis_coefficients(0), self.axis_coefficients(1)
            factors = [(down[k][:, None], along[m]) for k, m in pairs]
        elif node_count == 1:
            factors = [(factor, None) for factor in self._factors_from_slopes()]
        else:
            found = self._factors_from_nodes(node_count)
            factors = [(found[pair], None) for pair in pairs]
        y, x = self.envelopes(0), self.envelopes(1)
        made = [
            WaveTerm((y[k], x[m]), *factor) for (k, m), factor in zip(pairs, factors, strict=True)
        ]
        return made[:count], made[count:]

    def envelopes(self, axis: int) -> torch.Tensor:
        """Return the envelopes of all degrees along an axis of the samples."""
        q = self._request
        places = q.samples.coordinates(axis)
        return pixel_envelopes(places, self._degrees, self._grid.side, q.scale)

    def axis_coefficients(self, axis: int) -> list[torch.Tensor]:
        """Return b_k, each (pixels,), along one axis of a wave that is a product over both."""
        q, n, half = self._request, self._request.numeric, self._grid.side / 2
        line = self._grid.points.coordinates(axis)
        curvature = abs(defocus_curvature(n.lens, n.distance, n.wavelength))
        half_turn = curvature * (2 * float(line.abs().max()) * half + half**2)
        nodes, weights = gauss_legendre(full_precision_nodes(half_turn, self._degrees))
        place = line[:, None] + torch.from_numpy(nodes * half)
        zero = torch.zeros((), dtype=torch.float64)
        y, x = (place, zero) if axis == 0 else (zero, place)
        phase = pupil_phase(q.lens, q.distance, q.wavelength, y / q.radius, x / q.radius)
        wave = phase_factor(phase, torch.complex128)
        legendre = _scaled_legendre(nodes, weights, self._degrees)
        return list((wave @ legendre.to(wave).mT).to(self._dtype).mT)

    def _factors_from_slopes(self) -> list[torch.Tensor]:
        """Return the wave at the pixels' centres, and what its slopes there add along y and x."""
        wave, phase = self._wave(*self._grid.points.mesh())
        half = self._grid.side / (2 * self._grid.panel.pitch)
        factors = [wave]
        for axis in (0, 1):
            slope = torch.gradient(phase, dim=axis)[0] if phase.shape[axis] > 1 else 0 * phase
            factors.append((1j * half * slope).to(self._dtype) * wave)
        return factors

    def _factors_from_nodes(self, node_count: int) -> torch.Tensor:
        """Return b_kl from nodes inside the pixels, for any wave."""
        nodes, weights = gauss_legendre(max(node_count, self._degrees + 1))
        legendre = _scaled_legendre(nodes, weights, self._degrees).to(self._dtype)
        inside = torch.tensor(nodes * self._grid.side / 2)
        count = inside.numel()
        whole_y, x = self._grid.points.mesh()
        # Blocks of rows fit in the cache.
        rows = max(1, _BLOCK_POINTS // (x.numel() * count**2))
        blocks = []
        for y in torch.split(whole_y, rows):
            wave, _ = self._wave((y + inside).reshape(-1, 1), (x.mT + inside).reshape(1, -1))
            split = wave.reshape(y.numel(), count, x.numel(), count)
            blocks.append(torch.einsum("ki,lj,yixj->klyx", legendre, legendre, split))
        return torch.cat(blocks, dim=2)

    def _wave(self, y: torch.Tensor, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the complex wave at panel positions (y, x) in metres, and its phase."""
        q = self._request
        phase = pupil_phase(q.lens, q.distance, q.wavelength, y / q.radius, x / q.radius)
        wave = phase_factor(phase, self._dtype)
        if q.sphere is not None:
            further = q.sphere.wave_factor(y, x)
            wave = wave * further.to(self._dtype)
            phase = phase + q.sphere.phase(y, x)
        return wave, phase


def pixel_envelopes(places: torch.Tensor, degrees: int, side: float, scale: Scalar) -> torch.Tensor:
    """Return what the Legendre terms inside a panel pixel contribute to the field.

    Entry k is the mean over -1 <= t <= 1 of P_k(t) exp(-i pi u side t / scale), which is the
    spherical Bessel function j_k times (-i)^k, a sinc for degree 0. The result is (degrees + 1,
    places), complex128.

    places: u, positions on the sensor along one axis, metres.
    scale: wavelength times distance, m².
    """
    turn = math.pi * places * side / scale
    largest = float(turn.detach().abs().max()) if turn.numel() else 0.0
    nodes, weights = gauss_legendre(full_precision_nodes(largest, degrees))
    angle = turn * torch.tensor(nodes)[:, None]
    weighted = torch.tensor(weights / 2 * _legendre_polynomials(nodes, degrees))
    return torch.complex(weighted @ torch.cos(angle), -(weighted @ torch.sin(angle)))


def largest_coefficient(half_turn: float, degree: int) -> float:
    """Bound |b_k| = (2k + 1) |j_k| by min(2k + 1, half_turn^k / (2k - 1)!!).

    half_turn: half of the change across the pixel of a phase that is linear there, radians.
    """
    factorial = math.prod(range(1, 2 * degree, 2))
    return min(2.0 * degree + 1, half_turn**degree / factorial)


def envelope_shares(
    samples: Plane, degrees: int, side: float, scale: float
) -> tuple[list[float], list[float]]:
    """Tell how much terms of the wave may matter in the window, by their degrees along y and x.

    The product of entry k for y and entry l for x is the L2 norm of |J_0 J_k| times |J_0 J_l| over
    the samples, over that of J_0² J_0², with the envelopes J of `pixel_envelopes`. It is the ratio
    of a term's part in the intensity to the intensity, if light is spread as the envelope J_0² is.
    """
    ratios = []
    for axis in (0, 1):
        power = pixel_envelopes(samples.coordinates(axis), degrees, side, scale).abs() ** 2
        size = (power[0] ** 2).sum()
        ratio = torch.where(size > 0, (power[0] * power).sum(1) / size, math.inf)
        ratios.append(ratio.sqrt().tolist())
    return ratios[0], ratios[1]


def full_precision_nodes(half_turn: float, degree: int = 0) -> int:
    """Return how many Gauss-Legendre nodes integrate a wave in a panel pixel to rounding.

    half_turn: half of the phase's change across the pixel, radians.
    degree: of a polynomial that the wave is multiplied by.
    """
    return gauss_node_count(2.0, half_turn, 1e-16) + math.ceil(degree / 2)


def _scaled_legendre(nodes: Array, weights: Array, degrees: int) -> torch.Tensor:
    """Return the rule for the coefficients b_k of a wave in a pixel, (degrees + 1, nodes)."""
    factor = (2 * np.arange(degrees + 1) + 1) / 2
    return torch.tensor(factor[:, None] * weights * _legendre_polynomials(nodes, degrees))


def _legendre_polynomials(t: Array, degrees: int) -> Array:
    """Return the Legendre polynomials P_0 to P_degrees, (degrees + 1, places)."""
    return np.asarray(np.polynomial.legendre.legvander(t, degrees).T, dtype=np.float64)


class PixelIntegralTransform(PlaneTransform):
    """Base class of Fourier integrals over the area of panel pixels, with the lens' wave in them.

    The field that is given is the pattern alone, constant in each pixel.

    rounding_growth: factor by which rounding errors exceed those of a plain sum.
    """

    rounding_growth: float = 1.0

    @abstractmethod
    def mean_squared_kernel(self, axis: int) -> torch.Tensor:
        """Return the mean square over the pixels of what a sample gets of each, float64."""


class CurvedPixelTransform(MatrixTransform, PixelIntegralTransform):
    """Computes the Fourier integral over square panel pixels under a quadratic phase.

    Defocus bends the wave differently inside each pixel. The curvature is the same along both axes
    and the pixel is a square, so the integral still factors into rows and columns, each a matrix:

        K(u, x) = mean over |d| < side / 2 of exp(i curvature (x + d)² - 2 pi i u (x + d) / scale)

    curvature: radians per square metre.
    side: of a pixel's active square, metres.
    """

    name = "matrix DFT with curved pixels"

    def __init__(
        self, geometry: FourierGeometry, dtype: torch.dtype, curvature: float, side: float
    ) -> None:
        super().__init__(geometry, dtype)
        self._curvature, self._side = curvature, side

    def node_count(self, axis: int) -> int:
        """Return the quadrature nodes for the pixel and sample with the largest phase change."""
        x, u = (p.coordinates(axis).abs().max() for p in (self.geometry.pupil, self.geometry.image))
        half = self._side / 2
        bend = abs(self._curvature) * (2 * float(x) * half + half**2)
        tilt = 2 * math.pi * float(u) * half / self.geometry.scale
        return full_precision_nodes(bend + tilt)

    def _kernel(self, axis: int) -> torch.Tensor:
        g = self.geometry
        u, x = g.image.coordinates(axis), g.pupil.coordinates(axis)
        points, weights = gauss_legendre(self.node_count(axis))
        d = torch.from_numpy(points * self._side / 2)
        weight = torch.from_numpy(weights / 2)
        turns = self._curvature / (2 * math.pi) * (x[:, None] + d) ** 2
        bent = unit_phasor(turns, torch.complex128) * weight
        tilted = unit_phasor(-torch.outer(u, d) / g.scale, torch.complex128)
        centres = unit_phasor(-torch.outer(u, x) / g.scale, torch.complex128)
        return (centres * (tilted @ bent.mT)).to(self.dtype)

    def mean_squared_kernel(self, axis: int) -> torch.Tensor:
        kernel = self._kernels(torch.device("cpu"))[axis].to(torch.complex128)
        return (kernel.real**2 + kernel.imag**2).mean(1)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of computing the matrices."""
        seconds = 0.0
        for axis in (0, 1):
            n, m = self.geometry.pupil.shape[axis], self.geometry.image.shape[axis]
            nodes = self.node_count(axis)
            phasors = (m * n + nodes * (m + n)) * PASSES_PER_PHASOR * speed.touch
            seconds += phasors + 4 * m * n * nodes * speed.multiply_add * speed.double
        return seconds
