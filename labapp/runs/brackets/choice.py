"""Choose the exposures of a run's brackets, and say what they are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from labapp.files.bracket_table import Alternative, ChosenTable, MeteredLight
from labapp.files.plan_file import Acquisition
from labapp.runs.brackets.limits import dark_count, wanted_snr
from optics.camera import Sensor
from optics.hdr import (
    LADDER_RATIOS,
    ChosenBracket,
    ExposureLimits,
    UnreachableSNR,
    WantedSNR,
    choose_bracket,
    choose_ladder,
)

_LADDER_FRAMES = 1000
"""Frames that a ladder may have, with which a chosen bracket is compared. Chosen: no limit."""


def settle_block(
    block: Acquisition,
    sensor: Sensor,
    limits: ExposureLimits,
    rates: tuple[float, float],
    settings: int,
    metered: Sequence[MeteredLight] = (),
    metering_seconds: float = 0.0,
) -> Acquisition:
    """Return a run's block with exposures that are chosen for its bracket.

    `rates` are electrons per second, the lower first, and `settings` the combinations of target,
    pattern and wavelength. Raises UnreachableSNR with what can be reached.
    """
    asked = block.bracket
    assert asked is not None
    wanted = wanted_snr(block, *rates, settings)
    found = choose_bracket(sensor, wanted, limits, asked.least)
    chosen = ChosenTable(
        wanted=asked,
        electrons_per_s=rates,
        darks=dark_count(block),
        frames=found.frames,
        seconds=sum(found.times) + found.frames * limits.readout,
        least_snr_db=least_snr_db(found, wanted),
        alternatives=tuple(ladder_alternatives(sensor, wanted, limits)),
        metered=tuple(metered),
        metering_seconds=metering_seconds,
    )
    exposures = tuple(round(time * 1e3, 6) for time in found.times)
    changed = {"bracket": None, "exposures_ms": exposures, "chosen": chosen}
    return block.model_copy(update=changed)


def least_snr_db(bracket: ChosenBracket, wanted: WantedSNR) -> float:
    """Return the lowest ratio in dB that a run's bracket reaches in the wanted range.

    It is at the darkest rate, or right above one from which on an exposure may be clipped.
    """
    ends = [bracket.noise.brightest(time) * (1 + 1e-9) for time, _ in bracket.groups]
    inside = [rate for rate in ends if wanted.low < rate <= wanted.high]
    return float(bracket.snr_db([wanted.low, *inside]).min())


def ladder_alternatives(
    sensor: Sensor, wanted: WantedSNR, limits: ExposureLimits
) -> list[Alternative]:
    """Return the quickest ladders that reach what a run's bracket does; none that don't."""
    found = []
    for ratio in LADDER_RATIOS:
        try:
            ladder = choose_ladder(
                sensor, wanted, replace(limits, most_frames=_LADDER_FRAMES), ratio
            )
        except UnreachableSNR:
            continue
        seconds = sum(ladder.times) + ladder.frames * limits.readout
        found.append(Alternative(name=f"x{ratio:g}", frames=ladder.frames, seconds=seconds))
    return found
