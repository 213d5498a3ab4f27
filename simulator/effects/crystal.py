"""How slowly the liquid crystal responds between the frames of a video."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch

from optics.slm.dynamics import first_start_phase, relaxed_phase
from optics.slm.panel import max_gap_power
from simulator.effects.blur_effects import OnOffBlurEffect, psf_error_bound
from simulator.effects.electron_bounds import is_lamp_flickering
from simulator.effects.field_distance import MARGIN, sample_pixels
from simulator.effects.panel_effects import phase_error_gain
from simulator.planning import Bound
from simulator.recipe import Recipe
from simulator.situation import Situation

CRYSTAL = "liquid-crystal response"


@dataclass(frozen=True)
class CrystalSamplingSettings:
    """Tune at how many times the liquid crystal's response is sampled.

    times: evenly spaced, in a part of a frame. Chosen.
    max_frames: of a video, that are sampled at most: the last ones. Chosen.
    """

    times: int = 24
    max_frames: int = 24


_SETTINGS = CrystalSamplingSettings()


class CrystalResponse(OnOffBlurEffect):
    name = CRYSTAL
    likely_shares = (0.2,)
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
        spread = max_gap_power(s.camera.panel) * phase_error_gain(s.camera.panel) ** 2
        change = MARGIN * _psf_change(s) * spread
        how = f"audited ×{MARGIN:g}: mean and power of what the field lacks, worst of all times"
        return psf_error_bound(s, change, how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        rows, columns = s.camera.panel.shape
        return 100.0 * rows * columns * len(s.panel_content.names) if levels[self.name] else 0.0

    def explain(self, s: Situation) -> str:
        tau, frame = s.camera.panel.response_time, s.panel_content.frame_time
        return f"the phase follows in {tau * 1e3:.2g} ms, of frames of {frame * 1e3:.3g} ms"

    def add_to_recipe(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        tau = s.camera.panel.response_time
        return recipe.with_changes(crystal=True, panel=replace(recipe.panel, response_time=tau))


def _psf_change(s: Situation) -> float:
    """Bound the change ‖Δh‖₁ of a PSF by the crystal's slow response.

    The mean over time of |p|², less |q|² of the settled field q, is the power of the difference of
    the fields, and twice its mean times q (Cauchy-Schwarz).
    """
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
    names = s.panel_content.names[-_SETTINGS.max_frames :]
    phases = torch.stack([settled[name] for name in names])
    start = first_start_phase(phases, frame_time, tau)
    parts, count = _seen_frame_parts(s), _SETTINGS.times
    found: list[tuple[float, float]] = []
    for frame, end in enumerate(phases):
        for begin, finish, share in parts.get(
            frame if len(names) == len(s.panel_content.names) else -1, ()
        ):
            times = [begin + (k + 0.5) / count * (finish - begin) for k in range(count)]
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
    """Whether a rolling shutter or a flickering lamp may let parts of a frame count unequally."""
    return s.camera.sensor.shutter == "rolling" or is_lamp_flickering(s)


def _seen_frame_parts(s: Situation) -> dict[int, list[tuple[float, float, float]]]:
    """Return which parts of each video frame an exposure sees, each as (begin, end, share).

    With a rolling shutter or a flickering lamp, the parts are the eighths of each frame. If there
    are too many frames to tell apart, key -1 has the whole frame.
    """
    frame_time, n = s.panel_content.frame_time, len(s.panel_content.names)
    every = (0.0, frame_time, 1.0)
    if _has_uneven_timing(s):
        step = frame_time / 8
        eighths = [(k * step, (k + 1) * step, 1.0) for k in range(8)]
        return dict.fromkeys(range(-1, n), eighths)
    if n > _SETTINGS.max_frames:
        return {-1: [every]}
    parts: dict[int, list[tuple[float, float, float]]] = {}
    for span in s.panel_content.frame_sequence(s.exposure_start, s.exposure).spans:
        parts.setdefault(span.frame, []).append((span.begin, span.end, span.share))
    return parts
