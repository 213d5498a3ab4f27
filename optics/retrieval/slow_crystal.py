"""Find videos for a liquid crystal that responds slowly.

Each frame's phase is shown in the order of the panel's range that the crystal reaches best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from optics.camera import Panel
from optics.retrieval.far_field import FarField
from optics.retrieval.frame_averaging import (
    correct_request,
    joint_frames,
    mean_intensity,
    scale_to_mean,
)
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import RetrievalJob, Superpixels
from optics.slm import grey_to_phase, max_phase, phase_to_grey
from optics.slm.dynamics import relaxed_phase, steady_start_phases, time_nodes
from optics.slm.lut import flatness_phase, whole_waves

_TURN = 2 * math.pi
# Number of phases of a video that are processed at once, so that their orders fit in memory.
_AT_A_TIME = 1 << 20


def shortest_phase_paths(phases: torch.Tensor, reach: float) -> torch.Tensor:
    """Add whole waves to a video's phases, so that every pixel takes the shortest steps.

    For each pixel, the sum of the squared steps between the frames of the repeated video is least.
    The solution is exact, by dynamic programming over the orders of every pixel, once for each
    order of the first frame. The result is float32, within 0 to `reach`.

    phases: (frames, rows, columns), radians, of any order.
    reach: the panel's range in radians; ValueError for less than a wave.
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
    """Compute shortest_phase_paths() for phases within the first wave, (frames, pixels)."""
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
    """Return a video's cheapest phase path from order `first`, and the path's cost.

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


# Share of the iterations, at the start, that ignore the motion. They are faster. Chosen.
_SHARE_WITHOUT_MOTION = 0.6

# Moments per frame at which the light is computed, in iterations and for the quality. Chosen.
_NODES, _QUALITY_NODES = 3, 6


@dataclass(frozen=True)
class LiquidCrystal:
    """Timing and phase range of a panel's liquid crystal."""

    frame_time: float
    """Seconds for which a frame is shown."""
    response_time: float
    """Time constant of the first-order relaxation, seconds."""
    reach: float
    """Largest phase that the panel shows, radians, one wave at least."""


def usable_orders(panel: Panel, wavelength: float) -> int:
    """Return the number of whole waves in the panel's range that phases may use, one at least."""
    return max(1, whole_waves(panel, wavelength))


def crystal_of_goal(goal: RetrievalGoal) -> LiquidCrystal:
    """Return the timing and phase range of the goal's panel."""
    panel = goal.camera.panel
    orders = usable_orders(panel, goal.wavelength)
    # A phase that is closer to the next whole wave than to the last grey level is shown as the
    # first level.
    half = 0.5 * max_phase(panel, goal.wavelength) / (panel.levels - 1)
    reach = max(2 * math.pi, 2 * math.pi * orders - half)
    return LiquidCrystal(1 / panel.frame_rate, panel.response_time, reach)


def shortest_panel_phases(goal: RetrievalGoal, phases: torch.Tensor) -> torch.Tensor:
    """Return a video's phases, (frames, rows, columns), with the shortest steps the panel can show.

    The result is float32. The paths of shortest_phase_paths() start at the phase of the panel's
    first grey level, which isn't zero everywhere.
    """
    panel, wavelength = goal.camera.panel, goal.wavelength
    ground = grey_to_phase(panel, torch.zeros(panel.shape, dtype=torch.uint8), wavelength)
    if panel.flatness is not None:
        ground = ground + flatness_phase(panel, wavelength)
    ground = ground.to(torch.float32)
    return shortest_phase_paths(phases - ground, crystal_of_goal(goal).reach) + ground


def slow_crystal_frames(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
    """Compute frames whose mean light on a slow crystal has the target's shape.

    The mean includes the liquid crystal's motion. Returns fields on the window, (frames, rows,
    columns). Their phases must be shown as shortest_panel_phases() gives them, in a repeated video.
    """
    crystal, iterations = crystal_of_goal(job.goal), job.iterations
    before = max(1, round(_SHARE_WITHOUT_MOTION * iterations))
    first = replace(job, iterations=before, progress=job.progress.part(0, 0.2))
    fields = list(joint_frames(pixels, first))
    wanted = target = pixels.target_intensity
    rest = job.progress.part(0.2, 1)
    for iteration in range(before, iterations):
        done = (iteration - before) / (iterations - before)
        rest.report(done, f"moving frames {iteration + 1}/{iterations}")
        phases = torch.angle(pixels.far_field.adjoint(torch.stack(fields)))
        ways = shortest_phase_paths(phases, crystal.reach)
        mean = moving_crystal_intensity(pixels.far_field, pixels.amplitude, ways, crystal, _NODES)
        wanted = correct_request(wanted, target, mean)
        given = [pixels.far_field.round_trip(field, pixels.uneven_amplitude) for field in fields]
        fields = scale_to_mean(given, mean_intensity(given), wanted)
    return torch.stack(fields)


def moving_crystal_intensity(
    far_field: FarField,
    amplitude: torch.Tensor,
    phases: torch.Tensor,
    crystal: LiquidCrystal,
    nodes: int,
    static_phase: torch.Tensor | None = None,
) -> torch.Tensor:
    """Return a video's mean intensity on the window while the liquid crystal moves.

    The video is repeated. phases: (frames, rows, columns), radians. nodes: moments per frame.
    static_phase: phase in radians that is added to every frame, (rows, columns).
    """
    starts = steady_start_phases(phases, crystal.frame_time, crystal.response_time)
    times, shares = time_nodes(crystal.frame_time, crystal.response_time, nodes)
    total = torch.zeros(far_field.window, dtype=torch.float32)
    for phase, start in zip(phases, starts, strict=True):
        for time, share in zip(times, shares, strict=True):
            moved = relaxed_phase(phase, start, time, crystal.response_time)
            angle = (moved if static_phase is None else moved + static_phase).to(torch.float32)
            total += share / len(phases) * far_field.intensity(torch.polar(amplitude, angle))
    return total


def displayed_psf(goal: RetrievalGoal, phases: torch.Tensor, orders: int) -> torch.Tensor:
    """Return the mean PSF of frames as the panel shows them, as shares of all light, float64.

    The phases are rounded to the panel's grey levels. A video is repeated, and includes the liquid
    crystal's motion if the panel has a response time. Coupling, gaps and unmodulated light are left
    out.
    """
    panel, wavelength = goal.camera.panel, goal.wavelength
    grey = phase_to_grey(panel, phases, wavelength, orders)
    shown = grey_to_phase(panel, grey, wavelength)
    # The crystal doesn't move for a single frame, or without a response time.
    moving = len(phases) > 1 and panel.response_time > 0
    nodes = _QUALITY_NODES if moving else 1
    # The panel adds its flatness, which phase_to_grey() has subtracted.
    besides = None if panel.flatness is None else flatness_phase(panel, wavelength)
    total = moving_crystal_intensity(
        goal.far_field, goal.amplitude, shown, crystal_of_goal(goal), nodes, besides
    )
    return total.to(torch.float64) / goal.power
