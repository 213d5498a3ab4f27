"""Exposure brackets that are chosen by metering: against an exhaustive search that knows the scene,
ladders of exposures, and merged frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from judges.exhaustive_bracket import exhaustive
from scipy import ndimage

from figures import Figure
from figures.stopwatch import processor_seconds
from optics.camera import Sensor
from optics.hdr import (
    LADDER_RATIOS,
    Bracket,
    ChosenBracket,
    ExposureLimits,
    Meter,
    UnreachableSNR,
    WantedSNR,
    choose_bracket,
    choose_ladder,
    merge,
    scene_change,
    scene_light,
)
from optics.threads import single_threaded

_SCENES, _SHAPE, _DARKS = 50, (240, 320), 4
_BIN = 0.05
"""Decades of rate whose pixels are judged together."""


Frames = list[tuple[float, np.ndarray]]
"""Exposures in seconds, and digital numbers."""


@dataclass(frozen=True)
class Scene:
    """rate: electrons per second, (rows, columns). decades: of the wanted range below the brightest
    pixels, or None where it goes down to the darkest hundredth."""

    sensor: Sensor
    limits: ExposureLimits
    rate: np.ndarray
    snr_db: float
    decades: float | None

    def frame(self, time: float, rng: np.random.Generator, factor: float = 1.0) -> np.ndarray:
        """Digital numbers by EMVA 1288."""
        sensor, light = self.sensor, factor * self.rate + self.sensor.dark_current
        electrons = rng.poisson(light * time) + rng.normal(0, sensor.read_noise, _SHAPE)
        numbers = np.round(electrons / sensor.gain + sensor.black_level)
        return np.clip(numbers, 0, 2**sensor.bits - 1)

    @property
    def wanted(self) -> WantedSNR:
        """The range as who knows the scene would ask for it."""
        high = float(self.rate.max())
        low = high / 10**self.decades if self.decades else float(np.quantile(self.rate, 0.01))
        return WantedSNR(self.snr_db, low, high, _DARKS)


@dataclass(frozen=True)
class Seen:
    """Times over that of the exhaustive search: with metering whose frames are merged too, with
    metering frames thrown away, and without metering. ladders: that of the first over the ladders'.
    frames, bare_frames: over those of the x2 ladder, with and without those of metering. reached:
    share of the pixels in range. told: changes of 20 %, and of none."""

    kept: float
    thrown: float
    bare: float
    ladders: float
    frames: float
    bare_frames: float
    reached: float
    told: tuple[bool, bool, bool]


def _scenes(rng: np.random.Generator) -> Iterator[Scene]:
    """Scenes of 1.5 to 5 decades, whose darkest pixels reach the ratio in .3 to 10 s."""
    for number in range(_SCENES):
        well, bits = float(10 ** rng.uniform(3.7, 4.7)), int(rng.choice([12, 14]))
        sensor = Sensor(
            bits=bits, full_well=well, gain=well / (2**bits - 64),
            read_noise=float(10 ** rng.uniform(0.2, 1.1)), dark_current=1.0, black_level=64.0,
        )  # fmt: skip
        decades, snr_db = float(rng.uniform(1.5, 5)), float(rng.uniform(20, 36))
        lasts = 10 ** rng.uniform(-0.5, 1)
        low = (10 ** (snr_db / 10) + 3 * sensor.read_noise) / lasts
        # The bench's shortest exposure must not clip the brightest pixels.
        decades = min(decades, math.log10(0.5 * well / 20e-6 / low))
        limits = ExposureLimits(20e-6, 30.0, float(rng.choice([0.001, 0.004, 0.008])))
        # Every second picture is smooth, as through a lens; in the others each pixel is its own.
        share = rng.random(_SHAPE) if number // 2 % 2 else _smooth(rng)
        rate = low * 10 ** (decades * share)
        yield Scene(sensor, limits, rate, snr_db, decades if number % 2 else None)


def _smooth(rng: np.random.Generator) -> np.ndarray:
    """Evenly distributed numbers from 0 to 1, alike in neighbouring pixels."""
    made = ndimage.gaussian_filter(rng.normal(size=_SHAPE), 2.5, mode="wrap")
    return made.ravel().argsort().argsort().reshape(_SHAPE) / (made.size - 1)


def _meter(scene: Scene, rng: np.random.Generator) -> tuple[WantedSNR, Frames]:
    """Meter a scene from 1 ms on; the range, and the frames with their exposures."""
    meter = Meter(scene.sensor, scene.limits, 1e-3, scene.snr_db, scene.decades)
    frames = []
    while meter.next_time is not None:
        frames.append((meter.next_time, scene.frame(meter.next_time, rng)))
        meter.add(*frames[-1])
    found = meter.metered_range
    return WantedSNR(scene.snr_db, found.low, found.high, _DARKS), frames


def _judge(scene: Scene, rng: np.random.Generator) -> Seen:
    sensor, limits, wanted = scene.sensor, scene.limits, scene.wanted
    metered, frames = _meter(scene, rng)
    times = [time for time, _ in frames]
    metering = sum(times) + len(times) * limits.readout
    taken = tuple((time, times.count(time)) for time in dict.fromkeys(times))
    rest = choose_bracket(sensor, metered, limits, taken=taken)
    alone = choose_bracket(sensor, metered, limits)
    best = exhaustive(sensor, wanted, limits, seconds=20)
    ladders = _ladders(scene)
    return Seen(
        (rest.duration + metering) / best.duration,
        (alone.duration + metering) / best.duration,
        choose_bracket(sensor, wanted, limits).duration / best.duration,
        (rest.duration + metering) / min(one.duration for one in ladders.values()),
        (rest.frames + len(frames)) / ladders[2.0].frames,
        alone.frames / ladders[2.0].frames,
        _reached_share(scene, frames, rest, rng),
        _told(scene, frames, alone, rng),
    )


def _ladders(scene: Scene) -> dict[float, ChosenBracket]:
    """Ladders that reach the ratio over the true range, by factor."""
    found, limits = {}, replace(scene.limits, most_frames=1000)
    for ratio in LADDER_RATIOS:
        try:
            found[ratio] = choose_ladder(scene.sensor, scene.wanted, limits, ratio)
        except UnreachableSNR:
            continue
    return found


def _reached_share(
    scene: Scene,
    frames: Frames,
    rest: ChosenBracket,
    rng: np.random.Generator,
) -> float:
    """The share of the pixels in range whose bin of rates has the wanted error, within chance."""
    sensor, wanted = scene.sensor, scene.wanted
    every = [*frames, *((time, scene.frame(time, rng)) for time in rest.times)]
    dark = replace(scene, rate=np.zeros(_SHAPE))
    levels = {
        time: np.mean([dark.frame(time, rng) for _ in range(_DARKS)], axis=0)
        for time in {time for time, _ in every}
    }
    times = [time for time, _ in every]
    merged = merge(
        Bracket(
            [numbers for _, numbers in every], times, [levels[time] for time in times],
            [_DARKS] * len(times), sensor,
        )
    )  # fmt: skip
    inside = (scene.rate >= wanted.low) & (scene.rate <= wanted.high)
    rate = scene.rate[inside]
    squares = (merged.rate.numpy()[inside] / rate - 1) ** 2
    place = np.floor(np.log10(rate) / _BIN).astype(int)
    place -= place.min()
    counts = np.bincount(place)
    mean = np.bincount(place, squares) / np.maximum(counts, 1)
    # The mean of so many squares is itself known to the root of two over their number.
    allowed = 10 ** (-scene.snr_db / 10) * (1 + 2 * np.sqrt(2 / np.maximum(counts, 1)))
    return float(counts[mean <= allowed].sum() / counts.sum())


def _told(
    scene: Scene,
    frames: Frames,
    bracket: ChosenBracket,
    rng: np.random.Generator,
) -> tuple[bool, bool, bool]:
    """Whether a fifth more light, a fifth less, and no change are told by the bracket's frames."""
    before = scene_light(frames, scene.sensor)

    def is_told(factor: float) -> bool:
        seen = ([(time, scene.frame(time, rng, factor))] for time in bracket.times)
        after = (scene_light(one, scene.sensor) for one in seen)
        return any(scene_change(before, one).is_notable for one in after)

    return is_told(1.2), is_told(0.8), is_told(1.0)


def _choice_seconds(scene: Scene) -> float:
    def choose() -> None:
        choose_bracket(scene.sensor, scene.wanted, scene.limits)

    return processor_seconds({"choose": choose}, 1)["choose"]


@single_threaded
def chosen_bracket_figures(folder: Path) -> list[Figure]:
    """Fifty random scenes and sensors."""
    rng = np.random.default_rng(20261127)
    scenes = list(_scenes(rng))
    seen = [_judge(scene, rng) for scene in scenes]
    names = ("kept", "thrown", "bare", "ladders", "frames", "bare_frames", "reached")
    kept, thrown, bare, ladders, frames, bare_frames, reached = (
        np.array([getattr(one, name) for one in seen]) for name in names
    )
    told = np.array([one.told for one in seen])
    spent = max(_choice_seconds(scene) for scene in scenes)
    return [
        Figure(
            "chosen brackets, 50 scenes: time with metering whose frames are merged too, over the "
            "exhaustive optimum's without",
            "≤ 1.05",
            f"median {np.median(kept):.3f}, largest {kept.max():.3f}; {(kept > 1.05).sum()} beyond",
            bool(kept.max() <= 1.05),
        ),
        Figure(
            "the same, metering frames thrown away, as in runs",
            "≤ 1.05",
            f"median {np.median(thrown):.3f}, largest {thrown.max():.3f}; "
            f"{(thrown > 1.05).sum()} beyond",
            bool(thrown.max() <= 1.05),
        ),
        Figure(
            "the same where the range is given",
            "≤ 1.05",
            f"median {np.median(bare):.3f}, largest {bare.max():.3f}",
            bool(bare.max() <= 1.05),
        ),
        Figure(
            "their time with metering, over the quickest of equal ladders of x2, x4 and x8",
            "≤ 1",
            f"median {np.median(ladders):.2f}, largest {ladders.max():.2f}; "
            f"{(ladders > 1).sum()} beyond",
            bool(ladders.max() <= 1),
        ),
        Figure(
            "their frames, over those of the x2 ladder",
            "median ≤ 2/3",
            f"median {np.median(bare_frames):.2f}, {np.median(frames):.2f} with those of metering",
            bool(np.median(bare_frames) <= 2 / 3),
        ),
        Figure(
            "pixels in range whose merged frames reach the ratio",
            "≥ 95 %",
            f"least {reached.min():.1%}, median {np.median(reached):.1%}",
            bool(reached.min() >= 0.95),
        ),
        Figure(
            "scenes of 20 % more or less light since metering that are told; unchanged ones",
            "100 %; none",
            f"{told[:, :2].mean():.0%}; {told[:, 2].sum()} of {len(told)}",
            bool(told[:, :2].all() and not told[:, 2].any()),
        ),
        Figure("processor time of a choice", "≤ 1 s", f"at most {spent:.2f} s", spent <= 1.0),
    ]


MEASUREMENTS = {"chosen-brackets": chosen_bracket_figures}
