"""Collect what limits the exposures of a run's brackets: camera, flicker, phase videos, darks."""

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
    """Return the limits of the exposures of a run's bracket that is chosen.

    `where` names the block in errors. Raises UserError if no exposure is left.
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
    """Return the limits of a run's bracket by the camera, its own limits, and a period in seconds.

    Raises ValueError if no exposure is left.
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
    """Return what a run's bracket shall reach between two rates, with its interleaved dark frames.

    `settings` are the targets, patterns and wavelengths of the block that share the dark frames.
    """
    assert block.bracket is not None
    darks = dark_count(block)
    if darks is None:
        return WantedSNR(block.bracket.snr_db, low, high)
    every = [one.every for one in block.interleave if one.role == "dark" and one.every]
    shared = settings if not every else 1
    return WantedSNR(block.bracket.snr_db, low, high, darks, darks / shared)


def dark_count(block: Acquisition) -> int | None:
    """Return the dark frames that a run takes at each exposure of a block; None without any."""
    counts = [one.frames for one in block.interleave if one.role == "dark"]
    return sum(counts) or None


def _period(block: Acquisition, plan: PlanFile, capabilities: BenchCapabilities) -> float | None:
    """Return the time of which a run's exposures are multiples; None if any will do."""
    if block.any_exposure:
        return None
    videos = plan.videos(block).values()
    frames = lcm(*(video.length for video in videos)) if videos else 0
    periods = [frames * capabilities.video_frame] if frames else []
    if capabilities.flicker_period is not None and math.isfinite(capabilities.flicker_period):
        periods.append(capabilities.flicker_period)
    return common_period(periods) if periods else None
