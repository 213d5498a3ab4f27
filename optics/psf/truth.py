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
from optics.point.question import Question
from optics.pupil import wave_phase
from optics.stop.quadrature import Nodes, Steepness, count_nodes, stop_blocks

Array = NDArray[np.float64]

_FINER = 1.3
"""Of the judge's rule over a rule that should do."""

_TERMS = 5_000_000
"""Nodes times probes that a measurement may cost."""

_MOST, _FEWEST = 48, 4
_CHUNK = 1 << 21
_MOST_KEPT = 1 << 24

MARGIN = 2.0
"""An error is known from few samples: it counts twice."""


class Probe:
    """Some of a question's samples, with the exact light on them.

    The judge is a sum term by term, over a finer quadrature than the methods' own.
    """

    def __init__(self, question: Question) -> None:
        self._question = question.numeric
        self._rule: list[Nodes] | None = None
        self._samples: tuple[NDArray[np.int64], Array, Array] | None = None

    def measure(self, light: torch.Tensor) -> ErrorEstimate:
        """Relative L2 error of light (rows, columns), shares of a point's light."""
        values = light.detach().to(torch.float64).numpy()
        where, weight, truth = self._known(values)
        error = values.ravel()[where] - truth
        size = float((weight * truth**2).sum())
        if not size > 0:
            return ErrorEstimate(math.inf, "measured")
        return ErrorEstimate(
            MARGIN * math.sqrt(float((weight * error**2).sum()) / size),
            f"measured on {where.size} samples against exact quadrature",
        )

    def _known(self, light: Array) -> tuple[NDArray[np.int64], Array, Array]:
        """The samples, their weights, and the truth: drawn by the first light that is shown."""
        if self._samples is None:
            count = int(min(_MOST, max(_FEWEST, _TERMS // self._count)))
            rows, columns = self._question.inner
            number = np.arange(light.size).reshape(light.shape)[rows, columns].ravel()
            drawn, weight = _drawn(light[rows, columns], count)
            where = number[drawn]
            self._samples = (where, weight, self._light(where))
        return self._samples

    @cached_property
    def _finer(self) -> Steepness:
        steep = self._question.steepness
        return replace(
            steep,
            radial=lambda r: _FINER * steep.radial(r),
            around=lambda r: _FINER * steep.around(r),
            tilt=_FINER * steep.tilt,
        )

    @cached_property
    def _count(self) -> int:
        q = self._question
        return count_nodes(q.lens.stop, self._finer, 1e-2 * q.tol)

    def _blocks(self) -> Iterable[Nodes]:
        """The judge's nodes; kept where they are few."""
        if self._rule is not None:
            return self._rule
        q = self._question
        blocks = stop_blocks(q.lens.stop, self._finer, 1e-2 * q.tol, _CHUNK)
        if self._count > _MOST_KEPT:
            return blocks
        self._rule = list(blocks)
        return self._rule

    def _light(self, where: NDArray[np.int64]) -> Array:
        q = self._question
        rows, columns = np.divmod(where, q.samples.shape[1])
        y = q.samples.coordinates(0).numpy()[rows]
        x = q.samples.coordinates(1).numpy()[columns]
        field = np.zeros(where.size, dtype=np.complex128)
        factor = 2 * math.pi * q.radius / q.scale
        for nodes in self._blocks():
            phase = wave_phase(q.lens, q.distance, q.wavelength, nodes.y, nodes.x).numpy()
            ny, nx, weight = nodes.y.numpy(), nodes.x.numpy(), nodes.weight.numpy()
            step = _CHUNK // where.size + 1
            for start in range(0, nodes.count, step):
                part = slice(start, start + step)
                angle = phase[part] - factor * (np.outer(y, ny[part]) + np.outer(x, nx[part]))
                field += np.exp(1j * angle) @ weight[part]
        return np.asarray(q.share * np.abs(field) ** 2)


def _drawn(light: Array, count: int) -> tuple[NDArray[np.int64], Array]:
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
