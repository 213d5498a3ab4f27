"""The exact integral at a few samples, to measure what a method's error really is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import ErrorEstimate
from optics.point.request import PSFRequest
from optics.pupil import pupil_phase
from optics.stop.quadrature import PhaseSlopeBound, QuadratureNodes, count_nodes, stop_rule_blocks

Array = NDArray[np.float64]

_REFERENCE_REFINEMENT = 1.3
"""Of the judge's rule over a rule that should do."""

_MAX_TERMS = 5_000_000
"""Nodes times probes that a measurement may cost."""

_MAX_SAMPLES, _MIN_SAMPLES = 48, 4
_CHUNK = 1 << 21
_MAX_CACHED_NODES = 1 << 24

ERROR_MARGIN = 2.0
"""An error is known from few samples: it counts twice."""


class ReferenceProbe:
    """Some of a request's samples, with the exact light on them.

    The judge is a sum term by term, over a finer quadrature than the methods' own.
    """

    def __init__(self, request: PSFRequest) -> None:
        self._request = request.numeric
        self._cached_nodes: list[QuadratureNodes] | None = None
        self._cached_samples: tuple[NDArray[np.int64], Array, Array] | None = None

    def measure_error(self, light: torch.Tensor) -> ErrorEstimate:
        """Relative L2 error of light (rows, columns), shares of a point's light."""
        values = light.detach().to(torch.float64).numpy()
        where, weight, truth = self._reference_samples(values)
        error = values.ravel()[where] - truth
        size = float((weight * truth**2).sum())
        if not size > 0:
            return ErrorEstimate(math.inf, "measured")
        return ErrorEstimate(
            ERROR_MARGIN * math.sqrt(float((weight * error**2).sum()) / size),
            f"measured on {where.size} samples against exact quadrature",
        )

    def _reference_samples(self, light: Array) -> tuple[NDArray[np.int64], Array, Array]:
        """The samples, their weights, and the truth: drawn by the first light that is shown."""
        if self._cached_samples is None:
            count = int(
                min(_MAX_SAMPLES, max(_MIN_SAMPLES, _MAX_TERMS // self._reference_node_count))
            )
            rows, columns = self._request.window_slices
            number = np.arange(light.size).reshape(light.shape)[rows, columns].ravel()
            sample_indices, weight = _draw_samples(light[rows, columns], count)
            where = number[sample_indices]
            self._cached_samples = (where, weight, self._reference_light(where))
        return self._cached_samples

    @cached_property
    def _reference_slope_bound(self) -> PhaseSlopeBound:
        steep = self._request.phase_slope_bound
        return replace(
            steep,
            radial=lambda r: _REFERENCE_REFINEMENT * steep.radial(r),
            azimuthal=lambda r: _REFERENCE_REFINEMENT * steep.azimuthal(r),
            tilt=_REFERENCE_REFINEMENT * steep.tilt,
        )

    @cached_property
    def _reference_node_count(self) -> int:
        q = self._request
        return count_nodes(q.lens.stop, self._reference_slope_bound, 1e-2 * q.tol)

    def _reference_blocks(self) -> Iterable[QuadratureNodes]:
        """The judge's nodes; kept where they are few."""
        if self._cached_nodes is not None:
            return self._cached_nodes
        q = self._request
        blocks = stop_rule_blocks(q.lens.stop, self._reference_slope_bound, 1e-2 * q.tol, _CHUNK)
        if self._reference_node_count > _MAX_CACHED_NODES:
            return blocks
        self._cached_nodes = list(blocks)
        return self._cached_nodes

    def _reference_light(self, where: NDArray[np.int64]) -> Array:
        q = self._request
        rows, columns = np.divmod(where, q.samples.shape[1])
        y = q.samples.coordinates(0).numpy()[rows]
        x = q.samples.coordinates(1).numpy()[columns]
        field = np.zeros(where.size, dtype=np.complex128)
        factor = 2 * math.pi * q.radius / q.scale
        for nodes in self._reference_blocks():
            phase = pupil_phase(q.lens, q.distance, q.wavelength, nodes.y, nodes.x).numpy()
            ny, nx, weight = nodes.y.numpy(), nodes.x.numpy(), nodes.weight.numpy()
            step = _CHUNK // where.size + 1
            for start in range(0, nodes.count, step):
                part = slice(start, start + step)
                angle = phase[part] - factor * (np.outer(y, ny[part]) + np.outer(x, nx[part]))
                field += np.exp(1j * angle) @ weight[part]
        return np.asarray(q.intensity_scale * np.abs(field) ** 2)


def _draw_samples(light: Array, count: int) -> tuple[NDArray[np.int64], Array]:
    """Samples, drawn half by their light, where errors weigh most, and half evenly; and one
    over the probability of each. The draw is always the same."""
    rng = np.random.default_rng(0)
    flat = np.abs(light).ravel()
    total = float(flat.sum())
    even = np.full(flat.size, 1 / flat.size)
    chance = even if not 0 < total < math.inf else 0.5 * even + 0.5 * flat / total
    if flat.size <= count:
        return np.arange(flat.size), np.ones(flat.size)
    where = rng.choice(flat.size, size=count, p=chance)
    return where, 1 / chance[where]
