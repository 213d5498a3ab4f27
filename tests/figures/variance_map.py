"""Restorations of merged brackets with their variance map, beside one noise for all pixels.

Real photographs get four decades of light: by a stretch of their logarithm, or by sun on one half
and shade on the other. They are blurred on a grid twice as fine as the pixels, of a scene that goes
on beyond the frame, taken by the virtual sensor with five exposures, and merged.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.signal import fftconvolve

from figures import TOLD, Figure
from figures.photographs import Array, collection_words, grey_pictures
from figures.stopwatch import processor_seconds
from labapp.accuracy.blurs import disk
from optics.camera import Camera, Sensor
from optics.hdr import Bracket, merge
from optics.inverse import Observation, RestoredImage, build_observation, restore
from optics.inverse.observation_builder import without_variance
from optics.inverse.variance_gain import estimate_variance_gain
from optics.patterns import axicon, cubic_phase_mask
from optics.plane import Plane
from optics.psf import psf
from optics.sensor import expose
from optics.threads import single_threaded

_SIDE, _PSF_SIDE = 128, 145
_DECADES = 4.0
_SHADE = 200.0
"""Light on the sunny half over that on the other; the photograph itself has the rest."""

_TIMES = [1e-4 * 8.0**k for k in range(5)]
_DARKS = 4
_SENSOR = Sensor(
    shape=(_SIDE, _SIDE), bits=12, full_well=1e4, gain=2.6, read_noise=2.4, dark_current=1.0,
    black_level=64.0,
)  # fmt: skip
_RIM = 16
_GOAL, _LEAST_GAIN = 0.3, 0.1
_COLLECTION, _PHOTOGRAPHS = ("mcmaster",), 6
_NONE = "not measured: there are no photographs"
_WHERE = (
    f"six photographs {collection_words(_COLLECTION)}, four decades of light, two kinds of light, "
    f"three PSFs, {_SIDE} x {_SIDE} pixels"
)


@dataclass(frozen=True, eq=False)
class _Case:
    """A merged photograph to restore, and the scene without blur and noise, electrons/s."""

    blur: str
    observation: Observation
    scene: Array

    def decibels(self, image: torch.Tensor) -> tuple[float, float]:
        """PSNR of the light, and of its logarithm above a ten-thousandth of the peak: the peak is
        the scene's brightest pixel, and the four decades. A rim of 16 pixels is left out."""
        inside = (slice(_RIM, -_RIM),) * 2
        seen, truth = image.numpy().astype(np.float64)[inside], self.scene[inside]
        peak = truth.max()
        logs = [np.log10(np.maximum(one, 0) / peak + 10**-_DECADES) for one in (seen, truth)]
        light = 10 * np.log10(peak**2 / np.mean((seen - truth) ** 2))
        return float(light), float(20 * np.log10(_DECADES / np.std(logs[0] - logs[1])))


def _fine_psfs() -> dict[str, Array]:
    """PSFs on samples of half a pixel, origin in the middle of an odd number of them."""
    camera = Camera()
    panel, image_distance = camera.panel, camera.lens.image_distance
    pitch = camera.sensor.pitch
    fine = Plane((_PSF_SIDE, _PSF_SIDE), (pitch / 2, pitch / 2))
    phases = {
        "cubic, 40 rad": cubic_phase_mask(panel, 40.0),
        "ring of 8 pixels": axicon(panel, 8 * pitch, image_distance, 550e-9),
    }
    found = {}
    for name, phase in phases.items():
        seen = psf(camera, phase, distance=2.0, wavelength=550e-9, pixels=fine, tol=1e-3)
        found[name] = np.asarray(seen.value, dtype=np.float64)
    found["disk of 4 pixels"] = disk(8.0)
    return {name: one / one.sum() for name, one in found.items()}


def _averaged(fine: Array) -> Array:
    rows, columns = (n // 2 for n in fine.shape)
    return np.asarray(fine[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2).mean((1, 3)))


def _pixel_psf(fine: Array) -> Array:
    """The mean picture on pixels of a scene that is 1 on a pixel and 0 elsewhere."""
    half = fine.shape[0] // 4 + 2
    scene = np.zeros((4 * half + 2, 4 * half + 2))
    scene[2 * half : 2 * half + 2, 2 * half : 2 * half + 2] = 1.0
    found = _averaged(fftconvolve(scene, fine, mode="same"))
    return found / found.sum()


def _stretched(photograph: Array) -> Array:
    """The photograph's light with its logarithm stretched to four decades."""
    logs = np.log10(_linear(photograph))
    low, high = np.percentile(logs, [0.1, 99.9])
    return np.asarray(10 ** ((np.clip(logs, low, high) - high) * _DECADES / (high - low)))


def _half_in_shade(photograph: Array) -> Array:
    """The photograph's light where only its right half is in the sun."""
    column = np.arange(photograph.shape[1]) - photograph.shape[1] / 2
    sunny = 1 / (1 + np.exp(-column / 3))
    return np.asarray(_linear(photograph) * _SHADE ** (sunny - 1))


def _linear(photograph: Array) -> Array:
    """Light of sRGB levels; the darkest has two of 255, below which eight bits tell nothing."""
    level = np.clip(photograph, 2 / 255, 1)
    return np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)


def _cases() -> Iterator[_Case]:
    generator = torch.Generator().manual_seed(5)
    for name, fine in _fine_psfs().items():
        margin = fine.shape[0] // 2
        for photograph in _photographs(2 * _SIDE + 2 * margin):
            for light in (_stretched(photograph), _half_in_shade(photograph)):
                seen = np.maximum(_averaged(fftconvolve(light, fine, mode="valid")), 0)
                # The brightest pixel fills 0.8 of the well in the shortest exposure.
                rate = 0.8 * _SENSOR.full_well / _TIMES[0] / seen.max()
                inside = light[margin : margin + 2 * _SIDE, margin : margin + 2 * _SIDE]
                observed = _photographed(seen * rate, _pixel_psf(fine), generator)
                yield _Case(name, observed, rate * _averaged(inside))


def _photographs(side: int) -> list[Array]:
    """The middle squares of the collection's photographs that are large enough for any PSF."""
    large = [one for one in grey_pictures(_COLLECTION) if min(one.shape) >= 2 * _SIDE + _PSF_SIDE]
    found = []
    for one in large[:: max(1, len(large) // _PHOTOGRAPHS)][:_PHOTOGRAPHS]:
        y, x = ((n - side) // 2 for n in one.shape)
        found.append(one[y : y + side, x : x + side])
    return found


def _photographed(rate: Array, kernel: Array, generator: torch.Generator) -> Observation:
    """A bracket of the light, electrons per second, merged, with its variance map."""
    light = torch.from_numpy(rate)
    frames = [expose(light, time, _SENSOR, generator).numpy() for time in _TIMES]
    dark = torch.zeros_like(light)
    darks = [
        np.mean([expose(dark, time, _SENSOR, generator).numpy() for _ in range(_DARKS)], axis=0)
        for time in _TIMES
    ]
    merged = merge(Bracket(frames, _TIMES, darks, [_DARKS] * len(_TIMES), _SENSOR))
    clipped = ~torch.isfinite(merged.variance)
    image = torch.where(clipped, 0, merged.rate)
    return build_observation(
        image, torch.from_numpy(kernel), clipped=clipped, variance=merged.variance
    )


def _solve(observation: Observation, weight: float | None) -> RestoredImage:
    return restore(observation, method="total-variation", weight=weight)


@single_threaded
def variance_map_figures(folder: Path) -> list[Figure]:
    """Total variation with its own weight, with the map and with the map's root mean square."""
    goal = f"≥ +{_GOAL:g} dB, median, or told that it gains nothing"
    cases = list(_cases())
    name = f"restoration with the variance map over one σ for all, {_WHERE}"
    if not cases:
        return [Figure(name, goal, _NONE, None)]
    gains, told = [], []
    for case in cases:
        even = without_variance(case.observation)
        found = [case.decibels(_solve(one, None).image) for one in (even, case.observation)]
        gains.append(np.subtract(found[1], found[0]))
        gain = estimate_variance_gain(case.observation, _solve, torch.Generator().manual_seed(0))
        told.append((gain.light, gain.logarithm))
    (light, logs), (told_light, told_logs) = np.transpose(gains), np.transpose(told)
    median = float(np.median(light))
    return [
        Figure(f"{name}: PSNR of light", goal, _gain_words(light, cases), median >= _GOAL),
        Figure(
            f"{name}: PSNR of the logarithm of light above 1e-4 of its peak", TOLD,
            _gain_words(logs, cases), None,
        ),
        _told_figure(light, told_light),
        Figure(
            "the same, logarithm of light", TOLD, _error_words(logs, told_logs), None,
        ),
        _cost_figure(cases[0].observation),
    ]  # fmt: skip


def _gain_words(gains: Array, cases: list[_Case]) -> str:
    blurs = dict.fromkeys(case.blur for case in cases)
    each = [
        f"{blur} {np.median([g for g, c in zip(gains, cases, strict=True) if c.blur == blur]):+.2f}"
        for blur in blurs
    ]
    return (
        f"{np.median(gains):+.2f} dB, median ({', '.join(each)}); worst {gains.min():+.2f}, "
        f"above 0 in {(gains > 0).mean():.0%}"
    )


def _error_words(gains: Array, told: Array) -> str:
    wrong = told - gains
    return f"told less true {wrong.mean():+.2f} dB in the mean, {wrong.std():.2f} dB rms about it"


def _told_figure(gains: Array, told: Array) -> Figure:
    """The gain that is told beside the true one, and what using the map by it costs or gains."""
    used = told >= _LEAST_GAIN
    harm = int((used & (gains < -_LEAST_GAIN)).sum())
    missed = int((~used & (gains > _GOAL)).sum())
    seen = (
        f"{_error_words(gains, told)}; used in {int(used.sum())} of {len(gains)}, {harm} of them "
        f"lost more than {_LEAST_GAIN:g} dB; not used where it gains {_GOAL:g} dB: {missed}"
    )
    return Figure(
        "gain of the variance map that is told without the truth, same photographs",
        f"used with a loss above {_LEAST_GAIN:g} dB in ≤ 1 of 20", seen, harm <= len(gains) / 20,
    )  # fmt: skip


def _cost_figure(observation: Observation) -> Figure:
    even = without_variance(observation)
    spent = processor_seconds(
        {
            "even": lambda: _solve(even, None),
            "map": lambda: _solve(observation, None),
            "trial": lambda: estimate_variance_gain(
                observation, _solve, torch.Generator().manual_seed(0)
            ),
        },
        5,
    )
    with_map, trial = (spent[one] / spent["even"] for one in ("map", "trial"))
    return Figure(
        "processor time with the variance map over that with one σ; and of the gain's estimate",
        TOLD,
        f"{with_map:.1f} times; {trial:.1f} times at {_SIDE} x {_SIDE} pixels, and at most that of "
        "256 x 256 pixels in larger photographs",
        None,
    )


MEASUREMENTS = {"variance-map": variance_map_figures}
