"""Tell beforehand how short and how long a run with chosen brackets may be."""

from __future__ import annotations

from collections.abc import Iterator

from labapp.common.errors import UserError
from labapp.files.plan_file import Acquisition, PlanFile
from labapp.runs.brackets.choice import bracket_limits, settle_block, wanted_snr
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.steps import planned_settings
from optics.camera import Sensor
from optics.hdr import ExposureLimits, UnreachableSNR, choose_bracket
from optics.hdr.exposures import FIRST_MARGIN, AllowedTimes, ExposureSNR

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
