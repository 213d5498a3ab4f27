"""A Konica Minolta CS-2000 or CS-2000A spectroradiometer behind its serial port.

Source: Konica Minolta, "Spectroradiometer CS-2000/CS-2000A Communication Specifications", rev.
7.00, 2020; the optical limits are those of the instrument's data sheet.
"""

from __future__ import annotations

import functools
import math
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.machines.colorimetry import (
    chromaticity,
    colour_temperature,
    dominant_wavelength,
    tristimulus,
    uniform_chromaticity,
)
from simulator.machines.cs2000_settings import WAVELENGTHS, Array, CS2000Optics, CS2000Settings
from simulator.machines.machine import FaultyMachine, Reply

_FAILED_VALUE = "D1BA43B6"  # hexadecimal reply for a value that can't be computed

_NAMES_2_DEGREES = ("X", "Y", "Z", "x", "y", "u'", "v'", "T", "duv", "ld", "Pe")
_NAMES_10_DEGREES = (
    "X10", "Y10", "Z10", "x10", "y10", "u10'", "v10'", "T10", "duv10", "ld10", "Pe10"
)  # fmt: skip

BLOCKS: dict[int, tuple[str, ...]] = {
    0: ("Le", "Lv", *_NAMES_2_DEGREES, *_NAMES_10_DEGREES),
    1: ("X", "Y", "Z"),
    2: ("x", "y", "Lv"),
    3: ("u'", "v'", "Lv"),
    4: ("T", "duv", "Lv"),
    5: ("ld", "Pe", "Lv"),
    11: ("X10", "Y10", "Z10"),
    12: ("x10", "y10", "Lv"),
    13: ("u10'", "v10'", "Lv"),
    14: ("T10", "duv10", "Lv"),
    15: ("ld10", "Pe10", "Lv"),
    100: ("Le",),
    101: ("Lv",),
}
"""Names of the colorimetric values in each block of data."""


def colorimetric_values(
    wavelengths_m: NDArray[np.float64], per_nm: NDArray[np.float64]
) -> dict[str, float]:
    """Return a spectrum's colorimetric values by name; NaN where one can't be computed.

    per_nm: radiance in W/(sr m² nm).
    """
    step = float(wavelengths_m[1] - wavelengths_m[0])
    values = {"Le": float(per_nm.sum()) * step * 1e9}
    for observer, names in ((2, _NAMES_2_DEGREES), (10, _NAMES_10_DEGREES)):
        xyz = tristimulus(wavelengths_m, per_nm * 1e9, observer)
        given = wavelengths_m, xyz, observer
        numbers = (
            *xyz, *chromaticity(xyz), *uniform_chromaticity(xyz),
            *colour_temperature(*given), *dominant_wavelength(*given),
        )  # fmt: skip
        values |= dict(zip(names, map(float, numbers), strict=True))
    values["Lv"] = values["Y"]
    return values


def format_value(name: str, value: float, hexadecimal: bool, failed_is_zero: bool = False) -> str:
    """Format a value, colorimetric by its name or "spectral", as the instrument's replies do.

    failed_is_zero: whether a value that can't be computed is sent as 0, as old firmware does.
    """
    if math.isnan(value) and failed_is_zero:
        value = 0.0
    if hexadecimal:
        return _FAILED_VALUE if math.isnan(value) else struct.pack(">f", value).hex().upper()
    kind = name.removesuffix("'").removesuffix("10")
    if kind in ("x", "y", "u", "v"):
        return "-9.999" if math.isnan(value) else f"{value:.4f}"
    if kind == "T":
        return "-9999" if math.isnan(value) else f"{min(value, 99999):.0f}"
    if kind == "duv":
        return "-9.9999" if math.isnan(value) else f"{value:+.4f}"
    if kind in ("Lv", "ld", "Pe"):
        return "-9.9e9" if math.isnan(value) else _format_six_characters(value)
    return "-9.9999e9" if math.isnan(value) else _format_exponential(value)


def _format_exponential(value: float) -> str:
    """Format a number with four decimals and a one-digit exponent."""
    exponent = math.floor(math.log10(abs(value))) if value else -9
    exponent = max(-9, min(9, exponent))
    mantissa = f"{value / 10.0**exponent:.4f}"
    if mantissa.lstrip("-").startswith("10") and exponent < 9:
        exponent += 1
        mantissa = f"{value / 10.0**exponent:.4f}"
    return f"{mantissa}e{exponent:+d}"


def _format_six_characters(value: float) -> str:
    """Format a number in six characters, with as many decimals as fit."""
    if value > 999_999.5:
        mantissa, _, exponent = f"{value:.2e}".partition("e")
        return f"{mantissa}e+{int(exponent)}"
    whole = len(f"{value:.0f}")
    return f"{value:6.{max(0, min(4, 5 - whole))}f}"


# Indices of the wavelengths in each block of a spectrum.
_SPANS = {1: slice(0, 100), 2: slice(100, 200), 3: slice(200, 300), 4: slice(300, 401)}


@dataclass
class _Measurement:
    """A running measurement: the end of its present phase, and the exposure it has chosen."""

    until: float
    integration: float = 0.0
    nd: int = 0
    in_main_phase: bool = False
    by_key: bool = False


@dataclass
class _PendingReply:
    at: float
    text: str
    delimiter: bytes


class CS2000Machine(FaultyMachine):
    """Simulate a CS-2000 spectroradiometer: its commands and the light that it measures.

    spectrum: returns the radiance in W/(sr m² m) at wavelengths in metres, for every measurement.
    firmware: decides which commands the instrument knows. angle: position of its dial, 0 for 1
    degree, 1 for 0.2, 2 for 0.1. slit_nm: full width at half maximum of its triangular slit, 0 for
    none; the data sheet has 5 nm at most.
    """

    own_faults: tuple[str, ...] = ("busy forever", "stuck", "error code")

    def __init__(
        self,
        spectrum: Callable[[Array], Array],
        model: str = "CS-2000A",
        serial: str = "1000123",
        firmware: str = "3.00.9301",
        angle: int = 0,
        slit_nm: int = 5,
    ) -> None:
        super().__init__()
        self.optics = CS2000Optics(spectrum, slit_nm, angle)
        self.settings = CS2000Settings(model, serial, firmware, self.optics)
        self._buffer, self._last_byte_at = bytearray(), -math.inf
        self._after_cr, self._delimiter = False, b"\r"
        self._answers: list[_PendingReply] = []
        self._measuring: _Measurement | None = None
        self.measured_radiance: Array | None = None
        """Last measured radiance in W/(sr m² nm) at WAVELENGTHS; None if there is none."""
        self.conditions = ""
        """Conditions of the last measurement, in the text of the command MEDR."""
        self._unread: set[int] = set()

    @property
    def is_measuring(self) -> bool:
        return self._measuring is not None

    def press_escape(self) -> None:
        """Press the escape key: abort a measurement, else end remote mode."""
        if self._measuring:
            self._measuring = None
        else:
            self.settings.remote = 0

    def press_measure(self, t: float) -> list[Reply]:
        """Press the measuring key, which works if MSWE has enabled it; nothing is sent."""
        if not (self.settings.remote and self.settings.single_values["MSWE"]) or self._measuring:
            return []
        return self._start(t, by_key=True)

    def feed(self, data: bytes, t: float) -> list[Reply]:
        replies = self._advance(t)
        for byte in data:
            # After 60 s of silence an unfinished command is dropped.
            if self._buffer and t - self._last_byte_at > 60.0:
                self._buffer.clear()
                if self.settings.has_first_firmware:
                    replies += self._queue_reply("ER00", t)
            self._last_byte_at = t
            replies += self._receive_byte(byte, t)
        return replies

    def _receive_byte(self, byte: int, t: float) -> list[Reply]:
        after_cr, self._after_cr = self._after_cr, byte == 0x0D
        if byte == 0x0A and after_cr:
            # The reply ends with the delimiter of the command, and it hasn't been sent yet.
            self._delimiter = b"\r\n"
            if self._answers:
                self._answers[-1].delimiter = self._delimiter
            return []
        if byte not in (0x0D, 0x0A):
            self._buffer.append(byte)
            return []
        self._delimiter = bytes([byte])
        command, self._buffer = bytes(self._buffer), bytearray()
        return self._execute(command.decode("latin-1"), t)

    def _queue_reply(self, text: str, t: float) -> list[Reply]:
        # A reply leaves 20 ms after its command.
        at = t + 0.02
        self._answers.append(_PendingReply(at, text, self._delimiter))
        return [Reply(at, b"")]

    def _advance(self, t: float) -> list[Reply]:
        """Finish what is to be done by time t, and return the replies."""
        replies: list[Reply] = []
        while (going := self._measuring) and going.until <= t:
            if going.in_main_phase and "busy forever" in self._faults:
                break
            finish = self._finish_measurement if going.in_main_phase else self._begin_main_phase
            replies += finish(going)
        while self._answers and self._answers[0].at <= t:
            answer = self._answers.pop(0)
            replies.append(Reply(t, answer.text.encode() + answer.delimiter))
        return replies

    def _execute(self, command: str, t: float) -> list[Reply]:
        if self._measuring and not self._measuring.in_main_phase:
            # The instrument ignores commands during the pre-measurement, which finds the exposure.
            return []
        text = self._answer(command, t)
        if text is not None:
            return self._queue_reply(text, t)
        return [Reply(self._measuring.until, b"")] if self._measuring else []

    def _answer(self, command: str, t: float) -> str | None:
        """Carry out a command, and return its reply; None if a measurement has begun."""
        name, *parameters = command.split(",")
        if "error code" in self._faults:
            return "ER99"
        if name != "RMTS" and not self.settings.remote:
            return "ER00"
        if self._measuring and name != "MEAS":
            return "ER02" if name == "MEDR" else "ER00"
        work: Callable[[list[int]], str | None] | None = self.settings.command_handler(name)
        if name == "MEDR":
            work = self._medr
        if name == "MEAS":
            work = functools.partial(self._meas, t)
        if work is None:
            return "ER00"
        if any(not re.fullmatch(r"[0-9]{1,9}", p) for p in parameters):
            return "ER17"
        answer = work([int(p) for p in parameters])
        if answer == "OK00":
            self.settings.store(name)
        return answer

    def _meas(self, t: float, given: list[int]) -> str | None:
        """Answer the command MEAS: begin a measurement, or abort it."""
        if len(given) != 1:
            return "ER00"
        if given[0] > 1 or bool(given[0]) == (self._measuring is not None):
            return "ER17"
        if given[0]:
            self._start(t)
            return None
        self._measuring = None
        return "OK00"

    def _start(self, t: float, by_key: bool = False) -> list[Reply]:
        """Begin a measurement, and return its wake-up call."""
        self.measured_radiance = None
        until = t + min(10.0, max(1.0, self.optics.required_exposure(*self.settings.speed)[0] / 10))
        self._measuring = _Measurement(until, by_key=by_key)
        return [Reply(until, b"")]

    def _begin_main_phase(self, going: _Measurement) -> list[Reply]:
        """End the pre-measurement, and report how long the main one takes."""
        self._measuring = None
        if "stuck" in self._faults:
            return self._report_measurement("ER81", going)
        integration, nd = self.optics.required_exposure(*self.settings.speed)
        if self.optics.is_too_bright(integration, nd):
            return self._report_measurement("ER10", going)
        seconds = min(242, math.ceil(2 * integration + 2 - 1e-6))
        until = going.until + seconds
        self._measuring = _Measurement(until, integration, nd, True, going.by_key)
        return [*self._report_measurement(f"OK00,{seconds:03d}", going), Reply(until, b"")]

    def _finish_measurement(self, going: _Measurement) -> list[Reply]:
        self._measuring = None
        # The instrument corrects for the external filter that it was set to, even if none is there.
        correction = 10.0 ** self.settings.single_values["NDFS"]
        self.measured_radiance = self.optics.measured_spectrum() * correction
        self._unread = set(_SPANS)
        self.conditions = self.settings.conditions(going.integration, going.nd)
        return self._report_measurement("OK00", going)

    def _report_measurement(self, text: str, of: _Measurement) -> list[Reply]:
        """Report progress, unless the measuring key started the measurement."""
        return [] if of.by_key else [Reply(of.until, text.encode() + self._delimiter)]

    def _medr(self, given: list[int]) -> str:
        """Answer the command MEDR: read out a measurement."""
        if len(given) != 3:
            return "ER00"
        mode, form, number = given
        known: dict[int, set[int]] = {0: {1}, 1: set(_SPANS), 2: set(BLOCKS)}
        if mode > 2 or form > 1 or number not in known[mode]:
            return "ER17"
        if self.measured_radiance is None:
            return "ER20"
        if mode == 0:
            return f"OK00,{self.conditions}"
        if mode == 1:
            self._unread -= {number}
            values = [("spectral", float(one)) for one in self.measured_radiance[_SPANS[number]]]
        else:
            known_values = colorimetric_values(WAVELENGTHS, self.measured_radiance)
            values = [(name, known_values[name]) for name in BLOCKS[number]]
        if self.settings.single_values["MSWE"] and (mode == 2 or not self._unread):
            # The measuring key is on: a measurement is discarded once it is read out.
            self.measured_radiance = None
        how = form == 1, self.settings.has_first_firmware
        return ",".join(["OK00", *(format_value(name, value, *how) for name, value in values)])
