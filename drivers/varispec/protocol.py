"""Commands, answers and errors of a VariSpec (user manual 1.37, "Controlling VariSpec Filters").

Wavelengths are in nanometres, as on the wire, with a resolution of 0.01 nm.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

ESCAPE, BUSY, STATUS = b"\x1b", b"!", b"@"

PALETTE_SIZE = 128
"""Largest number of elements of the palette, by the manual."""

ERRORS = {
    1: "syntax error",
    2: "it can only be read",
    3: "illegal number of exercises",
    4: "it is not initialised",
    5: "illegal argument of the initialisation",
    6: "error of the control mode",
    7: "illegal control mode",
    8: "it could not calculate its drive levels",
    9: "no palette is defined",
    10: "its palette is not prepared",
    11: "no such element of the palette",
    12: "wavelength out of range",
    13: "a drive level is out of range",
    14: "the wavelength step is too large",
    17: "illegal number of sync pulses",
}

REMEDIES = {
    4: "Initialise it: refresh(), or open it again",
    8: "Switch it off and on; if it comes again, the filter wants service",
    10: "Define the palette again",
    13: "Use the short cable between optics and electronics; switch it off and on",
}

_NUMBER = r"(\d{1,4}\.\d{1,3})"

VERSION_REPLY = re.compile(rf"[vV] *([\d.]{{1,8}}) +{_NUMBER} +{_NUMBER} +(\d{{1,5}})")
WAVELENGTH_REPLY = re.compile(rf"[wW] *(?:{_NUMBER}|(\*))")
TEMPERATURE_REPLY = re.compile(r"[yY] *(-?\d{1,3}(?:\.\d{1,3})?)")
ELEMENT_REPLY = re.compile(r"[dD] *(\d{1,4}(?:\.\d{1,3})?)")


def integer_reply_pattern(letter: str) -> re.Pattern[str]:
    """Return the pattern of an answer to a query for a whole number."""
    return re.compile(rf"[{letter.lower()}{letter.upper()}] *(\d{{1,5}})")


@dataclass(frozen=True)
class Version:
    """A filter's identity. shortest, longest: its wavelength range in nanometres."""

    firmware: str
    shortest: float
    longest: float
    serial: str


@dataclass(frozen=True)
class Status:
    """Bits of the status byte, the answer to "@"."""

    initialised: bool
    exercised: bool
    palette: bool
    brief: bool
    error: bool

    @property
    def description(self) -> str:
        told = {
            "initialised": self.initialised,
            "exercised": self.exercised,
            "palette defined": self.palette,
            "brief replies": self.brief,
            "error pending": self.error,
        }
        return ", ".join(word for word, so in told.items() if so) or "not initialised"


def parse_status(byte: int) -> Status | None:
    """Decode the status byte; None unless bits 7 and 4 are 0 and bit 6 is 1."""
    if byte & 0b11010000 != 0b01000000:
        return None
    return Status(*(bool(byte >> place & 1) for place in (0, 1, 2, 3, 5)))


def explain_error(code: int) -> tuple[str, str]:
    """Return what an error code means, and what to do about it."""
    words = ERRORS.get(code, "an error that the manual doesn't know")
    remedy = REMEDIES.get(code, "Try again; if it comes again, switch the filter off and on")
    return f"error {code}: {words}", remedy
