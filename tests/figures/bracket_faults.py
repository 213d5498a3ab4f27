"""What is wrong with exposure brackets: frames of another exposure, flickering light, things that
move, and pixels that don't measure light."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from figures import Figure
from optics.camera import Sensor
from optics.hdr import MOVED, Bracket, find_defects, measure_exposure_factors, merge
from optics.threads import single_threaded

_SENSOR = Sensor(
    bits=12, full_well=1e6, gain=2.6, read_noise=2.4, dark_current=0.0, black_level=64.0
)
_SHAPE, _FRAMES, _BRACKETS = (150, 200), 8, 100
_FLICKER = 0.01
"""Period of the light of a lamp at 50 Hz, seconds."""


def _scene(times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Five decades below the light that clips the shortest exposure: as many pixels in each, or
    smooth, or around two places."""
    kind = rng.integers(3)
    if kind == 0:
        decades = rng.uniform(-5, 0.1, _SHAPE)
    elif kind == 1:
        slopes = np.add.outer(
            *(np.linspace(0, one, n) for one, n in zip((1, 4), _SHAPE, strict=True))
        )
        decades = -5 + slopes + rng.normal(0, 0.05, _SHAPE)
    else:
        decades = np.where(rng.random(_SHAPE) < 0.5, -4, -1) + rng.normal(0, 0.6, _SHAPE)
    top = (_SENSOR.full_scale - 64) * _SENSOR.gain
    return top / times[0] * 10 ** np.clip(decades, -5, 0.1)


def _bracket(
    rate: np.ndarray, times: np.ndarray, factors: np.ndarray, rng: np.random.Generator
) -> Bracket:
    frames = [
        np.clip(np.round((rng.poisson(rate * time * factor) + rng.normal(0, 2.4, rate.shape)) / 2.6)
                + 64, 0, 4095)
        for time, factor in zip(times, factors, strict=True)
    ]  # fmt: skip
    return Bracket(frames, times, [64.0] * len(times), [math.inf] * len(times), _SENSOR)


@single_threaded
def bracket_fault_figures(folder: Path) -> list[Figure]:
    """Random ladders of eight exposures, factors of 2 to 4, and random scenes."""
    rng = np.random.default_rng(20261127)
    return [
        *_wrong_frame_figures(rng),
        _exchange_figure(rng),
        _flicker_figure(rng),
        *_motion_figures(rng),
        _defect_figure(rng),
    ]


def _wrong_frame_figures(rng: np.random.Generator) -> list[Figure]:
    named, alone, false = 0, 0, 0
    for _ in range(_BRACKETS):
        times = 1e-3 * rng.uniform(2, 4) ** np.arange(_FRAMES)
        rate, factors, wrong = _scene(times, rng), np.ones(_FRAMES), rng.integers(_FRAMES)
        false += bool(measure_exposure_factors(_bracket(rate, times, factors, rng)).suspects)
        factors[wrong] += rng.choice([-1, 1]) * rng.uniform(0.05, 0.3)
        suspects = measure_exposure_factors(_bracket(rate, times, factors, rng)).suspects
        named += wrong in suspects
        alone += suspects == [wrong]
    return [
        Figure(
            "one of 8 frames 5 to 30 % off, named",
            "≥ 95 of 100",
            f"{named} of {_BRACKETS}; no other one with it in {alone}",
            named >= 0.95 * _BRACKETS,
        ),
        Figure(
            "a frame named in a bracket whose exposures are right",
            "≤ 1 of 100",
            f"{false} of {_BRACKETS}",
            false <= 0.01 * _BRACKETS,
        ),
    ]


def _exchange_figure(rng: np.random.Generator) -> Figure:
    """Any two of eight frames; white ones, of which less than 3 % tells them apart, aren't."""
    named, seen = 0, 0
    while seen < _BRACKETS:
        times = 1e-3 * rng.uniform(2, 4) ** np.arange(_FRAMES)
        bracket = _bracket(_scene(times, rng), times, np.ones(_FRAMES), rng)
        one, other = np.sort(rng.permutation(_FRAMES)[:2])
        frames = list(bracket.frames)
        if max((frames[k] < _SENSOR.full_scale).mean() for k in (one, other)) < 0.03:
            continue
        frames[one], frames[other] = frames[other], frames[one]
        turned = Bracket(frames, times, bracket.darks, bracket.dark_counts, _SENSOR)
        words = " ".join(measure_exposure_factors(turned).explain())
        named += words.startswith(f"frames {one + 1} and {other + 1} look exchanged")
        seen += 1
    return Figure(
        "two of 8 frames exchanged, both named", "≥ 95 of 100", f"{named} of {seen}",
        named >= 0.95 * seen,
    )  # fmt: skip


def _flicker_figure(rng: np.random.Generator) -> Figure:
    """A lamp whose light swings by 30 % at 100 Hz, exposures of 1 to 128 ms at random phases."""
    offered, seen = 0, 0
    times = 1e-3 * 2.0 ** np.arange(_FRAMES)
    turns = np.pi * times / _FLICKER
    for _ in range(_BRACKETS):
        phase = rng.uniform(0, 2 * np.pi, _FRAMES)
        factors = 1 + 0.3 * np.sin(turns) / turns * np.cos(phase + turns)
        found = measure_exposure_factors(_bracket(_scene(times, rng), times, factors, rng))
        for words in found.explain():
            seen += 1
            offered += "flickers" in words and "exposed otherwise" in words
    return Figure(
        "light that swings by 30 % at 100 Hz: frames named, with flicker and a wrong exposure both "
        "offered",
        "≥ 95 %",
        f"{offered} of {seen} in {_BRACKETS} brackets",
        offered >= 0.95 * seen and seen >= _BRACKETS,
    )


def _motion_figures(rng: np.random.Generator) -> list[Figure]:
    """In half of the picture one frame differs by six standard deviations of its difference from
    what the others tell."""
    out, still = [], []
    for _ in range(20):
        times = 1e-3 * rng.uniform(2, 4) ** np.arange(_FRAMES)
        rate, moved = _scene(times, rng), rng.integers(_FRAMES)
        bracket = _bracket(rate, times, np.ones(_FRAMES), rng)
        deviation, seen = _difference(rate, times, moved)
        frames = [np.array(one) for one in bracket.frames]
        half = np.zeros(_SHAPE, dtype=bool)
        half[: _SHAPE[0] // 2] = True
        frames[moved] = np.where(
            half & seen, np.round(frames[moved] + 6 * deviation), frames[moved]
        )
        found = merge(Bracket(frames, times, bracket.darks, bracket.dark_counts, _SENSOR))
        state = found.state.numpy() == MOVED
        out.append(state[half & seen])
        still.append(state[~half])
    share, false = (float(np.concatenate(one).mean()) for one in (out, still))
    return [
        Figure("pixels that differ in one of 8 frames by six standard deviations, left out",
               "≥ 95 %", f"{share:.1%}", share >= 0.95),
        Figure("still pixels left out", "≤ .1 %", f"{false:.3%}", false <= 1e-3),
    ]  # fmt: skip


def _difference(rate: np.ndarray, times: np.ndarray, moved: int) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation, in digital numbers, of a frame less what all others tell; and where the
    frame, so changed, is open, and another one too."""
    top = (_SENSOR.full_scale - 0.5 - 64) * _SENSOR.gain
    floor = 2.4**2 + 2.6**2 / 12
    information = np.zeros(rate.shape)
    for number, time in enumerate(times):
        light = rate * time
        sure = light + 12 * np.sqrt(light + floor) < top
        if number != moved:
            information += sure * time**2 / (light + floor)
    light = rate * times[moved]
    with np.errstate(divide="ignore"):
        deviation = np.sqrt(light + floor + times[moved] ** 2 / information)
    seen = (light + 24 * np.sqrt(light + floor) + 6 * deviation < top) & (information > 0)
    return np.where(seen, deviation, 0) / _SENSOR.gain, seen


def _defect_figure(rng: np.random.Generator) -> Figure:
    """Dark frames of four exposures, in which one pixel of a thousand has a hundred times the dark
    current of the others, or more."""
    times = 0.05 * 4.0 ** np.arange(4)
    found, false, there = 0, 0, 0
    for _ in range(10):
        hot = rng.random(_SHAPE) < 1e-3
        current = np.where(hot, 10 ** rng.uniform(2, 4, _SHAPE), 1.0)
        frames = [rng.poisson((current + 1e3) * t) / 2.6 + 64 for t in times]
        darks = [
            np.mean([np.round((rng.poisson(current * t) + rng.normal(0, 2.4, _SHAPE)) / 2.6) + 64
                     for _ in range(4)], axis=0)
            for t in times
        ]  # fmt: skip
        mask = find_defects(Bracket(frames, times, darks, [4] * 4, _SENSOR)).mask
        found, false, there = (
            found + (mask & hot).sum(),
            false + (mask & ~hot).sum(),
            there + hot.sum(),
        )
    return Figure(
        "hot pixels, 1e2 to 1e4 electrons a second, found in four dark frames of 3.2 s",
        "≥ 95 %, no other",
        f"{found / there:.1%} of {there}, {false} others",
        bool(found >= 0.95 * there and not false),
    )


MEASUREMENTS = {"bracket-faults": bracket_fault_figures}
