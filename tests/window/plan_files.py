"""Plan files that a person might run from the window."""

from __future__ import annotations

from pathlib import Path

_PLAN = """
version = 1
title = "{title}"
{top}
[patterns.neutral]
kind = "constant"

[[acquire]]
targets = {targets}
patterns = ["neutral"]
wavelengths_nm = {wavelengths}
exposures_ms = {exposures}
repeats = {repeats}
"""

ASKS = """
[targets.near]
place = "star"
prompt = "Place the star at 1.5 m, then press Enter."
[targets.far]
place = "star"
prompt = "Place the star at 3 m, then press Enter."
"""
"""Two targets that a person places. The run waits, however quick the machine is."""

LONG = 2000
"""Repeats of a plan that isn't over before somebody has looked at it: some 4 seconds and more."""


def write_plan(
    folder: Path,
    title: str,
    *,
    top: str = "",
    targets: str = '["dark"]',
    wavelengths: str = "[550]",
    exposures: str = "[1, 8]",
    repeats: int = 1,
) -> Path:
    """A plan of a frame each target, wavelength, exposure and repeat. top: its first tables."""
    path = folder / f"{title}.toml"
    path.write_text(
        _PLAN.format(
            title=title,
            top=top,
            targets=targets,
            wavelengths=wavelengths,
            exposures=exposures,
            repeats=repeats,
        )
    )
    return path
