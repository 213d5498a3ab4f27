"""The liquid crystal between the frames of a video: it is always on its way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch

from optics.slm.dynamics import first_start_phase, relaxed_phase
from optics.slm.gap import gap_amplitude
from simulator.effects.blur_effects import OnOffBlurEffect, psf_error_bound
from simulator.effects.electron_bounds import is_lamp_flickering
from simulator.effects.field_distance import MARGIN, sample_pixels
from simulator.effects.panel_effects import phase_error_gain
from simulator.planning import Bound
from simulator.recipe import Recipe
from simulator.situation import Situation

CRYSTAL = "liquid-crystal response"

_TIMES = 24
"""In a part of a frame, evenly in time."""

_MOST_FRAMES = 24


class CrystalResponse(OnOffBlurEffect):
    name = CRYSTAL
    kind = "axis"
    physics = "the crystal follows a video's frames exponentially, and shows none of them wholly"
    source = "thesis §3.4"

    def is_present(self, s: Situation) -> bool:
        return (
            bool(s.camera.panel.response_time)
            and s.panel_content.is_changing
            and not s.picture_probe.is_dark
        )

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        spread = (1 + gap_amplitude(s.camera.panel)) ** 2 * phase_error_gain(s.camera.panel) ** 2
        change = MARGIN * _psf_change(s) * spread
        how = f"audited ×{MARGIN:g}: mean and power of what the field lacks, worst of all times"
        return psf_error_bound(s, change, how)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        rows, columns = s.camera.panel.shape
        return 100.0 * rows * columns * len(s.panel_content.names) if levels[self.name] else 0.0

    def explain(self, s: Situation) -> str:
        tau, frame = s.camera.panel.response_time, s.panel_content.frame_time
        return f"the phase follows in {tau * 1e3:.2g} ms, of frames of {frame * 1e3:.3g} ms"

    def add_to_recipe(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        tau = s.camera.panel.response_time
        return recipe.with_changes(crystal=True, panel=replace(recipe.panel, response_time=tau))


def _psf_change(s: Situation) -> float:
    """‖Δh‖₁ at most: |p|² in the mean over times, less |q|² of where it settles, is the power of
    what the field lacks, and twice its mean times the field (Cauchy-Schwarz)."""
    pixels, tau, frame_time = (
        sample_pixels(s),
        s.camera.panel.response_time,
        s.panel_content.frame_time,
    )
    modulator = s.pattern_probe.modulator
    settled = {
        name: pixels(torch.as_tensor(modulator.phase(torch.from_numpy(grey.copy()))))
        for name, grey in s.panel_content.pictures.items()
    }
    names = s.panel_content.names[-_MOST_FRAMES:]
    phases = torch.stack([settled[name] for name in names])
    start = first_start_phase(phases, frame_time, tau)
    parts = _parts(s)
    found: list[tuple[float, float]] = []
    for frame, end in enumerate(phases):
        for begin, finish, share in parts.get(
            frame if len(names) == len(s.panel_content.names) else -1, ()
        ):
            times = [begin + (k + 0.5) / _TIMES * (finish - begin) for k in range(_TIMES)]
            lacking = [torch.expm1(1j * (relaxed_phase(end, start, t, tau) - end)) for t in times]
            mean = torch.stack(lacking).mean(0)
            power = torch.stack([one.abs() ** 2 for one in lacking]).mean(0)
            rms = math.sqrt(pixels.mean(mean.abs() ** 2).real)
            found.append((share, pixels.mean(power).real + 2 * rms))
        start = relaxed_phase(end, start, frame_time, tau)
    if _has_uneven_timing(s):
        return max(one for _, one in found)
    whole = sum(share for share, _ in found)
    return sum(share * one for share, one in found) / whole


def _has_uneven_timing(s: Situation) -> bool:
    """Whether rows or a lamp may weigh any part of a frame as they like."""
    return s.camera.sensor.shutter == "rolling" or is_lamp_flickering(s)


def _parts(s: Situation) -> dict[int, list[tuple[float, float, float]]]:
    """What is seen of each frame: begin, end, share; of rolling rows or a flickering lamp,
    any eighth of any frame. Under -1 whole frames, where there are too many to tell apart."""
    frame_time, n = s.panel_content.frame_time, len(s.panel_content.names)
    every = (0.0, frame_time, 1.0)
    if _has_uneven_timing(s):
        step = frame_time / 8
        eighths = [(k * step, (k + 1) * step, 1.0) for k in range(8)]
        return dict.fromkeys(range(-1, n), eighths)
    if n > _MOST_FRAMES:
        return {-1: [every]}
    parts: dict[int, list[tuple[float, float, float]]] = {}
    for span in s.panel_content.frame_sequence(s.exposure_start, s.exposure).spans:
        parts.setdefault(span.frame, []).append((span.begin, span.end, span.share))
    return parts
