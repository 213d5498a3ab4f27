"""Blurred photographs behind colour filters, restored in one go and in two steps."""

from __future__ import annotations

import importlib
import importlib.util
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.signal import fftconvolve

from figures import Figure
from figures.opencv_demosaicing import INTERPOLATIONS, interpolate_bayer
from figures.photographs import Array
from labapp.accuracy.blurs import disk
from labapp.pictures.networks import bundled_denoiser
from optics.inverse import (
    Observation,
    build_mosaic_observation,
    build_observation,
    demosaic,
    restore,
)
from optics.metrics import psnr
from optics.threads import single_threaded

_PATTERN = ("RG", "GB")
_NOISE = 0.005
"""Standard deviation of a pixel; white is 1, and no method is given it."""

_SIDE = 320
"""Largest side of a scene, of which the frame shows what lies a PSF's half width inside."""

_PICTURES = ("astronaut", "chelsea", "coffee", "rocket")

_RING_RADIUS, _RING_WIDTH, _RING_PEAK = 12.0, 0.7, 0.2
"""Radius in pixels in the green band, standard deviation in pixels of the profile, and share of the
light in the middle."""
_RING_GROWTH = (1.13, 1.0, 0.82)
"""Radius in each band relative to the green one: diffraction's, at 620, 550 and 450 nm."""

_ROOM = 16
"""Pixels by which a reflected margin is wider than half a PSF."""
_BALANCES = tuple(np.geomspace(1e-3, 100, 16))
_ROUNDS = (10, 30, 100)
"""Settings of scikit-image's Wiener filter and Richardson-Lucy, the best of which is taken for
each photograph."""


@dataclass(frozen=True, eq=False)
class _Case:
    """A photograph behind colour filters.

    `raw` is (rows, columns), `psfs` are (3, odd, odd), `truth` is (3, rows, columns).
    """

    raw: np.ndarray
    psfs: Array
    truth: Array

    def quality(self, picture: np.ndarray) -> float:
        """PSNR of all bands and the whole frame in dB, values cut to 0 to 1."""
        return float(psnr(np.clip(picture, 0, 1).astype(np.float64), self.truth))


_Way = Callable[[_Case], np.ndarray]


@dataclass(frozen=True)
class _Comparison:
    """Two ways to restore a photograph, and the median gain in dB that is asked of the first."""

    name: str
    ours: str
    theirs: str
    goal: float


_COMPARISONS = (
    _Comparison(
        "total variation of all bands over demosaicing, then each band", "joint", "in steps", 0.5
    ),
    _Comparison(
        "total variation of all bands over OpenCV's demosaicing, then scikit-image's restoration "
        "of each, at their best settings",
        "joint", "OpenCV and scikit-image", 2.5,
    ),
    _Comparison(
        "plug-and-play of all bands over demosaicing, then each band",
        "joint plug-and-play", "plug-and-play in steps", 0.5,
    ),
    _Comparison(
        "plug-and-play of all bands over OpenCV's demosaicing, then scikit-image's restoration of "
        "each, at their best settings",
        "joint plug-and-play", "OpenCV and scikit-image", 2.5,
    ),
)  # fmt: skip


@single_threaded
def colour_figures(folder: Path) -> list[Figure]:
    """Five photographs of linear light, blurred by a disk or by a ring that grows with wavelength;
    border and noise unknown."""
    goals = [f"≥ {one.goal:g} dB, median" for one in _COMPARISONS]
    if importlib.util.find_spec("skimage") is None:
        why = "not measured: scikit-image isn't installed"
        return [
            Figure(one.name, goal, why, None) for one, goal in zip(_COMPARISONS, goals, strict=True)
        ]
    figures = []
    for name, psfs in _psfs().items():
        found = _judged([_simulate(*numbered, psfs) for numbered in enumerate(_photographs())])
        for one, goal in zip(_COMPARISONS, goals, strict=True):
            ours, theirs = found[one.ours], found[one.theirs]
            gains = ours.levels - theirs.levels
            figures.append(
                Figure(
                    f"RGGB mosaic, {name}: {one.name}",
                    goal,
                    f"median {np.median(gains):+.1f} dB, worst {gains.min():+.1f} dB of "
                    f"{len(gains)} photographs: {ours} against {theirs}",
                    float(np.median(gains)) >= one.goal,
                )
            )
    return figures


@dataclass(frozen=True, eq=False)
class _Judged:
    """PSNR in dB and processor seconds for each photograph."""

    levels: Array
    seconds: Array

    def __str__(self) -> str:
        level, spent = self.levels.mean(), np.median(self.seconds)
        return f"mean {level:.1f} dB in {spent:.1f} s of processor time"


def _judged(cases: list[_Case]) -> dict[str, _Judged]:
    denoise = bundled_denoiser()
    learned = partial(restore, method="plug-and-play", denoise=denoise)
    ways: dict[str, list[_Way]] = {
        "joint": [partial(_jointly, solve=restore)],
        "in steps": [partial(_in_steps, solve=restore)],
        "joint plug-and-play": [partial(_jointly, solve=learned)],
        "plug-and-play in steps": [partial(_in_steps, solve=learned)],
        "OpenCV and scikit-image": list(_others()),
    }
    return {name: _best_of(each, cases) for name, each in ways.items()}


def _best_of(ways: list[_Way], cases: list[_Case]) -> _Judged:
    """What the best of some ways reaches, chosen for each photograph by one who knows the truth."""
    levels, seconds = [], []
    for case in cases:
        found = []
        for way in ways:
            begun = time.process_time()
            picture = way(case)
            spent = time.process_time() - begun
            found.append((case.quality(picture), spent))
        level, spent = max(found)
        levels.append(level)
        seconds.append(spent)
    return _Judged(np.array(levels), np.array(seconds))


def _jointly(case: _Case, solve: Callable[[Observation], Any]) -> np.ndarray:
    psfs = case.psfs.astype(np.float32)
    return np.asarray(solve(build_mosaic_observation(case.raw, _PATTERN, psfs)).image)


def _in_steps(case: _Case, solve: Callable[[Observation], Any]) -> np.ndarray:
    """Demosaicing as if the lens were sharp, then a restoration of each band."""
    bands = zip(demosaic(build_mosaic_observation(case.raw, _PATTERN)), case.psfs, strict=True)
    return np.stack([solve(build_observation(band, psf)).image for band, psf in bands])


def _others() -> Iterator[_Way]:
    """Each of OpenCV's demosaicings, followed by scikit-image's restorations of each band."""
    restoration: Any = importlib.import_module("skimage.restoration")

    def richardson_lucy(band: Array, psf: Array, rounds: int) -> Array:
        return np.asarray(restoration.richardson_lucy(band.clip(0), psf, rounds, clip=False))

    def wiener(band: Array, psf: Array, balance: float) -> Array:
        return np.asarray(restoration.wiener(band, psf, balance, clip=False))

    for method in INTERPOLATIONS:
        for balance in _BALANCES:
            yield partial(_reflected, method=method, solve=partial(wiener, balance=balance))
        for rounds in _ROUNDS:
            solve = partial(richardson_lucy, rounds=rounds)
            yield partial(_reflected, method=method, solve=solve)


def _reflected(case: _Case, method: str, solve: Callable[[Array, Array], Array]) -> np.ndarray:
    """A restoration that knows no border, of each band with a margin of its own reflection."""
    margin = case.psfs.shape[-1] // 2 + _ROOM
    inside = (slice(margin, -margin),) * 2
    bands = zip(interpolate_bayer(case.raw, _PATTERN, method), case.psfs, strict=True)
    return np.stack(
        [solve(np.pad(band, margin, mode="reflect"), psf)[inside] for band, psf in bands]
    )


def _photographs() -> list[Array]:
    """Middle squares of scikit-image's colour photographs, (3, rows, columns), of linear light."""
    data: Any = importlib.import_module("skimage.data")
    stored = [getattr(data, name)() for name in _PICTURES]
    stored.append(data.stereo_motorcycle()[0])
    return [_middle(_averaged_down(_linear(picture / 255.0))) for picture in stored]


def _linear(picture: Array) -> Array:
    """The light of a picture in sRGB, IEC 61966-2-1."""
    return np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)


def _averaged_down(picture: Array) -> Array:
    """The picture with at most _SIDE samples along its shorter side."""
    shrunk = _SIDE / min(picture.shape[:2])
    if shrunk >= 1:
        return picture
    size = [round(n * shrunk) for n in picture.shape[1::-1]]
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))


def _middle(picture: Array) -> Array:
    side = min(picture.shape[:2])
    y, x = ((n - side) // 2 for n in picture.shape[:2])
    return np.ascontiguousarray(np.moveaxis(picture[y : y + side, x : x + side], -1, 0))


def _psfs() -> dict[str, Array]:
    return {
        "disk of 4 pixels": np.stack([disk(4.0)] * 3),
        "ring that grows with wavelength": _rings(),
    }


def _rings() -> Array:
    radii = [_RING_RADIUS * growth for growth in _RING_GROWTH]
    half = round(max(radii) + 5 * _RING_WIDTH)
    at = np.arange(-half, half + 1)
    far = np.hypot(at[:, None], at)
    rings = np.exp(-(((far - np.array(radii)[:, None, None]) / _RING_WIDTH) ** 2) / 2)
    rings *= (1 - _RING_PEAK) / rings.sum((1, 2), keepdims=True)
    rings[:, half, half] += _RING_PEAK
    return np.asarray(rings)


def _simulate(seed: int, scene: Array, psfs: Array) -> _Case:
    """Only what is lit from within the scene, so that the border is unknown."""
    half = psfs.shape[-1] // 2
    blurred = [fftconvolve(band, psf, mode="valid") for band, psf in zip(scene, psfs, strict=True)]
    raw = np.empty(blurred[0].shape)
    for y, row in enumerate(_PATTERN):
        for x, letter in enumerate(row):
            raw[y::2, x::2] = blurred["RGB".index(letter)][y::2, x::2]
    raw += np.random.default_rng(seed).normal(0, _NOISE, raw.shape)
    truth = np.ascontiguousarray(scene[:, half:-half, half:-half])
    return _Case(raw.astype(np.float32), psfs, truth)


MEASUREMENTS = {"colour": colour_figures}
