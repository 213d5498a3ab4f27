"""Identity, settings and optics of a CS-2000, with its commands other than those that measure.

Source: Konica Minolta, "Spectroradiometer CS-2000/CS-2000A Communication Specifications", rev.
7.00, 2020.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from simulator.machines.colorimetry import tristimulus

Array = NDArray[np.float64]

WAVELENGTHS: Array = np.arange(380, 781).astype(np.float64) * 1e-9
"""Wavelengths at which a CS-2000 measures, in metres."""

# Luminance times integration time, in cd s/m², that fills the sensor at 1 degree. It follows from
# the 5000 cd/m² of the data sheet, with the shortest time and the internal filter.
_SATURATION = 2.5


class CS2000Optics:
    """The light path of a CS-2000 from the spectrum before its lens to its sensor.

    spectrum, slit_nm, angle: as of CS2000Machine.
    """

    def __init__(self, spectrum: Callable[[Array], Array], slit_nm: int, angle: int) -> None:
        self._spectrum, self._slit = spectrum, slit_nm
        self.angle = angle
        self.attached_nd = 0
        """External filter that is really attached: 0 none, 1 passes a tenth, 2 a hundredth."""

    def measured_spectrum(self) -> Array:
        """Return the radiance behind slit and external filter, in W/(sr m² nm)."""
        samples_per_nm = 5
        reach = samples_per_nm * self._slit
        first, last = samples_per_nm * 380 - reach, samples_per_nm * 780 + reach
        nm = np.arange(first, last + 1) / samples_per_nm
        light = np.asarray(self._spectrum(nm * 1e-9), np.float64) * 1e-9
        if reach:
            weights = reach - np.abs(np.arange(-reach, reach + 1.0))
            light = np.convolve(light, weights / weights.sum(), mode="valid")
        return light[::samples_per_nm] * 10.0**-self.attached_nd

    def _signal(self, integration: float, nd: int) -> float:
        """Return the sensor's exposure, in cd s/m² at 1 degree."""
        luminance = float(tristimulus(WAVELENGTHS, self.measured_spectrum() * 1e9)[1])
        # The instrument doesn't report its internal filter's transmittance; a tenth is assumed.
        transmittance = 0.1 if nd else 1.0
        # Areas of the fields of 1, 0.2 and 0.1 degrees, relative to the first.
        relative_area = (1.0, 0.04, 0.01)[self.angle]
        return luminance * integration * transmittance * relative_area

    def is_too_bright(self, integration: float, nd: int) -> bool:
        return self._signal(integration, nd) > 1.001 * _SATURATION

    def required_exposure(self, mode: int, given: int, nd: int) -> tuple[float, int]:
        """Return integration time (s) and internal filter by speed mode."""
        if mode == 3:
            return given * 1e-6, nd
        if nd == 2:
            nd = int(self._signal(0.005, 0) > _SATURATION)
        longest = {0: 120.0, 1: 16.0}.get(mode, float(given))
        bright = self._signal(1.0, nd)
        fitting = 0.8 * _SATURATION / bright if bright > 0 else math.inf
        return float(np.clip(fitting, 0.005, longest)), nd


Command = Callable[[list[int]], str]
"""Handler of a command, from its parameters to its reply."""

# Commands whose settings the instrument stores in its flash memory.
_INTO_FLASH = ("SPMS", "SCMS", "NDFS", "LNSS", "OBSS")


class CS2000Settings:
    """Hold the settings of a CS-2000, and answer the commands that ask or set them.

    remote: mode of RMTS, 0 while the keys work, 1 and 2 while the wire is obeyed.
    flash_write_count: settings written to flash memory, which wears out. has_first_firmware: which
    has fewer functions. speed: mode, integration and filter of SPMS. sync: mode and frequency of
    SCMS.
    """

    def __init__(self, model: str, serial: str, firmware: str, optics: CS2000Optics) -> None:
        if model not in ("CS-2000", "CS-2000A"):
            raise ValueError(f"model is {model!r}; choose CS-2000 or CS-2000A")
        if not re.fullmatch(r"[0-9]{7}", serial):
            raise ValueError(f"serial is {serial!r}; it has seven digits")
        self._model, self._serial, self._optics = model, serial, optics
        self._version = tuple(int(part) for part in firmware.split("."))
        self.has_first_firmware = self._version < (1, 10) and model == "CS-2000"
        self.remote = 0
        self.single_values = {"NDFS": 0, "LNSS": 0, "OBSS": 0, "MSWE": 0}
        """Settings that are one number, by the command that sets them."""
        self.speed: tuple[int, int, int] = (0, 0, 2)
        self.sync: tuple[int, int] = (0, 0)
        self.flash_write_count = 0

    def command_handler(self, name: str) -> Command | None:
        """Return the handler of a command that asks or sets, or else None."""
        answer = self._answer(name)
        if answer is not None:
            return lambda given: "ER00" if given else f"OK00,{answer}"
        if name in self.single_values:
            return functools.partial(self._set_single_value, name)
        return {"RMTS": self._rmts, "SCMS": self._scms, "SPMS": self._spms}.get(name)

    def store(self, name: str) -> None:
        """Count a setting that the instrument has made, if it stores this one in flash memory."""
        self.flash_write_count += name in _INTO_FLASH and self.remote == 1

    def conditions(self, integration: float, nd: int) -> str:
        """Return the measuring conditions, in the text of the reply to MEDR."""
        given = self.single_values
        return (
            f"{self.speed[0]},{self.sync[0]},{round(integration * 1e6):09d},{nd},"
            f"{given['LNSS']},{given['NDFS']},{self._optics.angle},00"
        )

    def _answer(self, name: str) -> str | None:
        """Return the answer to a question, or None if the command is none."""
        match name:
            case "IDDR":
                return f"{self._model:9},{2 if self._model == 'CS-2000A' else 1},{self._serial}"
            case "STSR":
                return str(self._optics.angle)
            case "DTCR":
                return "20240201,235607"
            case "SCMR":
                mode, frequency = self.sync
                return f"{mode},{frequency:05d}" if mode == 1 else str(mode)
            case "SPMR":
                mode, seconds, nd = self.speed
                texts = [str(mode)]
                if mode >= 2:
                    texts.append(f"{seconds:09d}" if mode == 3 else f"{seconds:02d}")
                if mode == 3 or not self.has_first_firmware:
                    texts.append(str(nd))
                return ",".join(texts)
            case "NDFR" | "LNSR" | "OBSR":
                return str(self.single_values[f"{name[:3]}S"])
        return None

    def _set_single_value(self, name: str, given: list[int]) -> str:
        if len(given) != 1:
            return "ER00"
        if given[0] > (2 if name == "NDFS" else 1):
            return "ER17"
        self.single_values[name] = given[0]
        return "OK00"

    def _rmts(self, given: list[int]) -> str:
        if len(given) != 1:
            return "ER00"
        if given[0] > (2 if self._version >= (3, 0, 9301) else 1):
            return "ER17"
        self.remote = given[0]
        return "OK00"

    def _scms(self, given: list[int]) -> str:
        if not given or len(given) != (2 if given[0] == 1 else 1):
            return "ER00" if not given or given[0] <= 2 else "ER17"
        if given[0] > 2 or (given[0] == 1 and not 2000 <= given[1] <= 20000):
            return "ER17"
        self.sync = given[0], given[1] if given[0] == 1 else 0
        return "OK00"

    def _spms(self, given: list[int]) -> str:
        if not given:
            return "ER00"
        mode, rest = given[0], given[1:]
        if mode > (3 if self.has_first_firmware else 4):
            return "ER17"
        timed = mode >= 2
        has_nd = mode == 3 or not self.has_first_firmware
        least = timed + (mode == 3)
        if not least <= len(rest) <= timed + has_nd:
            return "ER00"
        seconds = rest[0] if timed else 0
        nd = rest[timed] if len(rest) > timed else 2
        times = range(5000, 120_000_001) if mode == 3 else range(1, 17)
        if (timed and seconds not in times) or nd > (1 if mode == 3 else 2):
            return "ER17"
        self.speed = mode, seconds, nd
        return "OK00"
