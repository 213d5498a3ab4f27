"""The liquid crystal between the frames of a video: it is always on its way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch

from optics.slm.dynamics import first_start, relaxed
from optics.slm.gap import gap_light
from simulator.effects.blurs import BlurStage, spread_otherwise
from simulator.effects.on_pixels import flickers
from simulator.effects.panel_effects import blurred
from simulator.effects.wavefronts import MARGIN, sampled
from simulator.planning import Bound
from simulator.recipe import Recipe
from simulator.situation import Situation

CRYSTAL = "liquid-crystal response"

_TIMES = 24
"""In a part of a frame, evenly in time."""

_MOST_FRAMES = 24


class CrystalResponse(BlurStage):
    name = CRYSTAL
    kind = "axis"
    physics = "the crystal follows a video's frames exponentially, and shows none of them wholly"
    source = "thesis §3.4"

    def caused(self, s: Situation) -> bool:
        return bool(s.camera.panel.response_time) and s.shown.moves and not s.picture.dark

    def left_out(self, s: Situation) -> Bound:
        spread = (1 + gap_light(s.camera.panel)) ** 2 * blurred(s.camera.panel) ** 2
        change = MARGIN * _change(s) * spread
        how = f"audited ×{MARGIN:g}: mean and power of what the field lacks, worst of all times"
        return spread_otherwise(s, change, how)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        rows, columns = s.camera.panel.shape
        return 100.0 * rows * columns * len(s.shown.names) if levels[self.name] else 0.0

    def why(self, s: Situation) -> str:
        tau, frame = s.camera.panel.response_time, s.shown.frame_time
        return f"the phase follows in {tau * 1e3:.2g} ms, of frames of {frame * 1e3:.3g} ms"

    def apply(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        tau = s.camera.panel.response_time
        return recipe.having(crystal=True, panel=replace(recipe.panel, response_time=tau))


def _change(s: Situation) -> float:
    """‖Δh‖₁ at most: |p|² in the mean over times, less |q|² of where it settles, is the power of
    what the field lacks, and twice its mean times the field (Cauchy-Schwarz)."""
    pixels, tau, frame_time = sampled(s), s.camera.panel.response_time, s.shown.frame_time
    modulator = s.pattern.modulator
    settled = {
        name: pixels(torch.as_tensor(modulator.phase(torch.from_numpy(grey.copy()))))
        for name, grey in s.shown.pictures.items()
    }
    names = s.shown.names[-_MOST_FRAMES:]
    phases = torch.stack([settled[name] for name in names])
    start = first_start(phases, frame_time, tau)
    parts = _parts(s)
    found: list[tuple[float, float]] = []
    for frame, end in enumerate(phases):
        for begin, finish, share in parts.get(
            frame if len(names) == len(s.shown.names) else -1, ()
        ):
            times = [begin + (k + 0.5) / _TIMES * (finish - begin) for k in range(_TIMES)]
            lacking = [torch.expm1(1j * (relaxed(end, start, t, tau) - end)) for t in times]
            mean = torch.stack(lacking).mean(0)
            power = torch.stack([one.abs() ** 2 for one in lacking]).mean(0)
            rms = math.sqrt(pixels.mean(mean.abs() ** 2).real)
            found.append((share, pixels.mean(power).real + 2 * rms))
        start = relaxed(end, start, frame_time, tau)
    if _any_time(s):
        return max(one for _, one in found)
    whole = sum(share for share, _ in found)
    return sum(share * one for share, one in found) / whole


def _any_time(s: Situation) -> bool:
    """Whether rows or a lamp may weigh any part of a frame as they like."""
    return s.camera.sensor.shutter == "rolling" or flickers(s)


def _parts(s: Situation) -> dict[int, list[tuple[float, float, float]]]:
    """What is seen of each frame: begin, end, share; of rolling rows or a flickering lamp,
    any eighth of any frame. Under -1 whole frames, where there are too many to tell apart."""
    frame_time, n = s.shown.frame_time, len(s.shown.names)
    every = (0.0, frame_time, 1.0)
    if _any_time(s):
        step = frame_time / 8
        eighths = [(k * step, (k + 1) * step, 1.0) for k in range(8)]
        return dict.fromkeys(range(-1, n), eighths)
    if n > _MOST_FRAMES:
        return {-1: [every]}
    parts: dict[int, list[tuple[float, float, float]]] = {}
    for span in s.shown.procession(s.moment, s.exposure).spans:
        parts.setdefault(span.frame, []).append((span.begin, span.end, span.share))
    return parts
