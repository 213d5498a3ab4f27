"""What the headings of text tables say of their columns: quantity, unit and wavelength."""

from __future__ import annotations

import math
import re

from labapp.common.plain_text import quote
from labapp.common.typed_numbers import parse_number

_BRACKETS = re.compile(r"[(\[{]([^)\]}]*)[)\]}]")
_AFTER_SLASH = re.compile(r"/\s*(\S+)\s*$")
_LEVELS = {
    "grey",
    "gray",
    "level",
    "greylevel",
    "graylevel",
    "greyvalue",
    "grayvalue",
    "index",
    "dn",
    "gl",
}
_VOLTAGE = re.compile(r"volt|spannung|tension|\bm?v\b|\bdac\b|\bdrive\b", re.IGNORECASE)
_NANOMETRES = re.compile(r"([0-9.,]+)\s*nm\b", re.IGNORECASE)
_PHASE_UNITS = {
    r"pi\b(?:\s*\*?\s*rad)?|π(?:\s*\*?\s*rad)?": 1.0,
    r"rad(?:ians?)?\b": 1 / math.pi,
    r"deg(?:rees?)?\b|°": 1 / 180,
    r"waves?\b|λ|lambda\b": 2.0,
}
"""Units of a phase, as they are written, and how many pi each is."""

_PHASE_WORDS = re.compile(
    r"phase|shift|modulation|delay|phi|φ|\bat\b|\bin\b|\bof\b|\bunits?\b|[@()\[\]{}/,:_\s]",
    re.IGNORECASE,
)
_LOGARITHMS = re.compile(r"\b(od|optical density|db|absorbance)\b", re.IGNORECASE)


def is_level(heading: str) -> bool:
    """Return whether a heading names the panel's grey levels."""
    word = re.sub(r"[\s_\-]", "", _BRACKETS.sub("", heading).lower())
    return word.removesuffix("s") in _LEVELS


def is_voltage(heading: str) -> bool:
    """Return whether a heading names voltages, or what drives the panel."""
    return _VOLTAGE.search(heading.replace("_", " ")) is not None


def read_phase_heading(heading: str) -> tuple[float, float]:
    """Return the wavelength in nm of a column of phases, and their unit in pi.

    A wavelength alone heads phases in units of pi. Raises ValueError with the reason for a heading
    that leaves one of both open.
    """
    found = _NANOMETRES.search(heading)
    rest = heading if found is None else heading.replace(found[0], " ")
    if found is None:
        try:
            return parse_number(heading), 1.0
        except ValueError:
            raise ValueError(f"{quote(heading)} names no wavelength in nm") from None
    units = []
    for written, factor in _PHASE_UNITS.items():
        shorter = re.sub(rf"(?<![a-z])(?:{written})", " ", rest, flags=re.IGNORECASE)
        units += [factor] if shorter != rest else []
        rest = shorter
    left = _PHASE_WORDS.sub("", rest)
    if left or len(units) > 1:
        raise ValueError(f"{quote(heading)} isn't understood")
    if not units and "ph" in heading.lower():
        raise ValueError(f"{quote(heading)} names no unit of the phase: pi, rad, ° or waves")
    return parse_number(found[1]), units[0] if units else 1.0


def unit_in_heading(heading: str) -> str:
    """Return the unit that a heading names in brackets or after / ; "" if none."""
    found = _BRACKETS.search(heading) or _AFTER_SLASH.search(heading)
    return found[1].strip() if found else ""


def share_unit(heading: str) -> float:
    """Return the unit of a column of shares: 0.01 for per cent, else 1.

    Raises ValueError for logarithms.
    """
    if _LOGARITHMS.search(heading.replace("_", " ")):
        raise ValueError(f"{quote(heading)} is a logarithm. Give shares, 0 to 1, or per cent")
    return 0.01 if "%" in heading or "percent" in heading.lower() else 1.0
