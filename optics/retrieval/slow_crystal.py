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
from optics.retrieval.branches import short_ways
from optics.retrieval.far_field import FarField
from optics.retrieval.frames import corrected, joint, mean_light, scaled
from optics.retrieval.goal import Goal
from optics.retrieval.job import Job
from optics.retrieval.superpixel import Superpixels
from optics.slm import grey_to_phase, max_phase, phase_to_grey
from optics.slm.dynamics import relaxed, steady_starts, time_nodes
from optics.slm.flatness import flatness_phase
from optics.slm.lut import whole_waves

_WITHOUT = 0.6
"""Share of the iterations that know nothing of the motion: they are quicker, and find the way."""

_NODES = 3
"""Moments of a frame whose light stands for all of it, while iterating."""

_JUDGED_NODES = 6
"""The same for a judge."""


@dataclass(frozen=True)
class Crystal:
    """frame_time: seconds that a frame is shown. response_time: seconds, of the first-order
    relaxation. reach: radians that the panel can show, one wave at least."""

    frame_time: float
    response_time: float
    reach: float


def orders_of(panel: Panel, wavelength: float) -> int:
    """Whole waves that the panel reaches, one at least."""
    return max(1, whole_waves(panel, wavelength))


def crystal_of(goal: Goal) -> Crystal:
    """What a goal's panel is like at its wavelength."""
    panel = goal.camera.panel
    orders = orders_of(panel, goal.wavelength)
    # What is nearer to the next wave than to the last level is shown as the first one.
    half = 0.5 * max_phase(panel, goal.wavelength) / (panel.levels - 1)
    reach = max(2 * math.pi, 2 * math.pi * orders - half)
    return Crystal(1 / panel.frame_rate, panel.response_time, reach)


def shown_ways(goal: Goal, phases: torch.Tensor) -> torch.Tensor:
    """short_ways() of phases (frames, rows, columns) on a goal's panel, float32.

    The panel's first level isn't a phase of zero everywhere, and the ways begin there.
    """
    ground = _first_level(goal)
    return short_ways(phases - ground, crystal_of(goal).reach) + ground


def _first_level(goal: Goal) -> torch.Tensor:
    """The phase of the light where the panel shows its first level, (rows, columns), float32."""
    panel, wavelength = goal.camera.panel, goal.wavelength
    phase = grey_to_phase(panel, torch.zeros(panel.shape, dtype=torch.uint8), wavelength)
    if panel.flatness is not None:
        phase = phase + flatness_phase(panel, wavelength)
    return phase.to(torch.float32)


def responding(pixels: Superpixels, job: Job) -> torch.Tensor:
    """Fields on the window (frames, rows, columns) whose mean over a repeated video, motion
    included, has the target's shape when its phases are shown in shown_ways()."""
    crystal, iterations = crystal_of(job.goal), job.iterations
    before = max(1, round(_WITHOUT * iterations))
    first = replace(job, iterations=before, progress=job.progress.part(0, 0.2))
    fields = list(joint(pixels, first))
    target = pixels.intensity
    wanted = target
    rest = job.progress.part(0.2, 1)
    for iteration in range(before, iterations):
        done = (iteration - before) / (iterations - before)
        rest.report(done, f"moving frames {iteration + 1}/{iterations}")
        phases = torch.angle(pixels.far_field.back(torch.stack(fields)))
        ways = short_ways(phases, crystal.reach)
        wanted = corrected(
            wanted, target, moving_light(pixels.far_field, pixels.amplitude, ways, crystal, _NODES)
        )
        given = [pixels.far_field.bounce(field, pixels.uneven) for field in fields]
        fields = scaled(given, mean_light(given), wanted)
    return torch.stack(fields)


def moving_light(
    far_field: FarField,
    amplitude: torch.Tensor,
    phases: torch.Tensor,
    crystal: Crystal,
    nodes: int,
    besides: torch.Tensor | None = None,
) -> torch.Tensor:
    """The mean intensity on the window while a video (frames, rows, columns) is repeated.

    besides: radians that the light gets whatever is shown, (rows, columns).
    """
    starts = steady_starts(phases, crystal.frame_time, crystal.response_time)
    times, shares = time_nodes(crystal.frame_time, crystal.response_time, nodes)
    total = torch.zeros(far_field.window, dtype=torch.float32)
    for phase, start in zip(phases, starts, strict=True):
        for time, share in zip(times, shares, strict=True):
            moved = relaxed(phase, start, time, crystal.response_time)
            angle = (moved if besides is None else moved + besides).to(torch.float32)
            total += share / len(phases) * far_field.intensity(torch.polar(amplitude, angle))
    return total


def shown_light(goal: Goal, phases: torch.Tensor, orders: int) -> torch.Tensor:
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
    total = moving_light(goal.far_field, goal.amplitude, shown, crystal_of(goal), nodes, besides)
    return total.to(torch.float64) / goal.power
