"""Collect what limits the exposures of brackets: camera, flicker, phase videos, darks."""

from __future__ import annotations

import math
from math import lcm

from labapp.common.errors import UserError
from labapp.files.bracket_table import BracketTable
from labapp.files.plan_file import Acquisition, PlanFile
from labapp.runs.capabilities import BenchCapabilities
from optics.hdr import ExposureLimits, WantedSNR, common_period


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
