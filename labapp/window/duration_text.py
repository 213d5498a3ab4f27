"""Durations as short texts."""

from __future__ import annotations

from labapp.common.stopwatch import format_short_time


def format_duration(seconds: float) -> str:
    """Format a duration in seconds as a short text."""
    if seconds < 1:
        return "under 1 s"
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def format_processor_time(seconds: float | None) -> str:
    """Format a short time with two digits: 0.12 ms, 3.4 ms, 1.2 s, 3 min."""
    if seconds is None:
        return "–"
    if seconds >= 120:
        return f"{seconds / 60:.0f} min"
    return format_short_time(seconds)
