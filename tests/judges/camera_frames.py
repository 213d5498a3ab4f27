"""Frames of a camera in even light and in darkness, from numpy's generator and EMVA 1288's model.

It shares no code with the simulator's sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from optics.measuring import PairedFrames


@dataclass(frozen=True)
class TrueCamera:
    """What a camera is. gain: electrons per number. well, read_noise, dsnu: electrons. current,
    hot_current: electrons per second. hot, dead: pixels' (row, column). bend: share of full scale
    by which numbers are too low there, growing with the square."""

    shape: tuple[int, int] = (160, 160)
    bits: int = 12
    gain: float = 2.6
    well: float = 10_500.0
    read_noise: float = 2.4
    current: float = 1.0
    black: float = 64.0
    prnu: float = 0.0
    dsnu: float = 0.0
    hot: tuple[tuple[int, int], ...] = ()
    hot_current: float = 300.0
    dead: tuple[tuple[int, int], ...] = ()
    bend: float = 0.0

    @property
    def top(self) -> int:
        return 2**self.bits - 1

    @property
    def full(self) -> float:
        """Electrons at which pixels clip."""
        return min(self.well, (self.top - self.black) * self.gain)


@dataclass(frozen=True)
class Lamp:
    """Light that isn't as it should be. drift: relative change over all frames. flicker: relative
    standard deviation from frame to frame. shade: relative loss in the corners."""

    drift: float = 0.0
    flicker: float = 0.0
    shade: float = 0.0


LONGEST = 0.25
"""Seconds of exposure, at which even light is a quarter more than the pixels hold."""


def exposure_times(count: int) -> list[float]:
    """Evenly from darkness to saturation, in whole microseconds, as the ready plan has them."""
    return [5e-5, *(round(float(t) * 1e6) / 1e6 for t in np.linspace(0.006, LONGEST, count - 1))]


def take_frames(
    camera: TrueCamera,
    seed: int,
    *,
    lamp: Lamp = Lamp(),
    count: int = 20,
    longest_dark: float = 2.0,
    rising: bool = False,
) -> PairedFrames:
    """Two dark and two lit frames of each exposure time, and longer dark ones.

    Exposures of the light aren't in the order of their length, unless they are `rising`.
    """
    rng = np.random.default_rng(seed)
    fixed = np.random.default_rng(20_260)
    response = 1 + camera.prnu * fixed.standard_normal(camera.shape)
    offset = camera.dsnu * fixed.standard_normal(camera.shape)
    current = np.full(camera.shape, camera.current)
    for pixel in camera.hot:
        current[pixel] += camera.hot_current
    for pixel in camera.dead:
        response[pixel] = 0.0
    y, x = (np.linspace(-1, 1, n) for n in camera.shape)
    light = 1 - lamp.shade * (y[:, None] ** 2 + x**2) / 2
    light = light * 1.25 * camera.full / LONGEST

    def expose(time: float, factor: float) -> np.ndarray:
        held = rng.poisson(np.maximum(light * response * factor + current, 0) * time)
        held = np.minimum(held, camera.well) + offset
        held = held + camera.read_noise * rng.standard_normal(camera.shape)
        number = held / camera.gain
        number = number - camera.bend * number**2 * camera.gain / camera.full
        return np.clip(np.round(number + camera.black), 0, camera.top).astype(np.uint16)

    times = exposure_times(count)
    order = range(count) if rising else sorted(range(count), key=lambda n: n * 8 % count)
    darks = [*times, *(longest_dark * share for share in (0.25, 0.5, 0.75, 1.0))]
    shots = [(time, False) for time in darks for _ in range(2)]
    shots += [(times[n], True) for n in order for _ in range(2)]
    frames, clock, began = [], 0.0, []
    duration = 2 * sum(times)
    for time, lit in shots:
        began.append(clock)
        passed = (clock - 2 * sum(darks)) / duration
        factor = 1 + lamp.drift * passed + lamp.flicker * rng.standard_normal() if lit else 0.0
        frames.append(expose(time, factor))
        clock += time
    exposures, marks = zip(*shots, strict=True)
    return PairedFrames(
        frames, np.array(exposures), np.array(marks), camera.top, times=np.array(began)
    )
