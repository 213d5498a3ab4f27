"""Choose the order of the panel's phase range in which each phase of a video is shown.

A phase and the same phase plus whole waves give the same light once the liquid crystal has settled,
but not while it moves, because it passes through all phases between two frames. A panel with a
range of several waves has a choice of orders.
"""

from __future__ import annotations

import math

import torch

_TURN = 2 * math.pi
_AT_A_TIME = 1 << 20
"""Number of phases of a video that are processed at once, so that their orders fit in memory."""


def shortest_phase_paths(phases: torch.Tensor, reach: float) -> torch.Tensor:
    """Add whole waves to a retrieved video's phases, so that every pixel takes the shortest steps.

    phases: (frames, rows, columns), radians, of any order. reach: the panel's range in radians, one
    wave at least. For each pixel, the sum of the squared steps between the frames of the repeated
    video is least. The solution is exact, by dynamic programming over the orders of every pixel,
    once for each order of the first frame. The result is (frames, rows, columns), float32, within 0
    to `reach`. Raises ValueError for a reach of less than a wave.
    """
    if reach < _TURN * (1 - 1e-9):
        raise ValueError(
            f"reach is {reach / math.pi:.2f} pi; a pattern needs 2 pi: choose a shorter wavelength"
        )
    wrapped = torch.remainder(phases.to(torch.float64), _TURN).to(torch.float32)
    flat = wrapped.reshape(len(phases), -1)
    pixels = max(1, _AT_A_TIME // len(phases))
    parts = [_shortest_paths_of_block(part, reach) for part in torch.split(flat, pixels, dim=1)]
    return torch.cat(parts, dim=1).reshape(phases.shape)


def _shortest_paths_of_block(phases: torch.Tensor, reach: float) -> torch.Tensor:
    """Compute shortest_phase_paths() for a block of retrieved phases within the first wave.

    The block is (frames, pixels).
    """
    orders = math.ceil(reach / _TURN)
    offsets = _TURN * torch.arange(orders, dtype=phases.dtype)
    # The shape is (frames, orders, pixels). Phases that the panel can't show cost more than any
    # path.
    shown = phases[:, None] + offsets[:, None]
    beyond = torch.where(shown > max(reach, _TURN), 1e6, 0.0)
    best, least = phases, torch.full(phases.shape[1:], math.inf, dtype=phases.dtype)
    for first in range(orders):
        way, cost = _cheapest_path(shown, beyond, first)
        better = cost < least
        best = torch.where(better, way, best)
        least = torch.where(better, cost, least)
    return best


def _cheapest_path(
    shown: torch.Tensor, beyond: torch.Tensor, first: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return a retrieved video's cheapest phase path from order `first`, and the path's cost.

    The path is (frames, pixels). It is closed: the repeated video returns to the first frame.
    """
    frames, orders, pixels = shown.shape
    cost = torch.full((orders, pixels), math.inf, dtype=shown.dtype)
    cost[first] = beyond[0, first]
    came_from = []
    for frame in range(1, frames):
        steps = (shown[frame][:, None] - shown[frame - 1][None, :]).square() + cost[None, :]
        least, order = steps.min(dim=1)
        cost = least + beyond[frame]
        came_from.append(order)
    closing = cost + (shown[0, first] - shown[-1]).square()
    total, order = closing.min(dim=0)
    way = [shown[-1].gather(0, order[None])[0]]
    for frame in range(frames - 2, -1, -1):
        order = came_from[frame].gather(0, order[None])[0]
        way.insert(0, shown[frame].gather(0, order[None])[0])
    return torch.stack(way), total
