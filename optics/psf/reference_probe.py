"""Measure errors of light against exact integrals at a few samples."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import ErrorEstimate, MachineSpeed
from optics.camera.pupil import pupil_phase
from optics.camera.stop_nodes import (
    PhaseSlopeBound,
    QuadratureNodes,
    count_nodes,
    rule_seconds,
    stop_rule_blocks,
)
from optics.psf.request import PSFRequest

Array = NDArray[np.float64]

_CHUNK = 1 << 21

ERROR_MARGIN = 2.0
"""Factor on an error that was measured at few samples."""

PASSES_PER_ABERRATION = 35.0
"""Passes over a node of the stop while one of the lens' aberrations is evaluated; measured."""

_KERNEL_COST = 3.0  # time of a kernel's values over that of their cosines and sines alone; measured


# Factor on the phase's slope for which the reference's nodes are chosen. Chosen.
_REFERENCE_REFINEMENT = 1.3

_MAX_TERMS = 5_000_000  # most terms, nodes times lines, of a measurement. Chosen.

_MAX_LINES = 7  # most rows, and most columns, at whose crossings the error is measured. Chosen.

_MIN_LINES = 2  # fewest of them. Chosen.


class ReferenceProbe:
    """Computes the exact light at some samples of a request, to measure errors.

    The reference is a direct sum over a finer quadrature than that of the engines. The samples are
    the crossings of some rows and columns, so that the kernel's factors are computed along either
    axis only.
    """

    def __init__(self, request: PSFRequest) -> None:
        self._request = request.numeric
        self._cached_samples: _ProbedSamples | None = None

    def measure_error(self, light: torch.Tensor) -> ErrorEstimate:
        """Measure the relative L2 error of light, (rows, columns), against exact quadrature."""
        values = light.detach().to(torch.float64).numpy()
        seen = values[self._request.window_slices]
        size = float(np.linalg.norm(seen))
        if not 0 < size < math.inf:
            return ErrorEstimate(math.inf, "measured")
        probed = self._probed_samples(values)
        error = values[np.ix_(probed.rows, probed.columns)] - probed.light
        drawn = ERROR_MARGIN * math.sqrt(float((probed.weight * error**2).sum()))
        # Nodes and transforms err most at the window's rim, which few drawn lines cross.
        rim = np.concatenate([error[-2:].ravel(), error[:-2, -2:].ravel()])
        everywhere = math.sqrt(float((rim**2).mean()) * seen.size)
        return ErrorEstimate(
            max(drawn, everywhere) / size,
            f"measured on {error.size} samples against exact quadrature",
        )

    def _probed_samples(self, light: Array) -> _ProbedSamples:
        """Return the samples that are checked, their weights, and the exact light there.

        The first light that is measured determines which samples are drawn.
        """
        if self._cached_samples is None:
            count = self._lines_per_axis
            rows, columns = self._request.window_slices
            seen = np.abs(light[rows, columns])
            (y, wy), (x, wx) = (draw_samples(seen.sum(axis), count) for axis in (1, 0))
            # The outermost lines come last, and have no weight among the drawn ones.
            y, x = (
                np.concatenate([lines, [0, last]]) + margin
                for lines, last, margin in zip(
                    (y, x), (n - 1 for n in seen.shape), self._request.margin, strict=True
                )
            )
            weight = np.outer(np.append(wy, [0, 0]), np.append(wx, [0, 0]))
            self._cached_samples = _ProbedSamples(y, x, weight, self._exact_light(y, x))
        return self._cached_samples

    @property
    def _lines_per_axis(self) -> int:
        affordable = _MAX_TERMS // (2 * self._reference_node_count)
        return int(min(_MAX_LINES, max(_MIN_LINES, affordable)))

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds of the reference and one measurement."""
        nodes, lines = self._reference_node_count, self._lines_per_axis
        rows, columns = self._request.samples.shape
        kernels = _KERNEL_COST * nodes * (4 * lines + 2) * speed.cosine
        wave = PASSES_PER_ABERRATION * nodes * len(self._request.lens.aberrations) * speed.touch
        sums = 2 * nodes * lines**2 * speed.multiply_add * speed.double
        rule = rule_seconds(
            self._request.lens.stop, self._reference_slope_bound, self._reference_tol, speed
        )
        return rule + kernels + wave + sums + 5 * rows * columns * speed.touch

    @cached_property
    def _reference_slope_bound(self) -> PhaseSlopeBound:
        planned, finer = self._request.phase_slope_bound, _REFERENCE_REFINEMENT
        return replace(
            planned,
            radial=lambda r: finer * planned.radial(r),
            azimuthal=lambda r: finer * planned.azimuthal(r),
            tilt=finer * planned.tilt,
        )

    @property
    def _reference_tol(self) -> float:
        return 1e-2 * self._request.tol

    @cached_property
    def _reference_node_count(self) -> int:
        stop = self._request.lens.stop
        return count_nodes(stop, self._reference_slope_bound, self._reference_tol)

    def _reference_blocks(self) -> Iterable[QuadratureNodes]:
        stop = self._request.lens.stop
        return stop_rule_blocks(stop, self._reference_slope_bound, self._reference_tol, _CHUNK)

    def _exact_light(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
        """Compute the light where some rows and columns cross, by a direct sum over nodes."""
        q = self._request
        factor = 2 * math.pi * q.radius / q.scale
        y, x = (
            factor * q.samples.coordinates(axis)[torch.from_numpy(lines)][:, None]
            for axis, lines in enumerate((rows, columns))
        )
        field = torch.zeros(rows.size, columns.size, dtype=torch.complex128)
        step = _CHUNK // (rows.size + columns.size) + 1
        for nodes in self._reference_blocks():
            for start in range(0, nodes.count, step):
                part = slice(start, start + step)
                ny, nx, weight = nodes.y[part], nodes.x[part], nodes.weight[part]
                phase = pupil_phase(q.lens, q.distance, q.wavelength, ny, nx)
                field += (_phasors(phase - y * ny) * weight) @ _phasors(-x * nx).T
        return np.asarray(q.intensity_scale * field.abs().square().numpy())


@dataclass(frozen=True)
class _ProbedSamples:
    """Holds the samples that are checked: lines that cross, weights, the exact light."""

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    weight: Array
    light: Array


def _phasors(angle: torch.Tensor) -> torch.Tensor:
    """Return exp(i angle); torch.polar would take twenty times as long."""
    return torch.complex(torch.cos(angle), torch.sin(angle))


def draw_samples(light: Array, count: int) -> tuple[NDArray[np.int64], Array]:
    """Draw samples, or lines of them: their numbers, and one over how often each is expected.

    Half of the probability is in proportion to the light, because errors count most where it is
    bright, and half is even. The draw is always the same: one in each of `count` parts of equal
    probability. The numbers count along the raveled light.
    """
    flat = np.abs(light).ravel()
    if flat.size <= count:
        return np.arange(flat.size), np.ones(flat.size)
    total = float(flat.sum())
    if 0 < total < math.inf:
        # In place: fresh memory takes most of the time in a large window.
        chance = flat
        chance *= 0.5 / total
        chance += 0.5 / flat.size
    else:
        chance = np.full(flat.size, 1 / flat.size)
    places = (np.arange(count) + np.random.default_rng(0).random(count)) / count
    summed = np.cumsum(chance)
    where = np.minimum(np.searchsorted(summed, places * summed[-1]), flat.size - 1)
    return where, 1 / (count * chance[where])
