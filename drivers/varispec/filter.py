"""A VariSpec as a spectral filter."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Self, TypeVar

from drivers.errors import DeviceError
from drivers.interfaces import Identity, Setting, Surroundings
from drivers.serial_line import SerialLine
from drivers.varispec.opening import Opening
from drivers.varispec.options import Options
from drivers.varispec.palette import Palette
from drivers.varispec.protocol import WAVELENGTH, Version
from drivers.varispec.settling import COLDEST, WARMEST, slowdown
from drivers.varispec.talk import Refusal, Talk

log = logging.getLogger(__name__)

T = TypeVar("T")

_DRIFT = 3.0
"""Degrees Celsius by which the optics may change until it should be initialised again."""

_STALE = 8 * 3600.0
"""Seconds after which it should be initialised again."""


class VariSpec:
    """A VariSpec tunable filter on a serial port (its USB units are such ports, too).

    port: "/dev/ttyUSB0", "COM3" or a URL of pyserial. baudrate: 9600, 19200 or 115200.
    settling_ms: response time as specified for the model, 50 for VIS and 150 for NIR; longer
    by itself where the optics are colder than 20 degrees Celsius. bandwidth_nm: full width at
    half maximum, which the filter can't tell. recalibrate: what is done on opening beyond what
    must be: "if needed" nothing, "correct" for the temperature, "always" initialise (30 s).
    exercise: whether the liquid crystals are exercised (12 s) where they weren't. palette_nm:
    wavelengths that are calculated on opening, for quick tuning of units with RS-232. serial:
    that the filter must have, and by which it is awakened. terminator: "\\r", or "\\n" for
    units with RS-232 that are set so.

    Opening takes up to a minute where the filter must be initialised; `progress`, where it is
    set before, is told what is done and the share that is done. Never is it initialised by
    itself while it is open: frames before and after could not be compared. Source: VariSpec
    user manual 1.37.
    """

    reply_time = 3.0

    def __init__(
        self,
        surroundings: Surroundings,
        port: str = "/dev/ttyUSB0",
        baudrate: int = 9600,
        settling_ms: float = 50.0,
        bandwidth_nm: float = 10.0,
        recalibrate: str = "if needed",
        exercise: bool = False,
        palette_nm: Sequence[float] = (),
        serial: str = "",
        terminator: str = "\r",
    ) -> None:
        self._options = Options(
            port, baudrate, settling_ms, bandwidth_nm, recalibrate, exercise,
            tuple(palette_nm), serial, terminator,
        )  # fmt: skip
        self._clock = surroundings.clock
        self._line = SerialLine("VariSpec", port, self._clock, baudrate=baudrate)
        self._talk = Talk(self._line, terminator)
        self._opening = Opening(self._talk, self._options, self._report)
        self._palette = Palette(self._talk)
        self._version: Version | None = None
        self._temperature = COLDEST
        self._nm = 0.0
        self.progress: Callable[[str, float], None] | None = None
        self.alive_at = 0.0

    def __enter__(self) -> Self:
        try:
            self._version = self._opening.begin()
            self._temperature = self._opening.temperature
            self._palette.forget()
            if self._options.palette_nm:
                self.define_palette([nm * 1e-9 for nm in self._options.palette_nm])
            self._nm = self._do("read the wavelength", self._read_wavelength)
        except BaseException:
            self._line.close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        try:
            if self._version:
                self.make_safe()
        except DeviceError as failure:
            log.warning("left as it is: %s", failure)
        finally:
            self._line.close()

    def kill(self) -> None:
        """End the call that goes on, from any thread; the filter can't be used any more."""
        self._line.cancel()

    @property
    def identity(self) -> Identity:
        return Identity("VariSpec", self._told.serial, simulated=False)

    @property
    def settling(self) -> float:
        return self._options.settling_ms * 1e-3 * slowdown(self._temperature)

    @property
    def wavelength_range(self) -> tuple[float, float]:
        return _metres(self._told.shortest), _metres(self._told.longest)

    @property
    def bandwidth(self) -> float:
        return self._options.bandwidth_nm * 1e-9

    @property
    def wavelength(self) -> float:
        """What the filter says it is tuned to, in metres."""
        return _metres(self._do("read the wavelength", self._read_wavelength))

    @property
    def temperature(self) -> float:
        """Of the liquid crystals, in degrees Celsius."""
        return self._do("read the temperature", self._read_temperature)

    @property
    def palette(self) -> tuple[float, ...]:
        """The wavelengths that the filter has calculated, in metres."""
        told = self._read_palette("read the palette")
        return tuple(map(_metres, told))

    def set_wavelength(self, wavelength: float) -> Setting[float]:
        """Tune; wavelengths in metres, which the filter takes to 0.01 nm."""
        nm = round(wavelength * 1e9, 2)
        command = f"tune to {nm:.2f} nm"
        self._require_in_range(nm, command)

        def tune() -> Setting[float]:
            element = self._palette.find(nm)
            text = f"W {nm:.2f}" if element is None else f"P {element}"
            self._talk.set(text, command)
            return self._confirmed(wavelength, nm, command)

        return self._do(command, tune)

    def define_palette(self, wavelengths: Sequence[float]) -> tuple[float, ...]:
        """Have the filter calculate wavelengths (metres) in advance; what it then holds.

        set_wavelength() uses those. Takes up to half a second a wavelength.
        """
        given = [round(wavelength * 1e9, 2) for wavelength in wavelengths]
        for nm in given:
            self._require_in_range(nm, f"palette with {nm:.2f} nm")
        self._do("clear the palette", self._palette.clear)
        for element, nm in enumerate(given):
            self._report("defining the palette", element / len(given))
            self._do(f"palette with {nm:.2f} nm", partial(self._palette.define, element, nm))
        held = self.palette
        if held != tuple(map(_metres, given)):
            self._palette.forget()
            raise self._line.error("define the palette", f"it holds {held}", "Define it again")
        return held

    def clear_palette(self) -> None:
        self._do("clear the palette", self._palette.clear)

    def choose(self, element: int) -> Setting[float]:
        """Tune to an element of the palette, counted from 0."""
        command = f"tune to element {element} of the palette"
        held = self._read_palette(command)
        if not 0 <= element < len(held):
            raise Refusal(
                "VariSpec", command, f"the palette has {len(held)}", "Define the palette first"
            )

        def tune() -> Setting[float]:
            self._talk.set(f"P {element}", command)
            return self._confirmed(_metres(held[element]), held[element], command)

        return self._do(command, tune)

    def refresh(self, *, completely: bool = True) -> None:
        """Initialise again (30 s), or only correct for the temperature (no time to speak of).

        Not between pictures that are to be compared.
        """
        self._do("come to rest", lambda: None)
        self._opening.initialise(completely)
        self._temperature = self._opening.temperature
        self.set_wavelength(_metres(self._nm or self._told.shortest))

    def exercise(self, cycles: int = 3) -> None:
        """Exercise the liquid crystals, 12 s a cycle; 3 are enough, says the manual."""
        if cycles not in range(1, 256):
            raise ValueError(f"cycles is {cycles!r}; it must be from 1 to 255")
        self._do("come to rest", lambda: None)
        self._opening.exercise(cycles)

    def sleep(self) -> None:
        """The filter then answers nothing until it is awakened."""
        self._do("sleep", lambda: self._talk.sleep(self._told.serial))

    def awaken(self) -> None:
        self._line.in_step = False
        self._do("awaken", lambda: None)

    def health(self) -> dict[str, str]:
        """What the filter tells about itself, and what should be done about it."""
        status = self._do("read the status", lambda: self._talk.status("read the status"))
        temperature, told = self.temperature, self._told
        age = self._clock.now() - self._opening.since
        return {
            "firmware": told.firmware,
            "serial number": told.serial,
            "range": f"{told.shortest:.2f} to {told.longest:.2f} nm",
            "status": status.words,
            "temperature": f"{temperature:.1f} °C",
            "settling": f"{self.settling * 1e3:.0f} ms",
            "initialised": f"{self._opening.how} {age / 3600:.1f} h ago, "
            f"at {self._opening.temperature:.1f} °C",
            "failed answers": str(self._talk.failures),
            "advice": self._advice(status.initialised, temperature, age),
        }

    def make_safe(self) -> None:
        self.set_wavelength(self.wavelength_range[0])

    @property
    def _told(self) -> Version:
        if self._version is None:
            raise DeviceError("VariSpec", "identity", "it is not open", "Open it first")
        return self._version

    def _advice(self, initialised: bool, temperature: float, age: float) -> str:
        advice = []
        change = abs(temperature - self._opening.temperature)
        if not initialised or age > _STALE or change > _DRIFT:
            advice.append(
                f"initialise it: refresh(). It is {change:.1f} °C and {age / 3600:.1f} h on"
            )
        if not COLDEST <= temperature <= WARMEST:
            advice.append(f"it works from {COLDEST:g} to {WARMEST:g} °C")
        return "; ".join(advice) or "none"

    def _require_in_range(self, nm: float, command: str) -> None:
        low, high = self._told.shortest, self._told.longest
        if not low <= nm <= high:
            raise Refusal(
                "VariSpec",
                command,
                f"out of range, {low:.2f} to {high:.2f} nm",
                "Choose a wavelength in the range",
            )

    def _do(self, command: str, work: Callable[[], T], seconds: float = reply_time) -> T:
        """Do something in step; once or twice again, if the line is noisy and time is left."""
        told = self._told

        def rest() -> None:
            if not self._opening.come_to_rest(command, told).palette:
                self._palette.forget()

        with self._line.within(seconds - 0.1):
            return self._talk.persist(rest, work)

    def _report(self, what: str, share: float) -> None:
        self.alive_at = time.monotonic()
        if self.progress is not None:
            self.progress(what, share)

    def _confirmed(self, asked: float, nm: float, command: str) -> Setting[float]:
        """The setting, if the filter says that it is tuned to that."""
        actual = self._ask_wavelength(command)
        if abs(actual - nm) > 0.006:
            raise self._line.error(command, f"it is tuned to {actual:.2f} nm instead")
        self._nm = nm
        return Setting(asked, _metres(nm), self._clock.now() + self.settling)

    def _read_wavelength(self) -> float:
        command = "read the wavelength"
        told = self._ask_wavelength(command)
        if told == self._nm:
            return told
        return self._talk.agreed(lambda: self._ask_wavelength(command), command)

    def _ask_wavelength(self, command: str) -> float:
        answer = self._talk.ask("W ?", WAVELENGTH, command)
        if answer[1] is None:
            # The star may be noise; a status that agrees with it thrice is not.
            if not self._talk.status(command).initialised:
                raise Refusal("VariSpec", command, "it is not tuned", "Initialise it: refresh()")
            raise self._line.error(command, "it is not tuned: W*", "Tune it again")
        return float(answer[1])

    def _read_palette(self, command: str) -> tuple[float, ...]:
        """Over RS-232 a full palette takes longer than anything else."""
        self.alive_at = time.monotonic()
        return self._do(command, self._palette.read, self.reply_time + 5.0)

    def _read_temperature(self) -> float:
        self._temperature = self._opening.read_temperature("read the temperature")
        return self._temperature


def _metres(nm: float) -> float:
    """Exactly what round(nm * 100) / 1e11 is, so that equal wavelengths are equal in files."""
    return round(nm * 100) / 1e11
