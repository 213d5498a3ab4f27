"""Coupling of neighbouring pixels: fringing fields blur the phase across edges.

The blurred phase is the staircase of the pixels' phases, convolved with a Gaussian (Persson,
Engström and Goksör, Opt. Express 20, 22334, 2012, doi 10.1364/OE.20.022334; Moser et al., Opt.
Express 27, 25046, 2019, doi 10.1364/OE.27.025046). The blur acts on the phase as displayed. Where
the phase is wrapped by a wave, it therefore makes a steep transition (a fly-back).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from scipy.special import ndtr
from torch.nn.functional import pad

from optics.gauss_legendre import gauss_legendre

TOL = 3e-3  # error of a pixel's mean field next to the largest phase step; smaller elsewhere
_REACH = 4.9  # standard deviations beyond which a Gaussian holds a millionth of its area
NodesAndWeights = tuple[np.ndarray, np.ndarray]  # of quadrature, from -1/2 to 1/2 across a pixel

# For each quadrature node along an axis: its weight, and the weights of the neighbouring pixels'
# phases in the phase at the node.
QuadratureRule = tuple[tuple[float, tuple[float, ...]], ...]


def fringing_field_mean(
    phase: torch.Tensor, sigma: float, side: float, nodes: int | None = None
) -> torch.Tensor:
    """Compute each pixel's complex mean field, with the phase blurred by fringing fields.

    The blurred staircase is a sum of error functions, which can be evaluated at any point. The mean
    of exp(i blurred phase) over the pixel's active area is taken over Gauss-Legendre nodes, so that
    no array is finer than the panel. The panel's outermost pixels are continued. The result is
    differentiable. The nodes are computed again for the gradient, so that the memory stays that of
    a few pictures. Raises ValueError for phase steps that need more than 32 nodes.

    phase: radians, (..., rows, columns). sigma: standard deviation of the blur, in pixels. side: of
    the square that modulates, in pixels. nodes: points along a pixel's side of which the mean is
    taken; by default as many as the largest phase step needs to keep the error to TOL.
    """
    if nodes is None:
        down, along = (
            _quadrature_rule(sigma, side, _rounded_largest_step(phase, axis)) for axis in (-2, -1)
        )
    else:
        down = along = _nodes(sigma, _gauss_nodes_on((-side / 2, side / 2), nodes))
    return _FringingFieldMean.apply(phase, down, along)  # type: ignore[no-untyped-call]


class _FringingFieldMean(torch.autograd.Function):
    """Mean field over nodes, with a derivative by the transposed filters."""

    @staticmethod
    def forward(
        ctx: Any, phase: torch.Tensor, down: QuadratureRule, along: QuadratureRule
    ) -> torch.Tensor:
        ctx.save_for_backward(phase)
        ctx.rules = down, along
        real, imaginary = torch.zeros_like(phase), torch.zeros_like(phase)
        for height, high in down:
            rows = _filter_axis(phase, high, -2)
            for width, wide in along:
                angle = _filter_axis(rows, wide, -1)
                real.add_(torch.cos(angle), alpha=height * width)
                imaginary.add_(torch.sin(angle), alpha=height * width)
        return torch.complex(real, imaginary)

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        (phase,), (down, along) = ctx.saved_tensors, ctx.rules
        total = torch.zeros_like(phase)
        for height, high in down:
            rows, back = _filter_axis(phase, high, -2), torch.zeros_like(phase)
            for width, wide in along:
                angle = _filter_axis(rows, wide, -1)
                turned = gradient.imag * torch.cos(angle) - gradient.real * torch.sin(angle)
                back.add_(_filter_axis_transpose(turned, wide, -1), alpha=height * width)
            total.add_(_filter_axis_transpose(back, high, -2))
        return total, None, None


def _filter_axis(values: torch.Tensor, taps: tuple[float, ...], axis: int) -> torch.Tensor:
    """Blur the phase along an axis by weights of neighbours; edge pixels are continued."""
    reach, n = len(taps) // 2, values.shape[axis]
    margins = (reach, reach, 0, 0) if axis == -1 else (0, 0, reach, reach)
    wide = pad(values.reshape(-1, *values.shape[-2:]), margins, mode="replicate")
    total = taps[0] * wide.narrow(axis, 0, n)
    for k, weight in enumerate(taps[1:], 1):
        total.add_(wide.narrow(axis, k, n), alpha=weight)
    return total.reshape(values.shape)


def _filter_axis_transpose(
    values: torch.Tensor, taps: tuple[float, ...], axis: int
) -> torch.Tensor:
    """Apply the transpose of _filter_axis()."""
    reach, n = len(taps) // 2, values.shape[axis]
    margins = (reach, reach, 0, 0) if axis == -1 else (0, 0, reach, reach)
    wide = pad(torch.zeros_like(values), margins)
    for k, weight in enumerate(taps):
        wide.narrow(axis, k, n).add_(values, alpha=weight)
    total = wide.narrow(axis, reach, n).clone()
    total.narrow(axis, 0, 1).add_(wide.narrow(axis, 0, reach).sum(axis, keepdim=True))
    total.narrow(axis, n - 1, 1).add_(wide.narrow(axis, n + reach, reach).sum(axis, keepdim=True))
    return total


def _rounded_largest_step(phase: torch.Tensor, axis: int) -> float:
    """Return the largest phase step along an axis, up to a power of √2: few rules are cached."""
    steps = phase.detach().diff(dim=axis)
    step = float(steps.abs().max()) if steps.numel() else 0.0
    return 2.0 ** (math.ceil(2 * math.log2(step)) / 2) if step > 0 else 0.0


@lru_cache(maxsize=256)
def _quadrature_rule(sigma: float, side: float, step: float) -> QuadratureRule:
    """Find the fewest nodes that average the field, next to a phase step, with an error of TOL."""
    if step == 0:
        return ((1.0, (1.0,)),)
    known = _test_phases(step, _neighbour_reach(sigma, side))
    # A rule of 400 nodes is the reference.
    truth = _mean_fields(known, sigma, next(_candidate_nodes(sigma, side, 400)))
    for count in range(1, 33):
        for places in _candidate_nodes(sigma, side, count):
            if np.abs(_mean_fields(known, sigma, places) - truth).max() <= TOL:
                return _nodes(sigma, places)
    raise ValueError(
        f"the phase steps by {step:.3g} rad between neighbours, which a coupling of {sigma:.3g} "
        "pixels can't be followed over; wrap the phase into the panel's range"
    )


def _neighbour_reach(sigma: float, side: float) -> int:
    """Count the neighbours on each side whose phase affects a pixel's active area."""
    return max(1, math.ceil(side / 2 - 0.5 + _REACH * sigma))


def _candidate_nodes(sigma: float, side: float, count: int) -> Iterator[NodesAndWeights]:
    """Yield placements of `count` nodes in a pixel: over all of it, or most at its edges."""
    yield _gauss_nodes_on((-side / 2, side / 2), count)
    flat = 0.5 - _REACH * sigma
    if 0 < flat < side / 2 and count % 2 and count >= 5:
        edge = _gauss_nodes_on((flat, side / 2), count // 2)
        share = (side / 2 - flat) / side
        yield (
            np.concatenate([-edge[0], [0.0], edge[0]]),
            np.concatenate([share * edge[1], [1 - 2 * share], share * edge[1]]),
        )


def _gauss_nodes_on(ends: tuple[float, float], count: int) -> NodesAndWeights:
    place, weight = gauss_legendre(count)
    return (ends[0] + ends[1] + place * (ends[1] - ends[0])) / 2, weight / 2


def _nodes(sigma: float, places: NodesAndWeights) -> QuadratureRule:
    reach = _neighbour_reach(sigma, 2 * float(places[0].max()))
    taps = _neighbour_weights(sigma, places[0], reach).tolist()
    return tuple((float(w), tuple(t)) for w, t in zip(places[1], taps, strict=True))


def _neighbour_weights(sigma: float, place: np.ndarray, reach: int) -> np.ndarray:
    """Compute the weights of the neighbours' phases at places in a pixel, (places, neighbours)."""
    edges = (np.arange(-reach, reach) + 0.5 - place[:, None]) / sigma
    # The last neighbours also get the weights of all pixels beyond them, so that the sum is one.
    return np.diff(ndtr(edges), axis=1, prepend=0, append=1)


def _test_phases(step: float, beside: int) -> np.ndarray:
    """Return an edge, a line, stripes, a slope and a valley around a pixel, (cases, neighbours)."""
    n = np.arange(-beside, beside + 1)
    edge, line, stripes = n > 0, n == 0, n % 2
    slope, valley = np.sign(n), np.where(n < 0, 0.5, n > 0)
    return step * np.array([edge, line, stripes, slope, valley], dtype=np.float64)


def _mean_fields(phases: np.ndarray, sigma: float, places: NodesAndWeights) -> np.ndarray:
    taps = _neighbour_weights(sigma, places[0], phases.shape[1] // 2)
    return np.exp(1j * phases @ taps.T) @ places[1]
