"""Short times in words."""

from __future__ import annotations


def format_short_time(seconds: float) -> str:
    """Format a short time with two digits: 0.12 ms, 3.4 ms, 1.2 s."""
    value, unit = (1e3 * seconds, "ms") if seconds < 0.9995 else (seconds, "s")
    return f"{value:.0f} {unit}" if value >= 99.5 else f"{value:.2g} {unit}"
