"""The effect of sampling a picture in each pixel before it is blurred."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.effects.blur_effects import BlurEffect, transfer_error_bound
from simulator.effects.psf_bounds import has_occlusion, mtf_bound
from simulator.effects.rendering_work import LEVELS, LIGHT_SAMPLING
from simulator.planning import Bound
from simulator.probing.radial import Gain
from simulator.situation import Situation


@dataclass(frozen=True)
class LightSamplingSettings:
    """Tune how finely pictures are sampled, and the error bound of their samples.

    Attributes
    ----------
    max_samples_per_pixel : int
        Samples along each axis of a pixel at the finest level. Chosen.
    max_samples : int
        Samples of a whole picture, at most. Chosen.
    margin : float
        Factor of the error bound, from audits: of detail finer than pixels, only the finest that
        pixels resolve is known.
    fine_detail : float
        Cycles per pixel from which on a picture's detail is taken to go on beyond what pixels
        resolve. Chosen.
    """

    max_samples_per_pixel: int = 4
    max_samples: int = 2**27
    margin: float = 2.0
    fine_detail: float = 0.4


_SETTINGS = LightSamplingSettings()


class LightSampling(BlurEffect):
    """The samples of pictures before they are blurred.

    The blurred light always has enough samples to resolve its finest fringe.
    """

    name = LIGHT_SAMPLING
    likely_shares = (0.3,)
    kind = "stage"
    recipe_field, recipe_values = "picture_samples_per_pixel", LEVELS.samples
    typical_bound_share = 0.5
    physics = "detail of the object that is finer than the samples looks like coarser detail"
    source = "Shannon; Gaskill, Linear Systems"
    levels = tuple(str(n) for n in LEVELS.samples)

    def finest_level(self, s: Situation) -> int:
        if _has_exact_spectra(s):
            return 0
        pixels = math.prod(n + LEVELS.windows[0] for n in s.camera.sensor.shape)
        most = [
            level
            for level, n in enumerate(LEVELS.samples)
            if n <= _SETTINGS.max_samples_per_pixel and n * n * pixels <= _SETTINGS.max_samples
        ]
        return max(most)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        samples = max(LEVELS.samples[level], s.coarsest_sampling)
        how = f"audited ×{_SETTINGS.margin:g}: what a picture's edges fold back, as blurred"
        return transfer_error_bound(s, _aliasing_gain(s, samples), how)

    def explain(self, s: Situation) -> str:
        if _has_exact_spectra(s):
            return "the picture's spectrum is known by a formula, whatever the samples"
        falls = "sharp edges" if _spectral_decay(s) == 1 else "no edge sharper than its own pixels"
        return f"the picture has {falls}, and the light {s.coarsest_sampling} samples in a pixel"


def _aliasing_gain(s: Situation, samples: int) -> Gain:
    """Bound the light-sampling effect's aliasing by frequency, for `samples` per pixel.

    Where a picture has edges, its spectrum falls with 1/k, and the mean over a sample's cell falls
    with another 1/k: aliases from beyond the samples' Nyquist frequency add (k / (n - k))² of the
    spectrum at k cycles per pixel, for n samples. Between the Nyquist frequencies of pixels and
    samples, the spectrum begins as just below the former, and falls further. The blur takes
    contrast from both.
    """
    pitch, falls = s.camera.sensor.pitch, min(_spectral_decay(s), 2)

    def aliased_share(cycles: NDArray[np.float64]) -> NDArray[np.float64]:
        return mtf_bound(s, cycles / pitch) * (cycles / (samples - cycles)) ** (1 + falls)

    fine = np.linspace(0.5, samples / 2, 65)
    beyond = aliased_share(fine) * np.abs(np.sinc(fine)) * (0.5 / fine) ** falls

    def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
        cycles = k * pitch
        known = aliased_share(np.minimum(cycles, samples / 2))
        total = np.where(cycles >= _SETTINGS.fine_detail, np.hypot(known, beyond.max()), known)
        return _SETTINGS.margin * total

    return gain


def _spectral_decay(s: Situation) -> int:
    """Return the slowest decay of the pictures' spectra, for the light-sampling effect.

    The decay is a power of the frequency, found at the pixels' Nyquist frequency.
    """
    found = []
    for layer in s.target.layers:
        scale = s.camera.magnification(layer.distance)
        finest = 0.5 / s.camera.sensor.pitch
        found += [part.picture.spectral_decay(scale, finest) for part in layer.parts]
        found += [layer.cover.spectral_decay(scale, finest)] if layer.cover is not None else []
    return min(found)


def _has_exact_spectra(s: Situation) -> bool:
    """Whether light sampling has no effect, because formulas give the pictures' spectra."""
    parts = [part.picture for layer in s.target.layers for part in layer.parts]
    return all(one.has_exact_spectrum for one in parts) and not has_occlusion(s)
