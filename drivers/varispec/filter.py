"""The filter that a bench opens: a liquid-crystal tunable one."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Self, TypeVar

from drivers.errors import DeviceError
from drivers.interfaces import Identity, Setting, Surroundings
from drivers.serial_line import SerialLine
from drivers.varispec.echo_client import FilterRefusal, VariSpecClient
from drivers.varispec.health import VariSpecHealth
from drivers.varispec.options import VariSpecOptions, as_tuple
from drivers.varispec.palette import Palette
from drivers.varispec.protocol import Version
from drivers.varispec.settling import COLDEST, settling_factor
from drivers.varispec.startup import VariSpecStartup
from drivers.varispec.tuning import Tuning

log = logging.getLogger(__name__)

T = TypeVar("T")


class VariSpec:
    """Tune a VariSpec filter on a serial port (its USB units appear as serial ports, too).

    Opening takes up to a minute if the filter must be initialised. If `progress` was set before,
    it is called with the name of the step and the share that is done. While the filter is open,
    the driver never initialises it on its own, because frames before and after could not be
    compared. Source: VariSpec user manual 1.37.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock.
    port : str
        "/dev/ttyUSB0", "COM3" or a URL of pyserial.
    baudrate : int
        9600, 19200 or 115200.
    settling_ms : float
        Response time to 95 % in milliseconds as specified for the model: 50 for VIS and 150 for
        NIR. The driver lengthens it if the optics are colder than 20 degrees Celsius.
    bandwidth_nm : float
        Full width at half maximum in nanometres, which the filter can't report.
    recalibrate : {"if needed", "correct", "always"}
        What is done on opening besides what is necessary: nothing, a correction for the
        temperature, or an initialisation (30 s).
    exercise : bool
        Whether the liquid crystals are exercised on opening (12 s) if they haven't been.
    palette_nm : sequence of float
        Wavelengths in nanometres, 128 at most, that are calculated on opening, so that units with
        RS-232 tune quickly.
    serial : str
        Serial number that the filter must have, and by which it is awakened; any if empty.
    terminator : str
        End of a line, "\\r", or "\\n" for units with RS-232 that are configured so.

    Raises
    ------
    ValueError
        If an option is invalid.
    """

    reply_time = 3.0
    _call_timeout = reply_time - 0.1

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
        self._options = VariSpecOptions(
            port, baudrate, settling_ms, bandwidth_nm, recalibrate, exercise,
            as_tuple("palette_nm", palette_nm), serial, terminator,
        )  # fmt: skip
        self._clock = surroundings.clock
        self._line = SerialLine("VariSpec", port, self._clock, baudrate=baudrate)
        self._client = VariSpecClient(self._line, terminator)
        self._startup = VariSpecStartup(self._client, self._options, self._report)
        self._palette = Palette(self._client)
        self._version: Version | None = None
        self._temperature, self._temperature_read_at = COLDEST, 0.0
        self._tuning = Tuning(self._client)
        self.progress: Callable[[str, float], None] | None = None
        self.alive_at = 0.0

    def __enter__(self) -> Self:
        try:
            self._version = self._startup.begin()
            self._note_temperature(self._startup.temperature)
            self._palette.forget()
            if self._options.palette_nm:
                self.define_palette([nm * 1e-9 for nm in self._options.palette_nm])
            self._tuning.nm = self._run("read the wavelength", self._tuning.read)
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        try:
            if self._version:
                self.make_safe()
        except DeviceError as failure:
            log.warning("left as it is: %s", failure)
        finally:
            self._close()

    def _close(self) -> None:
        self._version = None
        self._line.close()

    def kill(self) -> None:
        """Cancel the running call, from any thread; the object can't be used afterwards."""
        self._line.cancel()

    def unplugged_reason(self) -> str | None:
        """Return why the filter counts as unplugged, empty while it is connected."""
        return self._line.unplugged_reason()

    @property
    def identity(self) -> Identity:
        return Identity("VariSpec", self._known_version.serial, simulated=False)

    @property
    def settling(self) -> float:
        return self._options.settling_ms * 1e-3 * settling_factor(self._temperature)

    @property
    def wavelength_range(self) -> tuple[float, float]:
        return _metres(self._known_version.shortest), _metres(self._known_version.longest)

    @property
    def bandwidth(self) -> float:
        return self._options.bandwidth_nm * 1e-9

    @property
    def wavelength(self) -> float:
        """Wavelength in metres to which the filter says that it is tuned."""
        return _metres(self._run("read the wavelength", self._tuning.read))

    @property
    def temperature(self) -> float:
        """Temperature of the liquid crystals in degrees Celsius, read now."""
        return self._run("read the temperature", self._read_temperature)

    @property
    def palette(self) -> tuple[float, ...]:
        """Wavelengths in metres that the filter has calculated in advance, read now."""
        # Over RS-232, reading a full palette takes longer than any other call.
        self.alive_at = time.monotonic()
        told = self._run("read the palette", self._palette.read, self.reply_time + 5.0)
        return tuple(map(_metres, told))

    def set_wavelength(self, wavelength: float) -> Setting[float]:
        """Tune to a wavelength in metres, which is rounded to 0.01 nm."""
        nm = round(wavelength * 1e9, 2)
        command = f"tune to {nm:.2f} nm"
        self._require_in_range(nm, command)

        def tune() -> None:
            # The settling depends on the temperature, which is read again after ten minutes.
            if self._clock.now() - self._temperature_read_at > 600.0:
                self._read_temperature()
            self._tuning.tune(nm, self._palette.find(nm), command)

        self._run(command, tune)
        return self._setting(wavelength)

    def define_palette(self, wavelengths: Sequence[float]) -> tuple[float, ...]:
        """Have wavelengths (in metres) calculated in advance; return the palette.

        set_wavelength() then uses them. This takes up to half a second per wavelength.
        """
        given = [round(wavelength * 1e9, 2) for wavelength in wavelengths]
        for nm in given:
            self._require_in_range(nm, f"palette with {nm:.2f} nm")
        self._run("clear the palette", self._palette.clear)
        for element, nm in enumerate(given):
            self._report("defining the palette", element / len(given))
            self._run(f"palette with {nm:.2f} nm", partial(self._palette.define, element, nm))
        held = self.palette
        if held != tuple(map(_metres, given)):
            self._palette.forget()
            raise self._line.error("define the palette", f"it holds {held}", "Define it again")
        return held

    def clear_palette(self) -> None:
        self._run("clear the palette", self._palette.clear)

    def choose(self, element: int) -> Setting[float]:
        """Tune to an element of the palette, counted from 0."""
        command = f"tune to element {element} of the palette"

        nm = self._run(command, lambda: self._tuning.choose(element, command))
        return self._setting(_metres(nm))

    def refresh(self, *, completely: bool = True) -> None:
        """Initialise the filter again (30 s), or only correct it for the temperature (quick).

        Don't call this between frames that are to be compared. It takes 30 s more if the filter
        was just plugged in again.
        """
        self._synchronise("initialise")
        self._startup.initialise(completely)
        self._note_temperature(self._startup.temperature)
        self.set_wavelength(_metres(self._tuning.nm or self._known_version.shortest))

    def exercise(self, cycles: int = 3) -> None:
        """Exercise the liquid crystals, 12 s per cycle; the manual says 3 are enough."""
        if cycles not in range(1, 256):
            raise ValueError(f"cycles is {cycles!r}; it must be from 1 to 255")
        self._synchronise("exercise")
        self._startup.exercise(cycles)

    def sleep(self) -> None:
        """Send the filter to sleep; it answers nothing until it is awakened."""
        self._run("sleep", lambda: self._client.sleep(self._known_version.serial))

    def awaken(self) -> None:
        self._line.in_sync = False
        self._run("awaken", lambda: None)

    def health(self) -> dict[str, str]:
        """Read the filter's state, and say what should be done about it."""
        with self._line.within(self._call_timeout):
            status = self._run(
                "read the status", lambda: self._client.read_status("read the status")
            )
            temperature = self.temperature
        return VariSpecHealth(
            version=self._known_version,
            status=status,
            temperature=temperature,
            initialised_temperature=self._startup.temperature,
            age=self._clock.now() - self._startup.initialised_at,
            initialisation=self._startup.initialisation,
            specified=self._options.settling_ms * 1e-3,
            settling=self.settling,
            failures=self._client.failures,
        ).report

    def make_safe(self) -> None:
        self.set_wavelength(self.wavelength_range[0])

    @property
    def _known_version(self) -> Version:
        if self._version is None:
            raise DeviceError("VariSpec", "identity", "it is not open", "Open it first")
        return self._version

    def _require_in_range(self, nm: float, command: str) -> None:
        low, high = self._known_version.shortest, self._known_version.longest
        if not low <= nm <= high:
            raise FilterRefusal(
                "VariSpec",
                command,
                f"out of range, {low:.2f} to {high:.2f} nm",
                "Choose a wavelength in the range",
            )

    def _run(self, command: str, work: Callable[[], T], seconds: float = _call_timeout) -> T:
        """Run `work` when synchronised; retry up to twice if the line is noisy."""
        told = self._known_version

        def rest() -> None:
            if not self._startup.resynchronise(command, told).palette:
                self._palette.forget()

        with self._line.within(seconds):
            return self._client.call_with_retry(rest, work)

    def _synchronise(self, command: str) -> None:
        """Synchronise with the idle filter before a long operation."""
        _ = self._known_version
        self._startup.wait_if_plugged_in_again(command)
        self._run(command, lambda: None)

    def _report(self, what: str, share: float) -> None:
        self.alive_at = time.monotonic()
        if share == 0.0:
            log.info("VariSpec: %s", what)
        if self.progress is not None:
            self.progress(what, share)

    def _setting(self, asked: float) -> Setting[float]:
        actual = _metres(self._tuning.nm)
        return Setting(asked, actual, self._clock.now() + self.settling)

    def _read_temperature(self) -> float:
        self._note_temperature(self._startup.read_temperature("read the temperature"))
        return self._temperature

    def _note_temperature(self, temperature: float) -> None:
        self._temperature, self._temperature_read_at = temperature, self._clock.now()


def _metres(nm: float) -> float:
    """Convert a wavelength from nm to m, rounded to 0.01 nm so that equal ones compare equal."""
    return round(nm * 100) / 1e11
