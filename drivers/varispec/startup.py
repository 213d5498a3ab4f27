"""Find a filter, synchronise with it and initialise it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import DeviceError
from drivers.varispec.echo_client import FilterRefusal, VariSpecClient
from drivers.varispec.options import VariSpecOptions
from drivers.varispec.protocol import TEMPERATURE_REPLY, VERSION_REPLY, Status, Version


@dataclass(frozen=True)
class StartupTiming:
    """Tune how long initialisation and exercise are waited for, in seconds.

    open_timeout: within which opening succeeds or fails; the bench waits for a minute.
    initialisation: approximate time of an initialisation, from the manual.
    exercise: approximate time of one exercise cycle, from the manual.
    time_factor: factor by which those times may be exceeded. Chosen.
    calculation: for which electronics with RS-232 may be busy with a wavelength.
    poll_interval: between two queries of whether the filter is idle. Chosen.
    """

    open_timeout: float = 57.0
    initialisation: float = 30.0
    exercise: float = 12.0
    time_factor: float = 1.5
    calculation: float = 0.5
    poll_interval: float = 0.5

    @property
    def power_up(self) -> float:
        """Seconds after plugging in within which the filter may initialise itself."""
        return self.initialisation * self.time_factor


_TIMING = StartupTiming()

_ASLEEP = (
    "Check power, cable, port and baud rate. If it was sent to sleep, give its serial number in "
    "the option serial"
)


class VariSpecStartup:
    """Find, check and initialise a filter.

    report: called with the name of the present step and the share that is done.
    """

    def __init__(
        self, talk: VariSpecClient, options: VariSpecOptions, report: Callable[[str, float], None]
    ) -> None:
        self._talk, self._line, self._options = talk, talk.line, options
        self._report = report
        self.temperature = 0.0
        """Degrees Celsius when the filter was initialised, or first read."""
        self._plugged_at = -math.inf
        self.initialised_at = 0.0
        self.initialisation = ""

    def begin(self) -> Version:
        """Find the filter and prepare it for tuning; DeviceError within a minute."""
        options = self._options
        with self._line.within(_TIMING.open_timeout):
            self._line.reopen("open")
            self._plugged_at = -math.inf
            self._wait_for_power_up()
            told = self._talk.call_with_retry(self._find, self._identify)
            if options.serial and int(told.serial) != int(options.serial):
                raise FilterRefusal(
                    self._line.model,
                    "open",
                    f"it is number {told.serial}, not {options.serial}",
                    "Check the option port",
                )
            if options.recalibrate == "always" or not self._ask_status().initialised:
                self.initialise(completely=True)
            elif options.recalibrate == "correct":
                self.initialise(completely=False)
            else:
                self._record_initialisation("found initialised")
            if options.exercise and not self._ask_status().exercised:
                self.exercise(1)
        return told

    def wait_if_plugged_in_again(self, command: str) -> None:
        """Let a filter that was just plugged in finish its own initialisation."""
        if not self._line.is_open:
            self._line.open(command)
        elif self._line.clock.now() - self._plugged_at > _TIMING.power_up:
            return
        self._wait_for_power_up()
        self._plugged_at = -math.inf

    def resynchronise(self, command: str, known: Version | None) -> Status:
        """Abort the command, discard late answers, and check that it is the same filter.

        Modes that a power failure resets are set again; the filter may then be uninitialised.
        """
        talk = self._talk
        self._wait_out_power_up(command)
        talk.abort(command)
        status = self._wake_and_read_status(command, known)
        if talk.is_busy(command):
            raise self._line.error(command, "it is busy", "Wait; if it stays so, switch it off")
        for text in ("B 0", "G 0", "R 1"):
            talk.send(text, command)
        if talk.query_integer("R", command):
            raise self._line.error(command, "its error can't be cleared")
        if known is not None:
            found = self._ask_version(command)
            if found != known:
                raise self._line.error(
                    command, f"another filter answers: {found}", "Plug the right one in"
                )
        self._line.in_sync = True
        return status

    def initialise(self, completely: bool) -> None:
        """Initialise the filter, or only correct it for the temperature."""
        talk, command = self._talk, "initialise" if completely else "correct for the temperature"
        talk.call_with_retry(self._find, lambda: talk.send(f"I {completely:d}", command))
        self._wait_until_idle("initialising", command, _TIMING.initialisation)
        talk.call_with_retry(self._find, lambda: self._require_initialised(command))
        self._record_initialisation(
            "initialised" if completely else "corrected for the temperature"
        )

    def exercise(self, cycles: int) -> None:
        talk = self._talk
        talk.call_with_retry(self._find, lambda: talk.send(f"E {cycles}", "exercise"))
        self._wait_until_idle("exercising", "exercise", cycles * _TIMING.exercise)
        talk.call_with_retry(self._find, lambda: talk.require_no_error("exercise"))

    def read_temperature(self, command: str) -> float:
        def ask() -> float:
            return float(self._talk.ask("Y ?", TEMPERATURE_REPLY, command)[1])

        told = self._talk.confirmed_reply(ask, command, lambda one, other: abs(one - other) <= 0.25)
        if not -40.0 <= told <= 100.0:
            raise self._line.error(command, f"its temperature is {told:g} °C")
        return told

    def _find(self) -> None:
        self.resynchronise("open", None)

    def _identify(self) -> Version:
        return self._talk.confirmed_reply(lambda: self._ask_version("open"), "open")

    def _ask_status(self) -> Status:
        return self._talk.call_with_retry(self._find, lambda: self._talk.read_status("open"))

    def _ask_version(self, command: str) -> Version:
        answer = self._talk.ask("V ?", VERSION_REPLY, command)
        version = Version(answer[1], float(answer[2]), float(answer[3]), answer[4])
        if not 100.0 <= version.shortest < version.longest:
            raise self._line.error(command, f"it says that it is {version}")
        return version

    def _wake_and_read_status(self, command: str, known: Version | None) -> Status:
        try:
            return self._talk.read_status(command)
        except DeviceError as error:
            serial = known.serial if known else self._options.serial
            if not self._line.is_open:
                raise
            if not serial:
                raise self._line.error(command, error.reply, _ASLEEP) from error
        self._talk.abort(command)
        self._talk.send(f"A {int(serial)}", command)
        return self._talk.read_status(command)

    def _wait_for_power_up(self) -> None:
        """Wait while a filter that was just switched on initialises itself.

        Aborting the initialisation would only cost time.
        """
        self._line.drain(0.07, 1.0, "open")
        try:
            busy = self._talk.is_busy("open")
        except DeviceError:
            return
        if busy:
            self._wait_until_idle("waiting for its power-up", "open", _TIMING.initialisation)

    def _wait_out_power_up(self, command: str) -> None:
        """Avoid aborting the initialisation of a filter that was unplugged and lost its power."""
        now = self._line.clock.now
        if not self._line.is_open:
            self._line.open(command)
            self._plugged_at = now()
            self._line.drain(0.07, 0.5, command)
        if now() - self._plugged_at > _TIMING.power_up:
            return
        clock = self._line.clock
        late = now() + _TIMING.calculation
        try:
            while (busy := self._talk.is_busy(command)) and now() < late:
                clock.wait_until(now() + 0.05, lambda: self._line.is_cancelled)
        except DeviceError:
            return
        if busy:
            raise self._line.error(
                command, "it is busy, initialising itself perhaps", "Wait for half a minute"
            )
        self._plugged_at = -math.inf

    def _require_initialised(self, command: str) -> None:
        self._talk.require_no_error(command)
        if not self._talk.read_status(command).initialised:
            raise FilterRefusal(
                self._line.model,
                command,
                "it doesn't get initialised",
                "Check the cable between optics and electronics; switch it off and on",
            )

    def _wait_until_idle(self, what: str, command: str, seconds: float) -> None:
        """Ask until the filter is idle; repeat queries whose answers are garbled."""
        clock = self._line.clock
        began = clock.now()
        late = began + min(seconds * _TIMING.time_factor + 5.0, self._line.time_left - 1.0)
        while clock.now() < late:
            self._report(what, min((clock.now() - began) / max(seconds, 1e-3), 0.99))
            try:
                if not self._talk.is_busy(command):
                    self._report(what, 1.0)
                    return
            except DeviceError:
                if not self._line.is_open or self._line.is_cancelled:
                    raise
                self._line.drain(0.07, 1.0, command)
            clock.wait_until(clock.now() + _TIMING.poll_interval, lambda: self._line.is_cancelled)
        raise self._line.error(
            command,
            f"it is still busy after {clock.now() - began:.0f} s",
            "Switch the filter off and on",
        )

    def _record_initialisation(self, how: str) -> None:
        self.temperature = self._talk.call_with_retry(
            self._find, lambda: self.read_temperature("open")
        )
        self.initialised_at, self.initialisation = self._line.clock.now(), how
