"""Choose the exposures of brackets within their limits, and tell beforehand what they may be."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import lcm

from labapp.common.errors import UserError
from labapp.files.bracket_table import Alternative, BracketTable, ChosenTable, MeteredLight
from labapp.files.plan_file import Acquisition, PlanFile
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.steps import planned_settings
from optics.camera import Sensor
from optics.hdr import (
    LADDER_RATIOS,
    ChosenBracket,
    ExposureLimits,
    UnreachableSNR,
    WantedSNR,
    choose_bracket,
    choose_ladder,
    common_period,
)
from optics.hdr.exposures import FIRST_MARGIN, AllowedTimes, ExposureSNR


def bracket_limits(
    block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities, where: str
) -> ExposureLimits:
    """Return the limits of the exposures that are chosen for a block.

    Raises UserError if no exposure is left.

    where: names the block in errors.
    """
    assert block.bracket is not None
    try:
        period = _period(block, plan, capabilities)
        return exposure_limits(block.bracket, capabilities, period)
    except ValueError as error:
        raise UserError(f"{where}: {error}.") from error


def exposure_limits(
    wanted: BracketTable, capabilities: BenchCapabilities, period: float | None
) -> ExposureLimits:
    """Return the limits of exposures by the camera, the bracket's own table, and a period.

    Raises ValueError if no exposure is left.

    period: seconds of which exposures are multiples; None if any will do.
    """
    low, high = capabilities.exposure_range
    if wanted.shortest_ms is not None:
        low = max(low, wanted.shortest_ms * 1e-3)
    if wanted.longest_ms is not None:
        high = min(high, wanted.longest_ms * 1e-3)
    return ExposureLimits(
        low, high, capabilities.readout, period=period, most_frames=wanted.most_frames
    )


def wanted_snr(block: Acquisition, low: float, high: float, settings: int) -> WantedSNR:
    """Return what a bracket shall reach between two rates, with its interleaved dark frames.

    low, high: electrons/s.
    settings: number of targets, patterns and wavelengths of the block that share the dark frames.
    """
    assert block.bracket is not None
    darks = dark_count(block)
    if darks is None:
        return WantedSNR(block.bracket.snr_db, low, high)
    every = [one.every for one in block.interleave if one.role == "dark" and one.every]
    shared = settings if not every else 1
    return WantedSNR(block.bracket.snr_db, low, high, darks, darks / shared)


def dark_count(block: Acquisition) -> int | None:
    """Return the number of dark frames at each exposure of a block; None without any."""
    counts = [one.frames for one in block.interleave if one.role == "dark"]
    return sum(counts) or None


def _period(block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities) -> float | None:
    """Return the seconds of which exposures are multiples; None if any will do."""
    if block.any_exposure:
        return None
    videos = plan.videos(block).values()
    frames = lcm(*(video.length for video in videos)) if videos else 0
    periods = [frames * capabilities.video_frame] if frames else []
    if capabilities.flicker_period is not None and math.isfinite(capabilities.flicker_period):
        periods.append(capabilities.flicker_period)
    return common_period(periods) if periods else None


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


_STEP = 10.0
"""Ratio of the brightest lights for which a bracket is chosen on trial. Chosen: the number of
frames hardly changes between them."""


def possible_plans(
    plan: PlanFile, capabilities: BenchCapabilities, sensor: Sensor, source: str
) -> list[PlanFile]:
    """Settle a plan's brackets, once for each brightness that it may meet.

    Without brackets it is the plan itself. Raises UserError if no light makes a bracket possible.
    """
    listed = [list(one) for one in _blocks(plan, capabilities, sensor, source)]
    most = max(len(one) for one in listed)
    return [
        plan.model_copy(update={"acquire": tuple(one[min(n, len(one) - 1)] for one in listed)})
        for n in range(most)
    ]


def brightest_plan(
    plan: PlanFile, capabilities: BenchCapabilities, sensor: Sensor, source: str
) -> PlanFile:
    """Settle a plan's brackets for the brightest light, which makes it the shortest.

    Raises UserError if no light makes a bracket possible.
    """
    settled = tuple(next(one) for one in _blocks(plan, capabilities, sensor, source))
    return plan.model_copy(update={"acquire": settled})


def _blocks(
    plan: PlanFile, capabilities: BenchCapabilities, sensor: Sensor, source: str
) -> list[Iterator[Acquisition]]:
    """Return, for each block of a plan, what it may be once its bracket is settled."""
    return [
        _possible_blocks(
            block, plan, capabilities, sensor, f"{source}: key 'acquire.{number}.bracket'"
        )
        for number, block in enumerate(plan.acquire)
    ]


def _possible_blocks(
    block: Acquisition,
    plan: PlanFile,
    capabilities: BenchCapabilities,
    sensor: Sensor,
    where: str,
) -> Iterator[Acquisition]:
    """Yield a block with the exposures that it may get, the brightest light first.

    Raises UserError if there are none.
    """
    asked = block.bracket
    if asked is None:
        yield block
        return
    limits = bracket_limits(block, plan, capabilities, where)
    shots = planned_settings(block, plan, capabilities)
    sensor, settings = shots[0].readout.read_sensor(sensor), len(shots)
    try:
        if asked.electrons_per_s is not None:
            yield settle_block(block, sensor, limits, asked.electrons_per_s, settings)
            return
        for times in _possible_exposures(block, sensor, limits, settings):
            exposures = tuple(round(time * 1e3, 6) for time in times)
            yield block.model_copy(update={"bracket": None, "exposures_ms": exposures})
    except UnreachableSNR as error:
        raise UserError(f"{where} can't be had: {error}.") from error


def _possible_exposures(
    block: Acquisition, sensor: Sensor, limits: ExposureLimits, settings: int
) -> Iterator[tuple[float, ...]]:
    """Yield exposure times in seconds that may be chosen, from bright to dim light."""
    assert block.bracket is not None
    shortest, depth = AllowedTimes(limits).time(0), block.bracket.decades
    high = ExposureSNR(sensor).brightest(shortest, FIRST_MARGIN)
    for number in range(40):
        rate = high / _STEP**number
        # The depth of a scene is known only when it is metered: here it has none.
        wanted = wanted_snr(block, rate / 10 ** (depth or 0), rate, settings)
        try:
            yield choose_bracket(sensor, wanted, limits, block.bracket.least).times
        except UnreachableSNR:
            if number == 0:
                raise
            break
    if depth is None:
        yield (limits.longest,) * limits.most_frames
