"""The liquid crystal between the frames of a video: it is always on its way."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import scipy.special
import torch

from optics.camera import Panel
from simulator.effects.pattern import Pattern
from simulator.effects.situation import Decision, Situation

CRYSTAL = "liquid-crystal response"

_PIXELS = 256
"""Along each axis that are looked at, at most: pixels of a pattern are much alike."""

_NEAR = 1e-3
"""Below this the integral's terms cancel, and its series' first is right to 1e-7."""

_CENTRED = 0.3
"""Of the light that is lost on the way between unrelated phases, what comes to the centre:
half way between them, sinc(1/2)⁴ = 0.16 of all."""


def crystal_response(s: Situation, tol: float) -> Decision:
    """Of what was shown as a video; a still stands."""
    size = s.sizes.get(CRYSTAL, 0.0)
    seconds = s.camera.panel.response_time
    why = f"the phase follows the frames in {seconds * 1e3:.2g} ms" if seconds else "at once"
    return Decision(CRYSTAL, size > tol, size, "mean", why)


def crystal_size(panel: Panel, video: Iterable[Pattern], frame_time: float) -> float:
    """The estimate for a video of more than one picture, each shown for `frame_time` seconds.

    A pixel that has a phase step D to go is D exp(-t / tau) away from its end, and the mean of
    1 - cos of it over a frame T is tau/T (Cin(D) - Cin(D exp(-T / tau))): the field that is
    missing. The light loses twice as much, and some of it appears in the centre.
    """
    quick = frame_time / panel.response_time
    phases, sharpness = [], 0.0
    for pattern in video:
        phases.append(_some(pattern.phase))
        sharpness = max(sharpness, pattern.sharpness)
    missing = 0.0
    for before, now in zip((phases[-1], *phases[:-1]), phases, strict=True):
        step = now - before
        missing += float((_cin(step) - _cin(step * math.exp(-quick))).mean()) / quick
    return missing / len(phases) * math.hypot(2, _CENTRED / sharpness)


def _some(phase: torch.Tensor) -> torch.Tensor:
    rows, columns = (max(1, n // _PIXELS) for n in phase.shape)
    return phase[::rows, ::columns].clone()


def _cin(z: torch.Tensor) -> torch.Tensor:
    """The integral of (1 - cos t) / t from 0 to |z| (Abramowitz and Stegun 5.2.27)."""
    z = z.abs()
    far = z.clamp(min=_NEAR)
    cosine_integral = torch.from_numpy(scipy.special.sici(far.numpy())[1])
    return torch.where(z < _NEAR, z**2 / 4, np.euler_gamma + far.log() - cosine_integral)
