"""Samples of the light in each pixel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simulator.effects.blur_effects import BlurEffect, transfer_error_bound
from simulator.effects.psf_bounds import has_occlusion, mtf_bound
from simulator.effects.rendering_work import LIGHT_SAMPLING, PSF_WINDOWS, SAMPLE_COUNTS
from simulator.planning import Bound
from simulator.probing.radial import Gain
from simulator.situation import Situation

_FINEST = 4

_MARGIN = 2.0
"""Audited: what is finer than pixels isn't known of a picture, only its finest detail."""

_TOP = 0.4
"""Cycles a pixel, from which on detail tells of what is finer."""


_MOST = 2**27
"""Samples of a picture that are drawn at most."""


class LightSampling(BlurEffect):
    """Of pictures, before they are blurred: the light itself has always as many samples as
    resolve its finest fringe."""

    name = LIGHT_SAMPLING
    kind = "stage"
    recipe_field, recipe_values = "picture_samples_per_pixel", SAMPLE_COUNTS
    typical_bound_share = 0.5
    physics = "detail of the object that is finer than the samples looks like coarser detail"
    source = "Shannon; Gaskill, Linear Systems"
    levels = tuple(str(n) for n in SAMPLE_COUNTS)

    def finest_level(self, s: Situation) -> int:
        if _has_exact_spectra(s):
            return 0
        pixels = math.prod(n + PSF_WINDOWS[0] for n in s.camera.sensor.shape)
        most = [
            level
            for level, n in enumerate(SAMPLE_COUNTS)
            if n <= _FINEST and n * n * pixels <= _MOST
        ]
        return max(most)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        samples = max(SAMPLE_COUNTS[level], s.coarsest_sampling)
        how = f"audited ×{_MARGIN:g}: what a picture's edges fold back, as blurred"
        return transfer_error_bound(s, _aliasing_gain(s, samples), how)

    def explain(self, s: Situation) -> str:
        if _has_exact_spectra(s):
            return "the picture's spectrum is known by a formula, whatever the samples"
        falls = "sharp edges" if _spectral_decay(s) == 1 else "no edge sharper than its own pixels"
        return f"the picture has {falls}, and the light {s.coarsest_sampling} samples in a pixel"


def _aliasing_gain(s: Situation, samples: int) -> Gain:
    """What so few samples in a pixel fold back, by frequency, of what is there.

    A picture's spectrum falls with 1/k where it has edges, and the mean over a sample's cell with
    another: (k / (n - k))² of what is at k comes from beyond the samples' Nyquist frequency, k in
    cycles a pixel. What lies between the pixels' Nyquist frequency and that is as much as just
    below it, and falls on. The blur takes contrast from either.
    """
    pitch, falls = s.camera.sensor.pitch, min(_spectral_decay(s), 2)

    def aliased_share(cycles: NDArray[np.float64]) -> NDArray[np.float64]:
        return mtf_bound(s, cycles / pitch) * (cycles / (samples - cycles)) ** (1 + falls)

    fine = np.linspace(0.5, samples / 2, 65)
    beyond = aliased_share(fine) * np.abs(np.sinc(fine)) * (0.5 / fine) ** falls

    def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
        cycles = k * pitch
        known = aliased_share(np.minimum(cycles, samples / 2))
        return _MARGIN * np.where(cycles >= _TOP, np.hypot(known, beyond.max()), known)

    return gain


def _spectral_decay(s: Situation) -> int:
    """With which power of the frequency the pictures' spectra fall where pixels end, at least."""
    found = []
    for layer in s.target.layers:
        scale = s.camera.magnification(layer.distance)
        finest = 0.5 / s.camera.sensor.pitch
        found += [part.picture.spectral_decay(scale, finest) for part in layer.parts]
        found += [layer.cover.spectral_decay(scale, finest)] if layer.cover is not None else []
    return min(found)


def _has_exact_spectra(s: Situation) -> bool:
    """Whether the spectra of all pictures are known, whatever the samples."""
    parts = [part.picture for layer in s.target.layers for part in layer.parts]
    return all(one.has_exact_spectrum for one in parts) and not has_occlusion(s)
