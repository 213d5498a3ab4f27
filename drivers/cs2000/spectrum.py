"""Read a measured spectrum until two readings agree, and check it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drivers.cs2000.command_client import CS2000Client

_FAILED_VALUE = "D1BA43B6"
"""What the instrument sends for a value that it couldn't compute."""


def read_spectrum(link: CS2000Client, command: str) -> NDArray[np.float64]:
    """Read 401 radiances in W/(sr m² nm) until two readings agree."""
    before = _read_all_blocks(link, command)
    for _ in range(2):
        texts = _read_all_blocks(link, command)
        if texts == before:
            break
        before = texts
    else:
        raise link.line.error(command, "it tells the spectrum now so, now otherwise")
    values = np.array(parse_hex_floats(link, texts, command))
    # No light that the instrument can measure, even with its filters, exceeds 1e7 W/(sr m² nm).
    if values.max() > 1e7 or values.min() < -max(1e-4, 0.01 * values.max()):
        raise link.line.error(
            command,
            f"the radiance is from {values.min():.3g} to {values.max():.3g} W/(sr m² nm)",
            "Measure again",
        )
    return values


def _read_all_blocks(link: CS2000Client, command: str) -> list[str]:
    texts: list[str] = []
    # The last of the four blocks has another length, so that an answer for a wrong block shows.
    for number, count in enumerate((100, 100, 100, 101), start=1):
        block = link.ask(f"MEDR,1,1,{number}", command, is_long=True).split(",")
        if len(block) != count or any(len(text) != 8 for text in block):
            raise link.line.error(command, f"block {number} has {len(block)} values")
        texts += block
    return texts


def parse_hex_floats(link: CS2000Client, texts: list[str], command: str) -> list[float]:
    """Decode hexadecimal digits as floats; DeviceError if one isn't a number."""
    if _FAILED_VALUE in texts:
        raise link.line.error(
            command, "it couldn't compute a value", "Measure again; check the light"
        )
    try:
        found = np.frombuffer(bytes.fromhex("".join(texts)), ">f4").astype(np.float64)
    except ValueError:
        found = np.array([math.nan])
    if len(found) != len(texts) or not np.isfinite(found).all():
        raise link.line.error(command, "it tells what is no number", "Measure again")
    return [float(number) for number in found]
