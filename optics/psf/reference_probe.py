"""Measure the error of a PSF against exact integrals at a few samples."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import ErrorEstimate
from optics.psf_engines.request import PSFRequest
from optics.pupil import pupil_phase
from optics.stop.quadrature import PhaseSlopeBound, QuadratureNodes, count_nodes, stop_rule_blocks

Array = NDArray[np.float64]

_CHUNK = 1 << 21
_MAX_CACHED_NODES = 1 << 24

ERROR_MARGIN = 2.0
"""Factor on an error that was measured at few samples."""


@dataclass(frozen=True)
class ReferenceProbeSettings:
    """Tune how the error of a PSF is measured.

    Attributes
    ----------
    refinement : float
        Factor on the phase's slope for which the reference's nodes are chosen. Chosen.
    max_terms : int
        Most terms, nodes times samples, of a measurement. Chosen.
    max_samples : int
        Most samples at which the error is measured. Chosen.
    min_samples : int
        Fewest samples at which the error is measured. Chosen.
    """

    refinement: float = 1.3
    max_terms: int = 5_000_000
    max_samples: int = 48
    min_samples: int = 4


_SETTINGS = ReferenceProbeSettings()


class ReferenceProbe:
    """Computes the exact light at some samples of a PSF request, to measure errors.

    The reference is a direct sum over a finer quadrature than that of the PSF engines.
    """

    def __init__(self, request: PSFRequest) -> None:
        self._request = request.numeric
        self._cached_nodes: list[QuadratureNodes] | None = None
        self._cached_samples: tuple[NDArray[np.int64], Array, Array] | None = None

    def measure_error(self, light: torch.Tensor) -> ErrorEstimate:
        """Measure the relative L2 error of a PSF, (rows, columns), against exact quadrature."""
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
        """Return the samples at which a PSF is checked, their weights, and the exact light there.

        The first PSF that is measured determines which samples are drawn.
        """
        if self._cached_samples is None:
            affordable = _SETTINGS.max_terms // self._reference_node_count
            count = int(min(_SETTINGS.max_samples, max(_SETTINGS.min_samples, affordable)))
            rows, columns = self._request.window_slices
            number = np.arange(light.size).reshape(light.shape)[rows, columns].ravel()
            sample_indices, weight = _draw_samples(light[rows, columns], count)
            where = number[sample_indices]
            self._cached_samples = (where, weight, self._reference_light(where))
        return self._cached_samples

    @cached_property
    def _reference_slope_bound(self) -> PhaseSlopeBound:
        planned, finer = self._request.phase_slope_bound, _SETTINGS.refinement
        return replace(
            planned,
            radial=lambda r: finer * planned.radial(r),
            azimuthal=lambda r: finer * planned.azimuthal(r),
            tilt=finer * planned.tilt,
        )

    @cached_property
    def _reference_node_count(self) -> int:
        q = self._request
        return count_nodes(q.lens.stop, self._reference_slope_bound, 1e-2 * q.tol)

    def _reference_blocks(self) -> Iterable[QuadratureNodes]:
        """Return the nodes of the reference PSF in blocks; they are cached if they are few."""
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
    """Draw samples of a PSF at random; return them and one over the probability of each.

    Half of the probability is in proportion to the light, because errors count most where it is
    bright, and half is even. The draw is always the same.
    """
    rng = np.random.default_rng(0)
    flat = np.abs(light).ravel()
    total = float(flat.sum())
    even = np.full(flat.size, 1 / flat.size)
    chance = even if not 0 < total < math.inf else 0.5 * even + 0.5 * flat / total
    if flat.size <= count:
        return np.arange(flat.size), np.ones(flat.size)
    where = rng.choice(flat.size, size=count, p=chance)
    return where, 1 / chance[where]
