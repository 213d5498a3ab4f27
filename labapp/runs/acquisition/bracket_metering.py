"""Meter the targets of a plan's brackets before the record is made, and settle their exposures."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Frame
from labapp.common.errors import UserError
from labapp.files.bracket_table import MeteredLight
from labapp.files.plan_file import Acquisition, PlanFile
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.frame_taker import FrameTaker
from labapp.runs.acquisition.hooks import HookError, Hooks
from labapp.runs.bench_interface import Bench
from labapp.runs.brackets.choice import bracket_limits, settle_block
from labapp.runs.brackets.clip_remarks import clip_remark
from labapp.runs.capabilities import BenchCapabilities
from labapp.runs.shots import Shot
from labapp.runs.steps import planned_settings
from optics.hdr import ExposureLimits, Meter, MeteredRange, UnreachableSNR, scene_light

log = logging.getLogger(__name__)

_FIRST_EXPOSURE = 1e-3
"""Seconds of the first metering frame. Chosen: long enough for many scenes, and no loss in others.
Later targets begin with the exposure that was right for the last."""

_METERING_STEP = 1_000_000
"""Step from which on metering frames count, so that simulated frames keep their noise."""

_DIGITS = 4
"""Significant digits of the metered rates in a record's plan. Chosen: to 1e-4."""


class BracketMetering:
    """Settles the brackets of a plan, with metering frames where they need any.

    source: the plan's name in errors.
    """

    def __init__(
        self,
        bench: Bench,
        plan: PlanFile,
        patterns: Mapping[str, NDArray[np.uint8]],
        attendance: Attendance,
        source: str,
        hooks: Hooks,
    ) -> None:
        self._bench, self._plan, self._source, self._hooks = bench, plan, source, hooks
        self._abilities = BenchCapabilities.of(bench)
        self._sensor = bench.description.sensor
        self._progress = progress = attendance.progress
        self._steps = _METERING_STEP
        self._first = _FIRST_EXPOSURE
        is_cancelled: Callable[[], bool] = lambda: progress.is_cancelled  # noqa: E731
        self._taker = FrameTaker(
            bench, patterns, plan.seed, plan.retry, attendance.ask, progress, is_cancelled
        )

    def settle(self) -> PlanFile:
        """Return the plan with the exposures of all its brackets.

        Raises UserError, with target and remedy, if a bracket can't reach what is wanted; and
        DeviceError if a device fails. The bench is then left safe.
        """
        settled = []
        try:
            for number, block in enumerate(self._plan.acquire):
                where = f"{self._source}: key 'acquire.{number}.bracket'"
                settled.append(block if block.bracket is None else self._settle(block, where))
        except BaseException:
            self._bench.make_safe()
            raise
        return self._plan.model_copy(update={"acquire": tuple(settled)})

    def _settle(self, block: Acquisition, where: str) -> Acquisition:
        """Return a block with exposures in the place of its bracket."""
        assert block.bracket is not None
        limits = bracket_limits(block, self._plan, self._abilities, where)
        shots = planned_settings(block, self._plan, self._abilities)
        began, metered = self._bench.clock.now(), []
        if block.bracket.electrons_per_s is not None:
            rates = block.bracket.electrons_per_s
        else:
            try:
                self._hooks.call("before_metering", shots)
            except HookError as error:
                raise UserError(f"{error}. Mend the hook, or remove it from the plan.") from error
            metered = [self._meter(shot, block, limits, where) for shot in shots]
            ends = [one.electrons_per_s for one in metered]
            rates = min(low for low, _ in ends), max(high for _, high in ends)
        seconds = self._bench.clock.now() - began
        try:
            sensor = shots[0].readout.read_sensor(self._sensor)
            return settle_block(block, sensor, limits, rates, len(shots), metered, seconds)
        except UnreachableSNR as error:
            raise UserError(f"{where}: {error}.") from error

    def _meter(
        self, shot: Shot, block: Acquisition, limits: ExposureLimits, where: str
    ) -> MeteredLight:
        """Meter the light of one target, pattern and wavelength."""
        assert block.bracket is not None
        sensor = shot.readout.read_sensor(self._sensor)
        meter = Meter(
            sensor,
            limits,
            self._first,
            block.bracket.snr_db,
            block.bracket.decades,
            self._bench.file.tells_clip_level,
        )
        frames: list[Frame] = []
        try:
            while meter.next_time is not None:
                frames.append(self._take(replace(shot, exposure=meter.next_time)))
                meter.add(frames[-1].exposure, frames[-1].image)
            found = meter.metered_range
        except ValueError as error:
            name = f"{shot.target} with {shot.pattern} at {shot.wavelength * 1e9:g} nm"
            raise UserError(f"{where}: metering {name}: {error}.") from error
        self._first = frames[-1].exposure
        remark = clip_remark(found, sensor)
        if remark:
            log.warning("metering %s: %s", shot.target, remark)
        self._sensor = found.sensor_as_seen(self._sensor)
        return self._metered_light(shot, found, frames, remark)

    def _take(self, shot: Shot) -> Frame:
        self._steps += 1
        ms = shot.exposure * 1e3
        self._progress.report(0.0, f"metering {shot.target}, {shot.pattern}, {ms:g} ms")
        # No planned frame has this number, so that faults of planned frames don't strike.
        metering = replace(shot, index=-1, step=self._steps)
        return self._taker.take(metering, lambda *stored: None)

    def _metered_light(
        self, shot: Shot, found: MeteredRange, frames: Sequence[Frame], remark: str
    ) -> MeteredLight:
        """Return what the record tells of a metering."""
        seen = ((frame.exposure, frame.image) for frame in frames)
        light = scene_light(seen, shot.readout.read_sensor(self._sensor))
        rows = tuple(tuple(_round_rate(one) for one in row) for row in light.blocks.tolist())
        return MeteredLight(
            target=shot.target,
            pattern=shot.pattern,
            wavelength_nm=round(shot.wavelength * 1e9, 3),
            exposures_ms=tuple(round(time * 1e3, 6) for time in found.times),
            electrons_per_s=(found.low, found.high),
            noise_limited=found.is_noise_limited,
            clip_level_dn=found.clip_level,
            remark=remark,
            blocks=rows,
            quantiles=tuple(_round_rate(one) for one in light.quantiles.tolist()),
        )


def _round_rate(rate: float) -> float | None:
    """Round a metered rate to few digits; None where there is none."""
    return float(f"{rate:.{_DIGITS}g}") if math.isfinite(rate) else None
