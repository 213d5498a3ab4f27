"""The paraxial integral as one Fourier transform between two chirps."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from optics.accuracy import Budget, MachineSpeed
from optics.edge import as_number, recorded
from optics.fourier import Geometry, plan_transform, unit_phasor
from optics.fourier.transform import KEPT_BYTES
from optics.plane import Plane
from optics.propagation.fresnel_integral import cell_envelope
from optics.propagation.paraxial import ParaxialPropagator
from optics.propagation.span import Scalar

Pairs = list[tuple[torch.Tensor, torch.Tensor]]
"""What comes before and after the transform along an axis, for every node."""


@dataclass(frozen=True)
class Cells:
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
    in general it is interpolated between some of the source's places (cell_nodes()), with a
    transform for each.

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
        cells: Cells | None = None,
    ) -> None:
        self._source, self._target, self._cells = source, target, cells
        self._scale = scale
        self._dtype = dtype
        self._distance = (
            as_number(target.centre[0]) - source.centre[0],
            as_number(target.centre[1]) - source.centre[1],
        )
        geometry = Geometry(
            Plane(source.shape, source.pitch),
            Plane(target.shape, target.pitch, self._distance),
            abs(as_number(scale)),
        )
        self._transform = plan_transform(geometry, dtype, budget, error=error)
        self.error = self._transform.error
        self.name = self._transform.name
        self.differentiable = recorded(scale) or any(map(recorded, target.centre))
        self._kept: _Waves | None = None

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
        passes = 3 * samples * speed.touch * self._transform.slowness(speed)
        # Every pass takes memory of its own.
        passes += 2 * max(samples * self._dtype.itemsize - KEPT_BYTES, 0) * speed.fresh
        return self._terms * (self._transform.cpu_seconds(speed) + passes)

    def prepare(self) -> None:
        if not self.differentiable:
            self._waves(torch.device("cpu"))

    def _waves(self, device: torch.device) -> _Waves:
        if self.differentiable and torch.is_grad_enabled():
            return self._made().to(device)
        if self._kept is None:
            with torch.no_grad():
                self._kept = self._made()
        self._kept = self._kept.to(device)
        return self._kept

    def _made(self) -> _Waves:
        scale = torch.abs(torch.as_tensor(self._scale, dtype=torch.float64, device="cpu"))
        waves = [self._axis_waves(axis, scale) for axis in (0, 1)]
        return _Waves(waves[0], waves[1])

    def _axis_waves(self, axis: int, scale: torch.Tensor) -> Pairs:
        """For every node: what comes before the transform along an axis, and after it."""
        source, target = self._source, self._target
        x = source.coordinates(axis) - source.centre[axis]
        way = target.coordinates(axis) - source.centre[axis]
        before = unit_phasor(x**2 / (2 * scale), torch.complex128)
        after = unit_phasor(way**2 / (2 * scale) - 0.125, torch.complex128) / torch.sqrt(scale)
        if self._cells is None:
            return [(before.to(self._dtype), (after * source.pitch[axis]).to(self._dtype))]
        side, after = self._cells.sides[axis], after * self._cells.sides[axis]
        nodes = _nodes(x, self._cells.nodes[axis])
        shares = _shares(x, nodes)
        return [
            (
                (before * share).to(self._dtype),
                (after * cell_envelope(way - node, side, scale)).to(self._dtype),
            )
            for node, share in zip(nodes, shares, strict=True)
        ]

    def _moves(self) -> tuple[torch.Tensor | None, tuple[torch.Tensor, torch.Tensor] | None]:
        """The stretch and the shift of the transform, from which its derivatives follow."""
        if not (self.differentiable and torch.is_grad_enabled()):
            return None, None
        centre, scale = self._target.centre, self._scale
        stretch = as_number(scale) / scale if recorded(scale) else None
        y, x = (torch.as_tensor(c, dtype=torch.float64) - as_number(c) for c in centre)
        return stretch, (y, x)

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        field = field.to(self._dtype)
        if as_number(self._scale) < 0:
            return self._ahead(field.conj()).conj().resolve_conj()
        return self._ahead(field)

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        field = field.to(self._dtype)
        if as_number(self._scale) < 0:
            return self._back(field.conj()).conj().resolve_conj()
        return self._back(field)

    def _ahead(self, field: torch.Tensor) -> torch.Tensor:
        waves, (stretch, shift) = self._waves(field.device), self._moves()
        return _summed(waves, field, lambda lit: self._transform(lit, stretch, shift))

    def _back(self, field: torch.Tensor) -> torch.Tensor:
        return _summed(self._waves(field.device).backwards, field, self._transform.adjoint)


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

    def _tapered(self, field: torch.Tensor) -> torch.Tensor:
        """A field on the plane between, with its ends made dark."""
        return field

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        field = self._steps[0].forward(field)
        for step in self._steps[1:]:
            field = step.forward(self._tapered(field))
        return field

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        for step in self._steps[:0:-1]:
            field = self._tapered(step.adjoint(field))
        return self._steps[0].adjoint(field)


@dataclass(frozen=True)
class _Waves:
    """Of both axes."""

    y: Pairs
    x: Pairs

    def to(self, device: torch.device) -> _Waves:
        if self.y[0][0].device == device:
            return self
        y, x = ([(b.to(device), a.to(device)) for b, a in axis] for axis in (self.y, self.x))
        return _Waves(y, x)

    @property
    def backwards(self) -> _Waves:
        """Those of the adjoint."""
        y, x = ([(b.conj(), a.conj()) for a, b in axis] for axis in (self.y, self.x))
        return _Waves(y, x)


def _summed(
    waves: _Waves, field: torch.Tensor, transform: Callable[[torch.Tensor], torch.Tensor]
) -> torch.Tensor:
    """The sum over all terms of a field times the waves before, transformed, times those after."""
    terms = (
        transform(field * before_y[:, None] * before_x) * after_y[:, None] * after_x
        for before_y, after_y in waves.y
        for before_x, after_x in waves.x
    )
    return functools.reduce(torch.add, terms)


def _nodes(x: torch.Tensor, count: int) -> list[float]:
    """Chebyshev's nodes in the range of x."""
    low, high = float(x.min()), float(x.max())
    angles = (2 * np.arange(count) + 1) * math.pi / (2 * count)
    return ((low + high) / 2 + (high - low) / 2 * np.cos(angles)).tolist()


def _shares(x: torch.Tensor, nodes: list[float]) -> list[torch.Tensor]:
    """Lagrange's polynomials, 1 at one node and 0 at the others."""
    if float(x.max()) == float(x.min()):
        return [torch.full_like(x, 1 / len(nodes)) for _ in nodes]
    found = []
    for node in nodes:
        factors = [(x - other) / (node - other) for other in nodes if other != node]
        found.append(torch.stack(factors).prod(0) if factors else torch.ones_like(x))
    return found


def cell_error(turn: float, nodes: int) -> float:
    """What an envelope costs that is interpolated between some nodes, relative L2.

    turn: radians by which the chirp over the source turns across its outermost cells. A cell
    whose chirp turns by u has exp(i u d), |d| < 1/2, inside, which Lagrange's polynomial takes
    from Chebyshev's nodes in -turn to turn with the remainder (turn |d|)^n / (2^(n-1) n!).
    Fresnel's integral keeps light, so the error of the field is the mean square of that.
    """
    log = nodes * math.log(turn / 2) if turn > 0 else -math.inf
    log -= (nodes - 1) * math.log(2) + math.lgamma(nodes + 1)
    return math.exp(min(log, 0.0)) / math.sqrt(2 * nodes + 1)


def cell_nodes(turn: float, error: float, most: int) -> int:
    """The fewest nodes that keep an error; 0 if it takes more than `most`."""
    for nodes in range(1, most + 1):
        # The other axis multiplies this one's error by its Lebesgue constant, below 3.
        if 3 * cell_error(turn, nodes) <= error:
            return nodes
    return 0
