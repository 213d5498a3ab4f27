"""The liquid crystal in time: it approaches each frame's phase exponentially.

A nematic cell relaxes to first order, phase(t) = end + (start - end) exp(-t / tau). Thesis §3.4
shows videos at 60 Hz, at which a cell with a tau of a few milliseconds never settles.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import torch

from optics.gauss_legendre import gauss_legendre
from optics.validation import require_amount, require_positive

_MOST_NODES = 40  # of a mean over a frame; chosen


def steady_start_phases(phases: torch.Tensor, frame_time: float, tau: float) -> torch.Tensor:
    """Compute the phase as each frame of an endlessly repeated video begins.

    The phases at which frames would settle are (frames, ...). Times are in seconds; with tau 0 the
    phase settles at once. Differentiable.
    """
    start = first_start_phase(phases, frame_time, tau)
    starts = []
    for phase in phases:
        starts.append(start)
        start = relaxed_phase(phase, start, frame_time, tau)
    return torch.stack(starts)


def first_start_phase(phases: torch.Tensor, frame_time: float, tau: float) -> torch.Tensor:
    """Compute the phase as the first frame begins: the geometric sum over all earlier cycles."""
    _require_times(frame_time, tau)
    if not len(phases):
        raise ValueError("phases has no frame; a video has one at least")
    if tau == 0:
        return phases[-1]
    n, frames = len(phases), frame_time / tau
    # `left` is the share of each frame that is left at the end of the cycle. The factor sums over
    # all earlier cycles. In this form no digits cancel if the crystal is slow.
    left = torch.exp(-frames * torch.arange(n - 1, -1, -1, dtype=torch.float64))
    weights = left * (math.expm1(-frames) / math.expm1(-n * frames))
    return torch.tensordot(weights.to(phases), phases, dims=1)


def relaxed_phase(end: torch.Tensor, start: torch.Tensor, time: float, tau: float) -> torch.Tensor:
    """Compute the phase `time` seconds after the crystal began to relax to `end`."""
    return end if tau == 0 else torch.lerp(end, start, math.exp(-time / tau))


def time_nodes(
    frame_time: float, tau: float, count: int
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return times in seconds, and their shares of the mean light, while the crystal relaxes.

    The rule is that of Gauss with `count` nodes in the variable exp(-t / tau), of which the light
    is an entire function for any phase; it is exact for polynomials up to the degree 2 count - 1.
    With tau 0, or for a crystal far quicker than a frame, there may be fewer nodes.
    """
    _require_times(frame_time, tau)
    if count < 1:
        raise ValueError(f"count is {count}; a mean takes one node or more")
    if tau == 0:
        return (frame_time,), (1.0,)
    left, shares = _time_quadrature(frame_time / tau, count)
    return tuple(-tau * math.log(value) for value in left), shares


def time_node_count(change: float, frame_time: float, tau: float, tol: float) -> int:
    """Find the fewest time nodes that average over the relaxation within `tol`.

    That is the error of the mean of exp(i change exp(-t / tau)), for the largest change of the
    phase within a frame in radians.
    """
    if tau == 0:
        return 1

    def mean(count: int) -> complex:
        left, shares = _time_quadrature(frame_time / tau, count)
        return complex(np.exp(1j * change * np.array(left)) @ np.array(shares))

    fine = mean(_MOST_NODES)
    for count in range(1, _MOST_NODES):
        if abs(mean(count) - fine) <= tol:
            return count
    raise ValueError(
        f"the phase changes by {change:.3g} rad within a frame, more than can be followed; "
        "wrap the video's phases into the panel's range"
    )


@lru_cache(maxsize=256)
def _time_quadrature(frames: float, count: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Compute Gauss' rule in time for a crystal that relaxes as exp(-t / tau).

    The rule averages functions of this variable over a frame, which lasts `frames` times tau. It
    follows Golub and Welsch (1969) from the three-term recursion of the measure. Lanczos' method
    finds the recursion on 120 nodes in time.
    """
    # After 36 time constants nothing is left in double precision.
    seen = min(frames, 36.0)
    time, weight = gauss_legendre(120)
    left, weight = np.exp(-seen * (time + 1) / 2), weight / 2 * (seen / frames)
    # For the rest of the frame the phase is constant.
    left, weight = np.append(left, math.exp(-seen)), np.append(weight, 1 - seen / frames)
    middle, scale = (left.max() + left.min()) / 2, (left.max() - left.min()) / 2 or 1.0
    nodes, shares = _gauss_rule_of_measure((left - middle) / scale, weight, count)
    nodes = np.clip(middle + scale * nodes, left.min(), left.max())
    return tuple(nodes.tolist()), tuple(shares.tolist())


def _gauss_rule_of_measure(
    x: np.ndarray, weight: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Compute Gauss' rule for a measure with weights on points x, by Lanczos' method.

    There are fewer than `count` nodes if these are exact already.
    """
    basis = [np.sqrt(weight)]
    diagonal, beside = [float(basis[0] @ (x * basis[0]))], []
    while len(diagonal) < count:
        rest = x * basis[-1]
        for _ in range(2):  # A single pass isn't orthogonal enough.
            for known in basis:
                rest = rest - (known @ rest) * known
        length = float(np.linalg.norm(rest))
        if length < 1e-14:
            break
        basis.append(rest / length)
        beside.append(length)
        diagonal.append(float(basis[-1] @ (x * basis[-1])))
    matrix = np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1)
    nodes, vectors = np.linalg.eigh(matrix)
    return nodes, vectors[0] ** 2


def _require_times(frame_time: float, tau: float) -> None:
    require_positive("frame_time", frame_time, "s")
    require_amount("tau", tau, "s")
