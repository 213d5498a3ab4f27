"""Undoing a blur: quality and time, at the borders, without an oracle, beside other libraries."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from figures import Figure
from figures.photographs import camera, squares
from figures.stopwatch import processor_seconds
from labapp.accuracy.blurs import (
    BLURS,
    Array,
    SimulatedPhotograph,
    circle,
    disk,
    simulate_photograph,
)
from labapp.accuracy.deconvolve import psnr_away_from_border
from labapp.pictures.networks import bundled_denoiser
from optics.inverse.observation import Observation
from optics.inverse.observation_builder import build_observation
from optics.inverse.plug_and_play import plug_and_play
from optics.inverse.restored_image import RestoredImage
from optics.inverse.richardson_lucy import richardson_lucy
from optics.inverse.total_variation import initial_weight, total_variation
from optics.inverse.wiener import wiener
from optics.threads import single_threaded

_NOISE = 0.01
_SEED = 0
_REPEATS = 7

_QUICK, _FRAMED, _MANY = 6, 8, 20
"""Iterations of total variation: of a period, of a frame, and where time doesn't count."""

_AROUND = np.geomspace(0.2, 5, 9)
"""Weights over our own, among which an oracle takes the best."""

_NONE = "not measured: scikit-image isn't installed"


@single_threaded
def blur_figures(folder: Path) -> list[Figure]:
    """The field's usual picture, seen through a disk of 7 and a ring of 12."""
    scene = camera()
    if scene is None:
        return [Figure("camera seen through a disk of 7", "≥ 27.4 dB", _NONE, None)]
    tiled = np.pad(scene, ((0, 512), (0, 512)), mode="symmetric")
    ring = simulate_photograph("ring", scene, circle(12, 0.1), _NOISE, _SEED)
    around = simulate_photograph("ring", scene, circle(12, 0.1), _NOISE, _SEED, "periodic")
    return [
        _figure(
            "disk of 7, noise .01, 512², period known: total variation",
            simulate_photograph("512", scene, disk(7), _NOISE, _SEED, "periodic"),
            _QUICK, 27.4, 40,
        ),
        _figure(
            "disk of 7, noise .01, 1024², period known: total variation",
            simulate_photograph("1024", tiled, disk(7), _NOISE, _SEED, "periodic"),
            _QUICK, 27.5, 160,
        ),
        _figure(
            "disk of 7, noise .01, 512², as a camera sees it, whole frame: total variation",
            simulate_photograph("frame", scene, disk(7), _NOISE, _SEED),
            _FRAMED, 27.4, 250,
        ),
        _figure(
            "ring of 12 and a tenth in its centre, period known: total variation",
            around, _QUICK, 29.0, None,
        ),
        _figure(
            "ring of 12 and a tenth in its centre, as a camera sees it: total variation",
            ring, _FRAMED, 29.0, None,
        ),
        _highlights(scene),
    ]  # fmt: skip


def _figure(
    name: str, case: SimulatedPhotograph, count: int, goal: float, most: float | None
) -> Figure:
    """PSNR and processor time, noise and weight estimated; and the time with both told."""
    restored, ms = _timed(lambda: total_variation(case.problem, iterations=count))
    decibels, similar = case.quality(restored.image)
    weight, problem = restored.weight, replace(case.problem, given_noise=case.noise)
    again, told = _timed(lambda: total_variation(_anew(problem), weight, iterations=count))
    words = (
        f"{decibels:.2f} dB, SSIM {similar:.3f}, {ms:.0f} ms; {told:.0f} ms and "
        f"{case.quality(again.image)[0]:.2f} dB with noise and weight told"
    )
    limit = "" if most is None else f" in ≤ {most:.0f} ms"
    ways = ((decibels, ms), (case.quality(again.image)[0], told))
    met = any(level >= goal and (most is None or spent <= most) for level, spent in ways)
    return Figure(name, f"≥ {goal} dB{limit}", words, met)


def _anew(problem: Observation) -> Observation:
    """The same with nothing computed yet."""
    return replace(problem)


def _timed(call: Callable[[], RestoredImage]) -> tuple[RestoredImage, float]:
    """The answer and the median of its processor times in ms."""
    return call(), 1e3 * processor_seconds({"": call}, _REPEATS)[""]


def _highlights(scene: Array) -> Figure:
    """40 highlights of 3 x 3 pixels, eight times white, that clip about a hundredth of a frame."""
    rng, bright = np.random.default_rng(_SEED), scene.copy()
    for y, x in rng.integers(20, 489, (40, 2)):
        bright[y : y + 3, x : x + 3] = 8.0
    case = simulate_photograph("highlights", bright, disk(7), _NOISE, _SEED, "periodic")
    clipped = case.observation >= 1
    case = replace(
        case, observation=np.minimum(case.observation, 1), truth=np.minimum(case.truth, 1)
    )
    problem = build_observation(
        case.observation.astype(np.float32), case.psf, None, case.border, clipped=clipped
    )
    masked = case.quality(total_variation(problem, iterations=_MANY).image)[0]
    plain = case.quality(total_variation(case.problem, iterations=_MANY).image)[0]
    return Figure(
        "a hundredth of the pixels saturated, which ones known: total variation",
        "≥ 26.5 dB",
        f"{masked:.2f} dB with {clipped.mean():.1%} clipped; {plain:.2f} dB without the mask",
        masked >= 26.5,
    )


@single_threaded
def against_scikit_image(folder: Path) -> list[Figure]:
    """Wiener's filter and Richardson-Lucy beside scikit-image's, on what a camera sees."""
    scene = camera()
    goal = "≥ 4 times faster, inside no .05 dB worse, ≥ 6 dB better over the frame"
    if scene is None:
        return [Figure("Richardson-Lucy beside scikit-image's, whole frame", goal, _NONE, None)]
    restoration: Any = importlib.import_module("skimage.restoration")
    case = simulate_photograph("frame", scene, disk(7), _NOISE, _SEED)
    around = simulate_photograph("period", scene, disk(7), _NOISE, _SEED, "periodic")
    balance = max(
        np.geomspace(1e-3, 1, 13),
        key=lambda b: around.quality(restoration.wiener(around.observation, around.psf, b))[0],
    )
    weight = wiener(case.problem, steps=0).weight
    told = replace(case.problem, given_noise=_NOISE)
    pairs: list[tuple[str, Callable[[], Array], Callable[[], RestoredImage]]] = [
        (
            "Wiener beside scikit-image's at the balance that is best of a period, whole frame",
            lambda: restoration.wiener(case.observation, case.psf, balance),
            lambda: wiener(_anew(told), weight, steps=0),
        ),
        (
            "Wiener beside scikit-image's at the balance of its manual, .1, whole frame",
            lambda: restoration.wiener(case.observation, case.psf, 0.1),
            lambda: wiener(_anew(told), weight, steps=0),
        ),
        (
            "Richardson-Lucy beside scikit-image's, whole frame",
            lambda: restoration.richardson_lucy(case.observation, case.psf, num_iter=30),
            lambda: richardson_lucy(_anew(told), 10),
        ),
    ]
    return [_beside(what, goal, case, theirs, ours) for what, theirs, ours in pairs]


def _beside(
    name: str,
    goal: str,
    case: SimulatedPhotograph,
    theirs: Callable[[], Array],
    ours: Callable[[], RestoredImage],
) -> Figure:
    spent = processor_seconds({"theirs": theirs, "ours": ours}, _REPEATS)
    ratio = spent["theirs"] / spent["ours"]
    them, us = np.asarray(theirs()), np.asarray(ours().image, dtype=np.float64)
    frame = case.quality(us)[0] - case.quality(them)[0]
    within = (psnr_away_from_border(case, us) or 0) - (psnr_away_from_border(case, them) or 0)
    return Figure(
        name,
        goal,
        f"{ratio:.1f} times faster, {within:+.2f} dB inside, {frame:+.1f} dB over the frame "
        f"({case.quality(us)[0]:.2f})",
        ratio >= 4 and within >= -0.05 and frame >= 6,
    )


@single_threaded
def weights_figure(folder: Path) -> list[Figure]:
    """24 pictures, 12 blurs, three noises: our weight against the best of nine around it."""
    name, goal = "weights without an oracle: dB below the oracle's", "median ≤ 0.3"
    pictures, where = squares(24, 200)
    if not pictures:
        return [Figure(name, goal, where, None)]
    losses = []
    for number, scene in enumerate(pictures):
        for blur in list(BLURS)[:12]:
            for noise in (0.003, 0.01, 0.03):
                losses.append(_lost(simulate_photograph(blur, scene, BLURS[blur](), noise, number)))
    low, high = np.quantile(losses, (0.5, 0.9))
    told = f"median {low:.2f}, nine tenths below {high:.2f}; {len(losses)} cases {where}"
    return [Figure(name, goal, told, bool(low <= 0.3))]


def _lost(case: SimulatedPhotograph) -> float:
    """Decibels that a better weight would gain."""
    own = case.quality(total_variation(case.problem, iterations=_MANY).image)[0]
    return max(own, _best(case)) - own


def _best(case: SimulatedPhotograph) -> float:
    """PSNR by total variation with the weight that serves best."""
    told = replace(case.problem, given_noise=case.noise)
    first = initial_weight(told)
    return max(
        case.quality(total_variation(told, first * share, iterations=_MANY).image)[0]
        for share in _AROUND
    )


@single_threaded
def learned_figure(folder: Path) -> list[Figure]:
    """24 pictures, 6 blurs: the learned denoiser, with nothing told, against total variation at
    the weight that serves best."""
    name, goal = "plug-and-play over the best total variation", "median ≥ 0.5 dB"
    pictures, where = squares(24, 256)
    if not pictures:
        return [Figure(name, goal, where, None)]
    gains = [gain for case in _six(pictures) for gain in [_gain(case)]]
    low, middle, high = np.quantile(gains, (0.1, 0.5, 0.9))
    told = f"median {middle:+.2f} dB, {low:+.2f} to {high:+.2f}; {len(gains)} cases {where}"
    return [Figure(name, goal, told, bool(middle >= 0.5))]


def _six(pictures: list[Array]) -> Iterator[SimulatedPhotograph]:
    names = ("disk of 7", "Gaussian of 3", "shake of 20", "ring of 12 and a tenth in its centre",
             "spiral of 10", "line of 15")  # fmt: skip
    for number, scene in enumerate(pictures):
        for blur in names:
            yield simulate_photograph(blur, scene, BLURS[blur](), _NOISE, number)


def _gain(case: SimulatedPhotograph) -> float:
    learned = plug_and_play(case.problem, bundled_denoiser()).image
    return case.quality(learned)[0] - _best(case)


MEASUREMENTS = {
    "deconvolution": blur_figures,
    "scikit-image": against_scikit_image,
    "weights": weights_figure,
    "learned": learned_figure,
}
