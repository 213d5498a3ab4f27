"""The paraxial integral as one Fourier transform between two chirps."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from optics.accuracy import Budget, MachineSpeed
from optics.fourier import FourierGeometry, plan_transform, unit_phasor
from optics.fourier.transform import RETAINED_BYTES
from optics.plane import Plane
from optics.propagation.fresnel_integral import cell_envelope
from optics.propagation.paraxial import ParaxialPropagator
from optics.propagation.span import Scalar
from optics.validation import as_number, needs_gradient

WavePairs = list[tuple[torch.Tensor, torch.Tensor]]
"""What comes before and after the transform along an axis, for every node."""


@dataclass(frozen=True)
class CellSampling:
    """Rectangles of constant field, and how often their light is looked at.

    sides: metres (y, x). nodes: places (y, x) of the source at which a cell's envelope is
    taken exactly; between them it is interpolated.
    """

    sides: tuple[float, float]
    nodes: tuple[int, int]


class ChirpedTransform:
    """Fresnel's integral from the samples of one plane to those of another:

        U(X) = exp(i pi X² / scale) / (i scale) · sum of area U(x) exp(i pi x² / scale)
               exp(-2 pi i X x / scale),

    with all places from the source's centre (Goodman 4.2.1). Any pitch and window will do:
    the sum is a transform of optics.fourier. A negative scale is the conjugate of a positive
    one's answer to the conjugate field.

    Cells send the sum times an envelope (optics.propagation.fresnel_integral) that depends
    on how far each is from a target's sample. Far away it hardly changes from cell to cell;
    in general it is interpolated between some of the source's places (envelope_node_count()), with
    a transform for each.

    scale: wavelength times distance, m², with the distance's sign. precise: whether the
    transform has to be exact to rounding; otherwise it may add `error` of the field's light.
    Differentiable in the field, the scale and the target's centre.
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
        passes = 3 * samples * speed.touch * self._transform.precision_slowdown(speed)
        # Every pass takes memory of its own.
        passes += 2 * max(samples * self._dtype.itemsize - RETAINED_BYTES, 0) * speed.fresh
        return self._terms * (self._transform.cpu_seconds(speed) + passes)

    def prepare(self) -> None:
        if not self.differentiable:
            self._waves_on(torch.device("cpu"))

    def _waves_on(self, device: torch.device) -> _ChirpWaves:
        if self.differentiable and torch.is_grad_enabled():
            return self._build_waves().to(device)
        if self._cached_waves is None:
            with torch.no_grad():
                self._cached_waves = self._build_waves()
        self._cached_waves = self._cached_waves.to(device)
        return self._cached_waves

    def _build_waves(self) -> _ChirpWaves:
        scale = torch.abs(torch.as_tensor(self._scale, dtype=torch.float64, device="cpu"))
        waves = [self._axis_waves(axis, scale) for axis in (0, 1)]
        return _ChirpWaves(waves[0], waves[1])

    def _axis_waves(self, axis: int, scale: torch.Tensor) -> WavePairs:
        """For every node: what comes before the transform along an axis, and after it."""
        source, target = self._source, self._target
        x = source.coordinates(axis) - source.centre[axis]
        way = target.coordinates(axis) - source.centre[axis]
        before = unit_phasor(x**2 / (2 * scale), torch.complex128)
        after = unit_phasor(way**2 / (2 * scale) - 0.125, torch.complex128) / torch.sqrt(scale)
        if self._cells is None:
            return [(before.to(self._dtype), (after * source.pitch[axis]).to(self._dtype))]
        side, after = self._cells.sides[axis], after * self._cells.sides[axis]
        nodes = _chebyshev_nodes(x, self._cells.nodes[axis])
        shares = _lagrange_weights(x, nodes)
        return [
            (
                (before * share).to(self._dtype),
                (after * cell_envelope(way - node, side, scale)).to(self._dtype),
            )
            for node, share in zip(nodes, shares, strict=True)
        ]

    def _stretch_and_shift(
        self,
    ) -> tuple[torch.Tensor | None, tuple[torch.Tensor, torch.Tensor] | None]:
        """The stretch and the shift of the transform, from which its derivatives follow."""
        if not (self.differentiable and torch.is_grad_enabled()):
            return None, None
        centre, scale = self._target.centre, self._scale
        stretch = as_number(scale) / scale if needs_gradient(scale) else None
        y, x = (torch.as_tensor(c, dtype=torch.float64) - as_number(c) for c in centre)
        return stretch, (y, x)

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        field = field.to(self._dtype)
        if as_number(self._scale) < 0:
            return self._forward_positive(field.conj()).conj().resolve_conj()
        return self._forward_positive(field)

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        field = field.to(self._dtype)
        if as_number(self._scale) < 0:
            return self._adjoint_positive(field.conj()).conj().resolve_conj()
        return self._adjoint_positive(field)

    def _forward_positive(self, field: torch.Tensor) -> torch.Tensor:
        waves, (stretch, shift) = self._waves_on(field.device), self._stretch_and_shift()
        return _sum_terms(waves, field, lambda lit: self._transform(lit, stretch, shift))

    def _adjoint_positive(self, field: torch.Tensor) -> torch.Tensor:
        return _sum_terms(self._waves_on(field.device).adjoint, field, self._transform.adjoint)


class ChirpedPropagator(ParaxialPropagator):
    """One such transform after the other, with a step down to darkness at each plane between."""

    _steps: tuple[ChirpedTransform, ...]

    @property
    def bytes(self) -> int:
        return max(step.bytes for step in self._steps)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return sum(step.cpu_seconds(speed) for step in self._steps)

    def prepare(self) -> None:
        for step in self._steps:
            step.prepare()

    def _taper_ends(self, field: torch.Tensor) -> torch.Tensor:
        """A field on the plane between, with its ends made dark."""
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
    """Of both axes."""

    y: WavePairs
    x: WavePairs

    def to(self, device: torch.device) -> _ChirpWaves:
        if self.y[0][0].device == device:
            return self
        y, x = ([(b.to(device), a.to(device)) for b, a in axis] for axis in (self.y, self.x))
        return _ChirpWaves(y, x)

    @property
    def adjoint(self) -> _ChirpWaves:
        """Those of the adjoint."""
        y, x = ([(b.conj(), a.conj()) for a, b in axis] for axis in (self.y, self.x))
        return _ChirpWaves(y, x)


def _sum_terms(
    waves: _ChirpWaves, field: torch.Tensor, transform: Callable[[torch.Tensor], torch.Tensor]
) -> torch.Tensor:
    """The sum over all terms of a field times the waves before, transformed, times those after."""
    terms = (
        transform(field * before_y[:, None] * before_x) * after_y[:, None] * after_x
        for before_y, after_y in waves.y
        for before_x, after_x in waves.x
    )
    return functools.reduce(torch.add, terms)


def _chebyshev_nodes(x: torch.Tensor, count: int) -> list[float]:
    """Chebyshev's nodes in the range of x."""
    low, high = float(x.min()), float(x.max())
    angles = (2 * np.arange(count) + 1) * math.pi / (2 * count)
    return ((low + high) / 2 + (high - low) / 2 * np.cos(angles)).tolist()


def _lagrange_weights(x: torch.Tensor, nodes: list[float]) -> list[torch.Tensor]:
    """Lagrange's polynomials, 1 at one node and 0 at the others."""
    if float(x.max()) == float(x.min()):
        return [torch.full_like(x, 1 / len(nodes)) for _ in nodes]
    found = []
    for node in nodes:
        factors = [(x - other) / (node - other) for other in nodes if other != node]
        found.append(torch.stack(factors).prod(0) if factors else torch.ones_like(x))
    return found


def envelope_error(turn: float, nodes: int) -> float:
    """What an envelope costs that is interpolated between some nodes, relative L2.

    turn: radians by which the chirp over the source turns across its outermost cells. A cell
    whose chirp turns by u has exp(i u d), |d| < 1/2, inside, which Lagrange's polynomial takes
    from Chebyshev's nodes in -turn to turn with the remainder (turn |d|)^n / (2^(n-1) n!).
    Fresnel's integral keeps light, so the error of the field is the mean square of that.
    """
    log = nodes * math.log(turn / 2) if turn > 0 else -math.inf
    log -= (nodes - 1) * math.log(2) + math.lgamma(nodes + 1)
    return math.exp(min(log, 0.0)) / math.sqrt(2 * nodes + 1)


def envelope_node_count(turn: float, error: float, most: int) -> int:
    """The fewest nodes that keep an error; 0 if it takes more than `most`."""
    for nodes in range(1, most + 1):
        # The other axis multiplies this one's error by its Lebesgue constant, below 3.
        if 3 * envelope_error(turn, nodes) <= error:
            return nodes
    return 0
