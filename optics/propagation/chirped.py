"""Fresnel's integral by Fourier transforms between two chirps."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from optics.accuracy import Budget, MachineSpeed
from optics.chebyshev import chebyshev_nodes, lagrange_basis
from optics.fourier import FourierGeometry, plan_transform, unit_phasor
from optics.fourier.transform import RETAINED_BYTES
from optics.plane import Plane
from optics.propagation.fresnel_matrix import cell_envelope
from optics.propagation.paraxial import ParaxialPropagator
from optics.propagation.span import Scalar
from optics.validation import as_number, needs_gradient

WavePairs = list[tuple[torch.Tensor, torch.Tensor]]
"""The factors before and after the Fourier transform along an axis, for every envelope node."""


_PLANNING_CALLS = 14  # processor time of planning chirped transforms, in function calls


@dataclass(frozen=True)
class CellSampling:
    """Cells of constant field on the source, of `sides` (y, x) in metres.

    nodes: numbers (y, x) of nodes on the source, between which their envelope is interpolated.
    """

    sides: tuple[float, float]
    nodes: tuple[int, int]


class ChirpedTransform:
    """Compute Fresnel's integral from the samples of one plane to those of another.

        U(X) = exp(i pi X² / scale) / (i scale) · sum of area U(x) exp(i pi x² / scale)
               exp(-2 pi i X x / scale),

    All positions are relative to the source's centre (section 4.2.1 of Goodman). The sum is a
    transform of optics.fourier, so any pitch and window is possible. The result for a negative
    scale is the conjugate of the result for a positive scale and the conjugate field.

    For cells, the field is multiplied by an envelope (optics.propagation.fresnel_matrix) that
    depends on the displacement from the cell to the target's sample. At long distances it hardly
    changes from cell to cell. In general it is interpolated between several nodes on the source
    (envelope_node_count()), with one transform for each node.

    scale: wavelength times distance, m², with the distance's sign. error: relative L2 error that
    the transform may add. The result is differentiable in the field, the scale and the target's
    centre.
    """

    def __init__(
        self,
        source: Plane,
        target: Plane,
        scale: Scalar,
        dtype: torch.dtype,
        budget: Budget,
        *,
        error: float = 0.0,
        cells: CellSampling | None = None,
    ) -> None:
        self._source, self._target, self._cells = source, target, cells
        self._scale = scale
        self._dtype = dtype
        self._centre_offset = (
            as_number(target.centre[0]) - source.centre[0],
            as_number(target.centre[1]) - source.centre[1],
        )
        geometry = FourierGeometry(
            Plane(source.shape, source.pitch),
            Plane(target.shape, target.pitch, self._centre_offset),
            abs(as_number(scale)),
        )
        self._transform = plan_transform(geometry, dtype, budget, error=error)
        self.error = self._transform.error
        self.name = self._transform.name
        self.differentiable = needs_gradient(scale) or any(map(needs_gradient, target.centre))
        self._cached_waves: _ChirpWaves | None = None

    @property
    def _terms(self) -> int:
        return self._cells.nodes[0] * self._cells.nodes[1] if self._cells else 1

    @property
    def bytes(self) -> int:
        (ny, nx), (my, mx) = self._source.shape, self._target.shape
        sums = 2 if self._terms > 1 else 1
        return self._transform.bytes + self._dtype.itemsize * (2 * ny * nx + sums * my * mx)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        (ny, nx), (my, mx) = self._source.shape, self._target.shape
        samples = ny * nx + my * mx
        passes = 3 * samples * speed.touch * speed.slowdown(self._dtype)
        # Every pass allocates memory of its own.
        passes += 2 * max(samples * self._dtype.itemsize - RETAINED_BYTES, 0) * speed.fresh
        return self._terms * (self._transform.cpu_seconds(speed) + passes)

    def prepare(self) -> None:
        if not self.differentiable:
            self._waves_on(torch.device("cpu"))

    def _waves_on(self, device: torch.device) -> _ChirpWaves:
        recorded = self.differentiable and torch.is_grad_enabled()
        waves = None if recorded else self._cached_waves
        if waves is None:
            with torch.set_grad_enabled(recorded):
                scale = torch.abs(torch.as_tensor(self._scale, dtype=torch.float64, device="cpu"))
                waves = _ChirpWaves(self._axis_waves(0, scale), self._axis_waves(1, scale))
        waves = waves.to(device)
        if not recorded:
            self._cached_waves = waves
        return waves

    def _axis_waves(self, axis: int, scale: torch.Tensor) -> WavePairs:
        """Compute an axis' chirps before and after the transform, a pair for each envelope node."""
        source, target = self._source, self._target
        x = source.coordinates(axis) - source.centre[axis]
        way = target.coordinates(axis) - source.centre[axis]
        before = unit_phasor(x**2 / (2 * scale), torch.complex128)
        after = unit_phasor(way**2 / (2 * scale) - 0.125, torch.complex128) / torch.sqrt(scale)
        if self._cells is None:
            return [(before.to(self._dtype), (after * source.pitch[axis]).to(self._dtype))]
        side, after = self._cells.sides[axis], after * self._cells.sides[axis]
        nodes, shares = _envelope_nodes(x, self._cells.nodes[axis])
        return [
            (
                (before * share).to(self._dtype),
                (after * cell_envelope(way - node, side, scale)).to(self._dtype),
            )
            for node, share in zip(nodes, shares, strict=True)
        ]

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        field, backwards = field.to(self._dtype), as_number(self._scale) < 0
        stretch, shift = None, None
        if self.differentiable and torch.is_grad_enabled():
            # The stretch and the shift of the transform carry the derivatives.
            scale = self._scale
            stretch = as_number(scale) / scale if needs_gradient(scale) else None
            y, x = (
                torch.as_tensor(c, dtype=torch.float64) - as_number(c) for c in self._target.centre
            )
            shift = (y, x)
        answer = _sum_terms(
            self._waves_on(field.device),
            field.conj() if backwards else field,
            lambda lit: self._transform(lit, stretch, shift),
        )
        return answer.conj().resolve_conj() if backwards else answer

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        field, backwards = field.to(self._dtype), as_number(self._scale) < 0
        waves, field = self._waves_on(field.device).adjoint, field.conj() if backwards else field
        answer = _sum_terms(waves, field, self._transform.adjoint)
        return answer.conj().resolve_conj() if backwards else answer


class ChirpedPropagator(ParaxialPropagator):
    """Chain one or several chirped transforms, with tapers on the intermediate planes."""

    _steps: tuple[ChirpedTransform, ...]

    @property
    def bytes(self) -> int:
        return max(step.bytes for step in self._steps)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return sum(step.cpu_seconds(speed) for step in self._steps)

    def planning_seconds(self, speed: MachineSpeed) -> float:
        return _PLANNING_CALLS * speed.call

    def prepare(self) -> None:
        for step in self._steps:
            step.prepare()

    def _taper_ends(self, field: torch.Tensor) -> torch.Tensor:
        """Taper a field on an intermediate plane towards its ends."""
        return field

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        field = self._steps[0].forward(field)
        for step in self._steps[1:]:
            field = step.forward(self._taper_ends(field))
        return field

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        for step in self._steps[:0:-1]:
            field = self._taper_ends(step.adjoint(field))
        return self._steps[0].adjoint(field)


@dataclass(frozen=True)
class _ChirpWaves:
    """The chirp factors before and after the Fourier transform, along both axes."""

    y: WavePairs
    x: WavePairs

    def to(self, device: torch.device) -> _ChirpWaves:
        if self.y[0][0].device == device:
            return self
        y, x = ([(b.to(device), a.to(device)) for b, a in axis] for axis in (self.y, self.x))
        return _ChirpWaves(y, x)

    @property
    def adjoint(self) -> _ChirpWaves:
        y, x = ([(b.conj(), a.conj()) for a, b in axis] for axis in (self.y, self.x))
        return _ChirpWaves(y, x)


def _sum_terms(
    waves: _ChirpWaves, field: torch.Tensor, transform: Callable[[torch.Tensor], torch.Tensor]
) -> torch.Tensor:
    """Sum the transforms of a field over all pairs of envelope nodes."""
    terms = (
        transform(field * before_y[:, None] * before_x) * after_y[:, None] * after_x
        for before_y, after_y in waves.y
        for before_x, after_x in waves.x
    )
    return functools.reduce(torch.add, terms)


def _envelope_nodes(x: torch.Tensor, count: int) -> tuple[list[float], list[torch.Tensor]]:
    """Return nodes in the range of x, and at x the polynomials that are 1 at one node each."""
    low, high = float(x.min()), float(x.max())
    nodes = (low + high) / 2 + (high - low) / 2 * chebyshev_nodes(count)
    if low == high:
        return nodes.tolist(), [torch.full_like(x, 1 / count) for _ in nodes]
    return nodes.tolist(), list(lagrange_basis(torch.from_numpy(nodes).to(x), x).T)


def envelope_error(turn: float, nodes: int) -> float:
    """Return the relative L2 error if cell envelopes are interpolated between nodes.

    turn: phase in radians of the source's chirp across its outermost cells. The chirp of a cell
    with phase u is exp(i u d), |d| < 1/2. Lagrange interpolation of it between Chebyshev nodes from
    -turn to turn has the remainder (turn |d|)^n / (2^(n-1) n!). Fresnel's integral preserves the
    power, so the error of the field is the root mean square of the remainder.
    """
    log = nodes * math.log(turn / 2) if turn > 0 else -math.inf
    log -= (nodes - 1) * math.log(2) + math.lgamma(nodes + 1)
    return math.exp(min(log, 0.0)) / math.sqrt(2 * nodes + 1)


def envelope_node_count(turn: float, error: float, most: int) -> int:
    """Return the fewest envelope nodes that keep an error; 0 for more than `most`."""
    for nodes in range(1, most + 1):
        # The interpolation along the other axis multiplies the error by its Lebesgue constant,
        # which is below 3.
        if 3 * envelope_error(turn, nodes) <= error:
            return nodes
    return 0
