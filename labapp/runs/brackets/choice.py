"""Choose the exposures of brackets, and say what they are compared with."""

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
    """Return a block with exposures that are chosen for its bracket.

    Raises UnreachableSNR with what can be reached.

    rates: electrons/s, the lower first.
    settings: number of combinations of target, pattern and wavelength.
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
        seconds=bare_seconds(found, limits),
        least_snr_db=least_snr_db(found, wanted),
        alternatives=tuple(
            Alternative(name=name, frames=one.frames, seconds=bare_seconds(one, limits))
            for name, one in equal_ladders(sensor, wanted, limits).items()
        ),
        metered=tuple(metered),
        metering_seconds=metering_seconds,
    )
    exposures = tuple(round(time * 1e3, 6) for time in found.times)
    changed = {"bracket": None, "exposures_ms": exposures, "chosen": chosen}
    return block.model_copy(update=changed)


def least_snr_db(bracket: ChosenBracket, wanted: WantedSNR) -> float:
    """Return the lowest ratio in dB that a bracket reaches in the wanted range.

    It is at the darkest rate, or right above one from which on an exposure may be clipped.
    """
    ends = [bracket.noise.brightest(time) * (1 + 1e-9) for time, _ in bracket.groups]
    inside = [rate for rate in ends if wanted.low < rate <= wanted.high]
    return float(bracket.snr_db([wanted.low, *inside]).min())


def equal_ladders(
    sensor: Sensor, wanted: WantedSNR, limits: ExposureLimits
) -> dict[str, ChosenBracket]:
    """Return the quickest ladders that reach what is wanted of a bracket, by name.

    Those that don't reach it are left out.
    """
    found = {}
    for ratio in LADDER_RATIOS:
        try:
            found[f"x{ratio:g}"] = choose_ladder(
                sensor, wanted, replace(limits, most_frames=_LADDER_FRAMES), ratio
            )
        except UnreachableSNR:
            continue
    return found


def bare_seconds(bracket: ChosenBracket, limits: ExposureLimits) -> float:
    """Return the seconds of an exposure series with read-out, dark frames aside."""
    return sum(bracket.times) + bracket.frames * limits.readout
