"""Spectral pictures from one frame behind colour filters, told apart by each band's own PSF."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from figures import Figure
from figures.own_memory import own_memory
from figures.spectral_scenes import (
    SIX_BANDS,
    Array,
    add_peak,
    cave_scene,
    mean_level,
    observe,
    published_rings,
    typical_spectra,
)
from optics.metrics import spectral_angle
from optics.multispectral import restore_spectra
from optics.threads import single_threaded

_NO_SCENE = "not measured: the scenes aren't beside the checkout"
_NO_SPECTRA = "not measured: colour-science isn't installed"


@dataclass(frozen=True, eq=False)
class _Restored:
    """Mean PSNR of the bands in dB, mean spectral angle in degrees, and processor seconds."""

    level: float
    angle: float
    seconds: float

    def __str__(self) -> str:
        return f"{self.level:.2f} dB, {self.angle:.1f}°, {self.seconds:.1f} s"


@dataclass(frozen=True)
class _Goals:
    """What is asked of a scene: least PSNR in dB and largest spectral angle in degrees."""

    level: float
    angle: float

    def met_by(self, found: _Restored) -> bool:
        return found.level >= self.level and found.angle <= self.angle


_GOALS = {
    "paints": _Goals(30.9, 9),
    "feathers": _Goals(29.8, 16),
    "sponges": _Goals(31.3, 5.5),
}
_NOISY_GOALS = {
    "paints": _Goals(30.5, 11.5),
    "feathers": _Goals(29.3, 18),
    "sponges": _Goals(29.5, 7.5),
}
_SECONDS, _SECONDS_ADAPTING = 10.0, 30.0
_GAIN, _LARGEST_LOSS, _LARGEST_ANGLE_LOSS = 0.5, 0.2, 1.0
_NOISE, _PEAK = 0.01, 0.2


@single_threaded
def spectral_figures(folder: Path) -> list[Figure]:
    """Six bands of three scenes, dark beyond the frame, by typical spectra and by the scene's own.

    The noise is told, as it is known in a simulation.
    """
    spectra = typical_spectra(SIX_BANDS)
    scenes = {name: cave_scene(name) for name in _GOALS}
    if spectra is None:
        return [Figure("six bands from one RGGB frame", "", _NO_SPECTRA, None)]
    known = {name: scene for name, scene in scenes.items() if scene is not None}
    if len(known) < len(scenes):
        return [Figure("six bands from one RGGB frame", "", _NO_SCENE, None)]
    rings = published_rings(len(SIX_BANDS))
    plain = {name: _restore(scene, rings, spectra, adapts=False) for name, scene in known.items()}
    adapted = {name: _restore(scene, rings, spectra) for name, scene in known.items()}
    peaked = add_peak(rings, _PEAK)
    noisy = {name: _restore(scene, peaked, spectra, noise=_NOISE) for name, scene in known.items()}
    return [
        *_level_figures("a ring for each band, no noise, typical spectra", _GOALS, plain, _SECONDS),
        _gain_figure(plain, adapted),
        *_level_figures(
            f"rings and {_PEAK:.0%} in the middle, noise {_NOISE:g}", _NOISY_GOALS, noisy,
            _SECONDS_ADAPTING,
        ),
    ]  # fmt: skip


def _level_figures(
    case: str, goals: dict[str, _Goals], found: dict[str, _Restored], seconds: float
) -> list[Figure]:
    return [
        Figure(
            f"six bands of {name} from one RGGB frame, {case}",
            f"≥ {goal.level:g} dB, ≤ {goal.angle:g}° in ≤ {seconds:g} s of processor time",
            str(found[name]),
            goal.met_by(found[name]) and found[name].seconds <= seconds,
        )
        for name, goal in goals.items()
    ]


def _gain_figure(plain: dict[str, _Restored], adapted: dict[str, _Restored]) -> Figure:
    gains = {name: adapted[name].level - plain[name].level for name in plain}
    angles = {name: adapted[name].angle - plain[name].angle for name in plain}
    mean, seconds = (
        float(np.mean(list(gains.values()))),
        max(one.seconds for one in adapted.values()),
    )
    told = ", ".join(f"{name} {adapted[name]}" for name in plain)
    return Figure(
        "the scene's own spectra over typical ones, a ring for each band, no noise",
        f"≥ {_GAIN:g} dB, mean; no scene loses more than {_LARGEST_LOSS:g} dB or "
        f"{_LARGEST_ANGLE_LOSS:g}°; ≤ {_SECONDS_ADAPTING:g} s",
        f"{mean:+.2f} dB, least {min(gains.values()):+.2f} dB, angle at most "
        f"{max(angles.values()):+.1f}°: {told}",
        mean >= _GAIN
        and min(gains.values()) >= -_LARGEST_LOSS
        and max(angles.values()) <= _LARGEST_ANGLE_LOSS
        and seconds <= _SECONDS_ADAPTING,
    )


_TWELVE_BANDS = np.linspace(450, 700, 12)
_TWELVE_GOALS = (32.0, 27.0)


@single_threaded
def twelve_band_figures(folder: Path) -> list[Figure]:
    """Twelve bands of a scene, with unmodulated light and noise, and without both."""
    picture, spectra = cave_scene("paints", _TWELVE_BANDS), typical_spectra(_TWELVE_BANDS)
    rings = published_rings(len(_TWELVE_BANDS))
    cases = (
        (f"{_PEAK:.0%} in the middle, noise {_NOISE:g}", add_peak(rings, _PEAK), _NOISE),
        ("no light in the middle, no noise", rings, 0.0),
    )
    figures = []
    for (case, psfs, noise), goal in zip(cases, _TWELVE_GOALS, strict=True):
        name, wanted = f"twelve bands of paints from one RGGB frame, {case}", f"≥ {goal:g} dB"
        if picture is None or spectra is None:
            why = _NO_SCENE if picture is None else _NO_SPECTRA
            figures.append(Figure(name, wanted, why, None))
            continue
        found = _restore(picture, psfs, spectra, _TWELVE_BANDS, noise=noise)
        figures.append(Figure(name, wanted, str(found), found.level >= goal))
    return figures


_LADDER = {0.0: 31.0, 0.01: 31.0, 0.05: 27.5, 0.1: 24.8}
"""Standard deviation of the noise, and the PSNR in dB that is asked for."""
_PUBLISHED = {0.0: 22.3, 0.01: 22.4, 0.05: 17.8, 0.1: 14.8}
"""PSNR in dB of thesis table 4.2, of another picture of such a chart."""
_SEEDS = 3
_CHART_SIDE = 256
_RADIUS_AT_700 = 20.0


@single_threaded
def noise_figures(folder: Path) -> list[Figure]:
    """A chart of 24 measured reflectances, six bands, as the noise grows."""
    spectra, chart = typical_spectra(SIX_BANDS), _chart()
    figures = []
    for noise, goal in _LADDER.items():
        name = f"six bands of a ColorChecker from one RGGB frame, noise {noise:g}"
        wanted = f"≥ {goal:g} dB, mean of {_SEEDS} seeds"
        if spectra is None or chart is None:
            figures.append(Figure(name, wanted, _NO_SPECTRA, None))
            continue
        psfs = add_peak(_soft_rings(), _PEAK)
        found = [
            _restore(chart, psfs, spectra, noise=noise, seed=seed).level for seed in range(_SEEDS)
        ]
        words = (
            f"{np.mean(found):.1f} dB, least {min(found):.1f} dB; published, of another picture: "
            f"{_PUBLISHED[noise]:.1f} dB"
        )
        figures.append(Figure(name, wanted, words, float(np.mean(found)) >= goal))
    return figures


def _chart() -> Array | None:
    """A ColorChecker of 24 patches with dark lines between them, white at 1; None without
    colour-science."""
    if importlib.util.find_spec("colour") is None:
        return None
    colour: Any = importlib.import_module("colour")
    patches = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()
    values = np.array([np.interp(SIX_BANDS, one.wavelengths, one.values) for one in patches])
    chart = np.full((len(SIX_BANDS), _CHART_SIDE, _CHART_SIDE), 0.03)
    pitch = _CHART_SIDE // 6
    top = (_CHART_SIDE - 4 * pitch) // 2
    for number, value in enumerate(values):
        row, column = divmod(number, 6)
        y, x = top + row * pitch + 3, column * pitch + 5
        chart[:, y : y + pitch - 6, x : x + pitch - 6] = value[:, None, None]
    return chart


def _soft_rings() -> Array:
    """Rings of radius 20 wavelength / 700 nm pixels, with a Gaussian profile of 0.6 pixels."""
    at = np.arange(-27, 28)
    far = np.hypot(at[:, None], at)
    radii = _RADIUS_AT_700 * SIX_BANDS / 700
    rings = np.exp(-(((far - radii[:, None, None]) / 0.6) ** 2) / 2)
    return rings / rings.sum((1, 2), keepdims=True)


_LARGE_SIDE = 805
_ALL_BANDS = np.arange(400, 701, 10)
_ALL_ITERATIONS = 20


@dataclass(frozen=True)
class _Large:
    """A large picture, and what its restoration may take."""

    name: str
    wavelengths: Array
    iterations: int
    seconds: float
    bytes: float


_LARGE = {
    "6": _Large("six bands", SIX_BANDS, 60, 15.0, 1.5e9),
    "31": _Large("31 bands", _ALL_BANDS, _ALL_ITERATIONS, 90.0, 6e9),
}


@single_threaded
def large_figures(folder: Path) -> list[Figure]:
    """Time and largest memory of processes that restore large pictures, libraries included."""
    figures = []
    for key, case in _LARGE.items():
        name = f"{case.name} of {_LARGE_SIDE} x {_LARGE_SIDE} from one RGGB frame"
        goal = f"≤ {case.seconds:g} s of processor time, ≤ {case.bytes / 1e9:g} GB"
        if importlib.util.find_spec("colour") is None:
            figures.append(Figure(name, goal, _NO_SPECTRA, None))
            continue
        done = subprocess.run(
            [sys.executable, "-c", f"from figures.spectral import print_cost; print_cost({key!r})"],
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        said = json.loads(done.stdout.splitlines()[-1])
        words = (
            f"{said['seconds']:.1f} s, {said['bytes'] / 1e9:.2f} GB for {case.iterations} "
            f"iterations with typical spectra, {said['level']:.1f} dB"
        )
        met = said["seconds"] <= case.seconds and said["bytes"] <= case.bytes
        figures.append(Figure(name, goal, words, met))
    return figures


@single_threaded
def print_cost(key: str) -> None:
    """Restore a large picture and print what it took, as JSON: for a process of its own."""
    case = _LARGE[key]
    spectra = typical_spectra(case.wavelengths)
    assert spectra is not None
    picture = _random_squares(spectra)
    found = _restore(
        picture, published_rings(len(case.wavelengths)), spectra, case.wavelengths,
        iterations=case.iterations, adapts=False,
    )  # fmt: skip
    cost = {"level": found.level, "seconds": found.seconds, "bytes": own_memory("VmHWM")}
    print(json.dumps(cost))


def _random_squares(spectra: torch.Tensor) -> Array:
    """A large picture whose squares have typical spectra."""
    count = -(-_LARGE_SIDE // 32)
    squares = np.random.default_rng(0).integers(len(spectra), size=(count, count))
    each = np.kron(squares, np.ones((32, 32), dtype=np.int64))[:_LARGE_SIDE, :_LARGE_SIDE]
    return np.ascontiguousarray(np.moveaxis(np.asarray(spectra)[each], -1, 0))


def _restore(
    picture: Array,
    psfs: Array,
    spectra: torch.Tensor,
    wavelengths: Array = SIX_BANDS,
    *,
    noise: float = 0.0,
    seed: int = 0,
    **settings: Any,
) -> _Restored:
    seen = observe(picture, psfs, wavelengths, noise=noise, seed=seed)
    begun = time.process_time()
    found = restore_spectra(seen, spectra, **settings)
    spent = time.process_time() - begun
    angle = spectral_angle(np.asarray(found.image, dtype=float), picture)
    return _Restored(mean_level(found.image, picture), angle, spent)


MEASUREMENTS = {
    "spectral": spectral_figures,
    "spectral-12": twelve_band_figures,
    "spectral-noise": noise_figures,
    "spectral-large": large_figures,
}
