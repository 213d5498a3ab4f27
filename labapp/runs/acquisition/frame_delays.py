"""Measure how much longer a bench takes for frames than its devices document.

Each call of a device takes time, and a frame has its way to memory. What that comes to depends on
lines, computers and drivers, so it is measured with a few frames before a run on real time.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from labapp.common.frame_delays import FrameDelays
from labapp.files.plan_file import Retry
from labapp.runs.acquisition.frame_taker import FrameTaker
from labapp.runs.bench_interface import Bench
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.shots import Shot, ShotList
from labapp.runs.steps import schedule_shots
from optics.progress import Progress

log = logging.getLogger(__name__)

_EXPOSURE = 0.01
"""Seconds of the measuring frames' exposure. Chosen: short beside what a frame takes otherwise."""

_NEUTRAL = "neutral"

_CONSTANT = {_NEUTRAL: 0, "grey": 128}
"""Grey levels of patterns that are shown where the plan's own are too few. Chosen: any will do."""

_BEFORE_PLAN = -1
"""Index of the measuring frames: they come before those of the plan, and before its faults."""


def measure_frame_delays(
    bench: Bench,
    capabilities: BenchCapabilities,
    planned: Sequence[Shot],
    progress: Progress,
    patterns: Mapping[str, NDArray[np.uint8]] | None = None,
) -> BenchCapabilities:
    """Measure the delays of a bench's frames, once; return its capabilities with them.

    On a virtual bench, a frame takes just the time that its devices document, and nothing is
    measured. A device that fails is named in the log, and the run will tell. Nothing is stored.
    Afterwards the SLM is neutral again, and the filter isn't parked. Raises Cancelled if the
    progress was cancelled.

    planned: the frames whose patterns are tried.
    patterns: grey levels of these patterns by name, which are shown; else, constant ones are.
    """
    if not bench.file.is_real:
        return capabilities
    if bench.frame_delays is None:
        try:
            with bench.cancellable_by(lambda: progress.is_cancelled):
                bench.frame_delays = _measure(
                    bench, capabilities, planned, progress, patterns or {}
                )
        except DeviceError as error:
            progress.raise_if_cancelled()
            log.warning("how long frames take could not be measured: %s", error)
            return capabilities
        log.info("%s", bench.frame_delays)
    return replace(capabilities, delays=bench.frame_delays)


def _measure(
    bench: Bench,
    capabilities: BenchCapabilities,
    planned: Sequence[Shot],
    progress: Progress,
    patterns: Mapping[str, NDArray[np.uint8]],
) -> FrameDelays:
    """Take frames, and compare their times with the documented ones."""
    constant = {
        name: np.full(capabilities.panel_shape, grey, np.uint8) for name, grey in _CONSTANT.items()
    }
    own = [
        shot.pattern
        for shot in ShotList.of(planned).distinct("pattern")
        if shot.pattern in patterns
    ]
    shown = [*dict.fromkeys((*constant, *own))][-2:]
    taker = FrameTaker(
        bench,
        {**patterns, **constant},
        0,
        Retry(attempts=1),
        None,
        progress,
        lambda: progress.is_cancelled,
    )
    shots = schedule_shots(
        _shots(bench, capabilities, shown), replace(capabilities, delays=FrameDelays())
    )
    excess = []
    for shot in shots:
        began = bench.clock.now()
        taker.take(shot, lambda *_: None)
        excess.append(bench.clock.now() - began - shot.duration)
    # The first two bring all devices to a known state, and load what is loaded once. The last
    # leaves the panel neutral. Between them, each change comes twice, with two frames each.
    changed, same = np.array(excess[2:-1:2]), np.array(excess[3:-1:2])
    frame = float(same.mean())
    change, tuned, *placed = (changed.reshape(2, -1).mean(axis=0) - frame).tolist()
    return FrameDelays(frame=frame, filter=tuned, slm=change, target=placed[0] if placed else 0.0)


def _shots(bench: Bench, capabilities: BenchCapabilities, shown: Sequence[str]) -> Sequence[Shot]:
    """Return the frames that measure the delays.

    They are two of one setting each: the first, another pattern, another wavelength, and another
    target unless a person places it; then the first pattern, a third wavelength and the first
    target. The last is of the neutral pattern.

    shown: names of both patterns.
    """
    low, high = capabilities.exposure_range
    first, second, third = _colours(capabilities)
    before, after = shown
    here = bench.targets.current_target
    names = () if bench.targets.by_hand else bench.targets.names
    there = next((name for name in names if name != here), here)
    settings = [
        (first, before, here),
        (first, after, here),
        (second, after, here),
        *([(second, after, there)] if there != here else []),
        (second, before, there),
        (third, before, there),
        *([(third, before, here)] if there != here else []),
    ]
    twice = [setting for setting in settings for _ in range(2)]
    return [
        Shot(
            index=_BEFORE_PLAN,
            step=0,
            repeat=0,
            # Without a name, nobody is asked to place it.
            target="",
            pattern=pattern,
            wavelength=wavelength,
            exposure=min(max(_EXPOSURE, low), high),
            place=place,
            slot=slot,
        )
        for (slot, wavelength), pattern, place in (*twice, (third, _NEUTRAL, here))
    ]


def _colours(capabilities: BenchCapabilities) -> list[tuple[int, float]]:
    """Return three wavelengths of the filter in metres, each with the slot of a wheel, otherwise 0.

    They are seldom those of the plan: a virtual bench that is served to real drivers would have
    computed their pictures, and be quicker in the run than in the measurement.
    """
    if capabilities.slots:
        last = len(capabilities.slots)
        # A wheel may have a single slot.
        return [(slot, capabilities.slots[slot - 1]) for slot in (1, last, (last + 1) // 2)]
    shortest, longest = capabilities.wavelength_range
    between = capabilities.wavelength_in_metres(1e9 * (0.9 * shortest + 0.1 * longest))
    return [(0, shortest), (0, longest), (0, between)]
