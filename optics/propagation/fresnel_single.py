"""Propagate light by Fresnel's integral, computed with a single Fourier transform."""

from __future__ import annotations

import math

from optics.accuracy import ToleranceError
from optics.propagation.chirped import (
    CellSampling,
    ChirpedPropagator,
    ChirpedTransform,
    envelope_error,
    envelope_node_count,
)
from optics.propagation.paraxial import kernel_turns
from optics.propagation.precision import working_precision
from optics.propagation.replicas import field_band, replicas_miss_target, target_ray_frequencies
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.spectral_propagator import transform_error_share
from optics.propagation.tolerance_shares import TOLERANCE_SHARES


class SingleFresnel(ChirpedPropagator):
    """Propagate by one Fourier transform between two chirps (section 4.2.1 of Goodman).

    The target may have any pitch and window. A smooth field is summed over its samples, which
    requires a distance at which no replica of its spectrum sends light to the target
    (optics.propagation.replicas). Cells are exact at any distance, but at short distances they
    need one transform for each of several nodes (optics.propagation.chirped).
    """

    name = "single Fresnel transform"

    def __init__(self, span: FreeSpaceSpan) -> None:
        super().__init__(span)
        n = self._paraxial_span.numeric
        shares = TOLERANCE_SHARES
        cells, sampling = None, shares.sampling * n.sampling_tol
        if n.cells is None:
            require_replicas_miss_target(self.name, n)
        else:
            cells, sampling = plan_cell_sampling(n, n.scale, sampling)
        share, turns = shares.sampling + 2 * shares.transform, kernel_turns(self._paraxial_span)
        self.dtype, self.arithmetic = working_precision(n.tol - self._model_error, turns, share)
        step = ChirpedTransform(
            n.source, span.target, span.scale, self.dtype, n.budget,
            error=transform_error_share(n), cells=cells,
        )  # fmt: skip
        self._steps = (step,)
        self._set_error_bound(
            self._model_error + sampling + 2 * step.error, share, self._model_error
        )
        terms = f", {cells.nodes[1]}x{cells.nodes[0]} nodes" if cells else ""
        rows, columns = n.source.shape
        self.sampling = f"{columns}x{rows} source samples{terms}, {step.name}"


def require_replicas_miss_target(name: str, span: FreeSpaceSpan) -> None:
    """Raise ToleranceError if a replica of a smooth field's spectrum propagates to the target."""
    n = span.numeric
    for axis in (0, 1):
        band, reach, pitch = (
            field_band(n, axis),
            target_ray_frequencies(n, axis),
            n.source.pitch[axis],
        )
        allowed = TOLERANCE_SHARES.replica * n.sampling_tol
        if replicas_miss_target(band, pitch, reach, abs(n.scale), allowed):
            continue
        raise ToleranceError(
            f"tol {n.tol:g} can't be kept by the {name}: samples {pitch:g} m apart in "
            f"{'yx'[axis]} send copies of the field to a target {n.distance:g} m away; sample "
            "finer, give the field's band= if it is narrower, or use the two-step transform"
        )


def plan_cell_sampling(
    span: FreeSpaceSpan, scale: float, error: float
) -> tuple[CellSampling, float]:
    """Return the envelope nodes for cells in Fresnel propagation, and the resulting error.

    scale: wavelength times distance of the transform, square metres. error: the error allowed.
    Raises ToleranceError if the chirp varies too fast across the outermost cells.
    """
    n = span.numeric
    assert n.cells is not None
    nodes, costs = [], []
    for axis, side in enumerate(n.cells):
        farthest = (span.source.shape[axis] - 1) * span.source.pitch[axis] / 2
        turn = 2 * math.pi * farthest * side / abs(scale)
        # With more than 6 nodes, and so transforms, along an axis, other methods are cheaper.
        count = envelope_node_count(turn, error / 2, 6)
        if not count:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept by a single Fresnel transform: the chirp turns by "
                f"{turn:.2g} rad across the outermost cells; use the Fresnel matrices"
            )
        nodes.append(count)
        costs.append(3 * envelope_error(turn, count))
    return CellSampling(n.cells, (nodes[0], nodes[1])), sum(costs)
