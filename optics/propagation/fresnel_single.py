"""Fresnel's integral by a single Fourier transform."""

from __future__ import annotations

import math

import torch

from optics.accuracy import ErrorEstimate, MachineSpeed, ToleranceError
from optics.propagation.chirped import Cells, ChirpedTransform, cell_error, cell_nodes
from optics.propagation.paraxial import as_paraxial, kernel_turns
from optics.propagation.precision import below_floor, working_precision
from optics.propagation.propagator import Propagator
from optics.propagation.replicas import copies_miss, field_band, reaching
from optics.propagation.span import Span
from optics.propagation.spectral import TRANSFORM_SHARE, shared_error

SAMPLING_SHARE = 0.2
"""Of the tolerance that samples may use: copies that come near, or envelopes between nodes."""

COPY_SHARE = 0.05
"""Of the tolerance: what one of a smooth field's four nearest copies may send, at most."""

MOST_NODES = 6
"""Transforms an axis beyond which other methods are always cheaper."""


class SingleFresnel(Propagator):
    """Chirp, Fourier transform, chirp (Goodman 4.2.1), to any pitch and window.

    A smooth field is summed over its samples, where no copy of its spectrum sends light to the
    target (optics.propagation.replicas): far enough away, that is. Cells are exact at any
    distance, but near by they take one transform for each of some nodes (optics.propagation.
    chirped).
    """

    name = "single Fresnel transform"

    def __init__(self, span: Span) -> None:
        super().__init__(span)
        asked, model = as_paraxial(self.name, span)
        n = asked.numeric
        cells, sampling = None, SAMPLING_SHARE * n.tol
        if n.cells is None:
            require_missed_copies(self.name, asked)
        else:
            cells, sampling = interpolated_cells(asked, n.scale, SAMPLING_SHARE * n.tol)
        share = SAMPLING_SHARE + 2 * TRANSFORM_SHARE
        self.dtype, self.arithmetic = working_precision(n.tol - model, kernel_turns(asked), share)
        self._transform = ChirpedTransform(
            n.source, span.target, span.scale, self.dtype, n.budget,
            error=shared_error(n), cells=cells,
        )  # fmt: skip
        self.error = ErrorEstimate(model + sampling + 2 * self._transform.error, "bound")
        if not self.error.value + self.arithmetic <= n.tol:
            raise below_floor(n.tol, share, self.arithmetic + model)
        terms = f", {cells.nodes[1]}x{cells.nodes[0]} nodes" if cells else ""
        rows, columns = n.source.shape
        self.sampling = f"{columns}x{rows} source samples{terms}, {self._transform.name}"

    @property
    def bytes(self) -> int:
        return self._transform.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._transform.cpu_seconds(speed)

    def prepare(self) -> None:
        self._transform.prepare()

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        return self._transform.forward(field)

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        return self._transform.adjoint(field)


def require_missed_copies(name: str, span: Span) -> None:
    """Raise ToleranceError where a copy of a smooth field's spectrum lights the target."""
    n = span.numeric
    for axis in (0, 1):
        band, reach, pitch = field_band(n, axis), reaching(n, axis), n.source.pitch[axis]
        if copies_miss(band, pitch, reach, abs(n.scale), COPY_SHARE * n.tol):
            continue
        raise ToleranceError(
            f"tol {n.tol:g} can't be kept by the {name}: samples {pitch:g} m apart in "
            f"{'yx'[axis]} send copies of the field to a target {n.distance:g} m away; sample "
            "finer, give the field's band= if it is narrower, or use the two-step transform"
        )


def interpolated_cells(span: Span, scale: float, error: float) -> tuple[Cells, float]:
    """The nodes that cells need for the way of a scale, and what they cost.

    Raises ToleranceError where the chirp turns too fast across the outermost cells.
    """
    n = span.numeric
    assert n.cells is not None
    nodes, costs = [], []
    for axis, side in enumerate(n.cells):
        turn = 2 * math.pi * _farthest_sample(span, axis) * side / abs(scale)
        count = cell_nodes(turn, error / 2, MOST_NODES)
        if not count:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept by a single Fresnel transform: the chirp turns by "
                f"{turn:.2g} rad across the outermost cells; use the Fresnel matrices"
            )
        nodes.append(count)
        costs.append(3 * cell_error(turn, count))
    return Cells(n.cells, (nodes[0], nodes[1])), sum(costs)


def _farthest_sample(span: Span, axis: int) -> float:
    """Metres of the outermost cell's centre from the middle of the cells."""
    source = span.source
    return (source.shape[axis] - 1) * source.pitch[axis] / 2
