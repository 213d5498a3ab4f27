"""Durations as short texts for the window."""

from __future__ import annotations


def format_duration(seconds: float) -> str:
    """Format a duration as a short text for the window."""
    if seconds < 1:
        return "under 1 s"
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
