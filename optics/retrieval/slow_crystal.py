"""Videos for a liquid crystal that is never done moving.

At 60 Hz a cell of a few milliseconds spends a good part of every frame on its way, and light
that meets it then goes astray: a fifth of it at 5 ms, most of that to the zeroth order. The
remedy has two parts: ways between frames that are short (optics.retrieval.branches, and frames
that start alike), and a mean that is taken over the motion, not over the frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from optics.camera import Panel
from optics.retrieval.branches import shortest_phase_paths
from optics.retrieval.far_field import FarField
from optics.retrieval.frame_averaging import (
    correct_request,
    joint_frames,
    mean_intensity,
    scale_to_mean,
)
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.job import RetrievalJob
from optics.retrieval.superpixel import Superpixels
from optics.slm import grey_to_phase, max_phase, phase_to_grey
from optics.slm.dynamics import relaxed_phase, steady_start_phases, time_nodes
from optics.slm.flatness import flatness_phase
from optics.slm.lut import whole_waves

_WITHOUT = 0.6
"""Share of the iterations that know nothing of the motion: they are quicker, and find the way."""

_NODES = 3
"""Moments of a frame whose light stands for all of it, while iterating."""

_JUDGED_NODES = 6
"""The same for a judge."""


@dataclass(frozen=True)
class LiquidCrystal:
    """frame_time: seconds that a frame is shown. response_time: seconds, of the first-order
    relaxation. reach: radians that the panel can show, one wave at least."""

    frame_time: float
    response_time: float
    reach: float


def usable_orders(panel: Panel, wavelength: float) -> int:
    """Whole waves that the panel reaches, one at least."""
    return max(1, whole_waves(panel, wavelength))


def crystal_of_goal(goal: RetrievalGoal) -> LiquidCrystal:
    """What a goal's panel is like at its wavelength."""
    panel = goal.camera.panel
    orders = usable_orders(panel, goal.wavelength)
    # What is nearer to the next wave than to the last level is shown as the first one.
    half = 0.5 * max_phase(panel, goal.wavelength) / (panel.levels - 1)
    reach = max(2 * math.pi, 2 * math.pi * orders - half)
    return LiquidCrystal(1 / panel.frame_rate, panel.response_time, reach)


def shortest_panel_phases(goal: RetrievalGoal, phases: torch.Tensor) -> torch.Tensor:
    """shortest_phase_paths() of phases (frames, rows, columns) on a goal's panel, float32.

    The panel's first level isn't a phase of zero everywhere, and the ways begin there.
    """
    ground = _first_level(goal)
    return shortest_phase_paths(phases - ground, crystal_of_goal(goal).reach) + ground


def _first_level(goal: RetrievalGoal) -> torch.Tensor:
    """The phase of the light where the panel shows its first level, (rows, columns), float32."""
    panel, wavelength = goal.camera.panel, goal.wavelength
    phase = grey_to_phase(panel, torch.zeros(panel.shape, dtype=torch.uint8), wavelength)
    if panel.flatness is not None:
        phase = phase + flatness_phase(panel, wavelength)
    return phase.to(torch.float32)


def slow_crystal_frames(pixels: Superpixels, job: RetrievalJob) -> torch.Tensor:
    """Fields on the window (frames, rows, columns) whose mean over a repeated video, motion
    included, has the target's shape when its phases are shown in shortest_panel_phases()."""
    crystal, iterations = crystal_of_goal(job.goal), job.iterations
    before = max(1, round(_WITHOUT * iterations))
    first = replace(job, iterations=before, progress=job.progress.part(0, 0.2))
    fields = list(joint_frames(pixels, first))
    target = pixels.target_intensity
    wanted = target
    rest = job.progress.part(0.2, 1)
    for iteration in range(before, iterations):
        done = (iteration - before) / (iterations - before)
        rest.report(done, f"moving frames {iteration + 1}/{iterations}")
        phases = torch.angle(pixels.far_field.adjoint(torch.stack(fields)))
        ways = shortest_phase_paths(phases, crystal.reach)
        wanted = correct_request(
            wanted,
            target,
            moving_crystal_intensity(pixels.far_field, pixels.amplitude, ways, crystal, _NODES),
        )
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
    """The mean intensity on the window while a video (frames, rows, columns) is repeated.

    static_phase: radians that the light gets whatever is shown, (rows, columns).
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
    """The mean PSF of frames as the panel shows them, share of all light a sample, float64.

    Rounded to the panel's levels; a video that is repeated, with the liquid crystal's motion if
    the panel has a response time. Neighbours, gaps and unmodulated light are left out.
    """
    panel, wavelength = goal.camera.panel, goal.wavelength
    grey = phase_to_grey(panel, phases, wavelength, orders)
    shown = grey_to_phase(panel, grey, wavelength)
    # One frame stands still, and a crystal without inertia always does.
    moving = len(phases) > 1 and panel.response_time > 0
    nodes = _JUDGED_NODES if moving else 1
    # What phase_to_grey() takes off for a known flatness, the panel puts on again.
    besides = None if panel.flatness is None else flatness_phase(panel, wavelength)
    total = moving_crystal_intensity(
        goal.far_field, goal.amplitude, shown, crystal_of_goal(goal), nodes, besides
    )
    return total.to(torch.float64) / goal.power
