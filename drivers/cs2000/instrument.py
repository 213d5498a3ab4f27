"""The instrument that a bench opens, over USB or RS-232C.

The manufacturer allows the use of its communication specifications for software that works with
these instruments; commercial software needs its permission. See the README.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.cs2000.command_client import LONGEST_REPLY_BITS, CodeError, CS2000Client
from drivers.cs2000.instrument_settings import NDS, settings_from_options
from drivers.cs2000.measurement import COMMAND, TIMING, CS2000Measurement
from drivers.cs2000.spectrum import parse_hex_floats, read_spectrum
from drivers.errors import DeviceError
from drivers.interfaces import Identity, Spectrum, Surroundings
from drivers.serial_line import SerialLine

log = logging.getLogger(__name__)

_ANGLES = (1.0, 0.2, 0.1)
"""Measuring angles in degrees, by the instrument's code."""

_CONDITIONS = "([0-4]),([0-2]),([0-9]{9}),([01]),([01]),([0-2]),([0-2]),([0-9]{2})"


class CS2000:
    """Measure spectral radiance with a CS-2000 or CS-2000A spectroradiometer.

    The instrument stays in remote mode while it is open. Its flash memory wears out with writes:
    settings are written to it only if the firmware is older than 3.00.9301, and only if they
    differ from those that it has.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock.
    port : str
        Serial port, such as "/dev/ttyACM0".
    baudrate : int
        600 to 115200; it matters only over RS-232C.
    mode : {"normal", "fast", "multi", "multi fast", "manual"}
        Measuring mode. The multi modes average several integrations.
    integration_ms : float, optional
        Integration time of the manual mode in milliseconds, 5 to 120000, in whole microseconds.
    integration_s : int, optional
        Integration time of the multi modes in seconds, 1 to 16.
    nd : {"off", "on", "auto"}, optional
        Internal neutral-density filter; in manual mode only "off" or "on".
    sync_hz : float
        Frequency of a flickering light in hertz, 20 to 200; 0 for none.
    external_sync : bool
        Whether the measurement is synchronised by the instrument's sync socket.
    external_nd : {"none", "1/10", "1/100"}
        Filter in front of the lens, which the instrument can't detect.
    close_up_lens : bool
        Whether the close-up lens is mounted, which the instrument can't detect.
    rtscts : bool
        Whether the serial line uses hardware flow control.

    Raises
    ------
    ValueError
        If an option is invalid.
    """

    settling = 0.0

    def __init__(
        self,
        surroundings: Surroundings,
        port: str,
        baudrate: int = 115200,
        mode: str = "normal",
        integration_ms: float | None = None,
        integration_s: int | None = None,
        nd: str | None = None,
        sync_hz: float = 0.0,
        external_sync: bool = False,
        external_nd: str = "none",
        close_up_lens: bool = False,
        rtscts: bool = True,
    ) -> None:
        self._requested_settings = settings_from_options(
            port,
            baudrate,
            mode=mode,
            integration_ms=integration_ms,
            integration_s=integration_s,
            nd=nd,
            sync_hz=sync_hz,
            external_sync=external_sync,
            external_nd=external_nd,
            close_up_lens=close_up_lens,
            rtscts=rtscts,
        )
        self._clock = surroundings.clock
        self._line = SerialLine(
            "Konica Minolta CS-2000", port, self._clock, baudrate=baudrate, rtscts=rtscts
        )
        self._link = CS2000Client(self._line, baudrate, self._check)
        # Time to synchronise, for one answer at its latest, and for reading a spectrum three times.
        self.reply_time = 2 * self._link.reply_timeout + 10 + 12 * LONGEST_REPLY_BITS / baudrate
        self._identity = Identity(self._line.model, "", simulated=False)
        self.alive_at = 0.0

    @property
    def identity(self) -> Identity:
        return self._identity

    @property
    def wavelengths(self) -> NDArray[np.float64]:
        """Wavelengths of a spectrum in metres: 380 to 780 nm in steps of 1 nm, (401,)."""
        return np.arange(380, 781) / 1e9

    def measure(self, cancelled: Callable[[], bool]) -> Spectrum:
        """Measure one spectrum; this takes 3 to 250 s, depending on brightness.

        If an error occurs, the reply time and 16 s may be added.

        DeviceError if the light is too bright or flickers too irregularly, if the instrument
        couldn't compute a value, or if the measurement was cancelled.
        """
        measuring = CS2000Measurement(self._link, cancelled, self._note_progress)
        began = self._clock.now()
        with self._line.within(self.reply_time):
            seconds = self._link.call_with_retry(COMMAND, measuring.start)
            started = self._clock.now()
        with self._line.within(seconds + TIMING.overtime + 1):
            measuring.await_end(seconds)
        spent = started - began
        with self._line.within(max(self.reply_time - spent, self._link.reply_timeout)):
            conditions = self._link.call_with_retry(COMMAND, self._read_conditions)
            values = self._link.call_with_retry(COMMAND, lambda: read_spectrum(self._link, COMMAND))
        integration, dimmed, angle = conditions
        return Spectrum(self.wavelengths, values * 1e9, integration, dimmed, angle, started)

    def tristimulus(self) -> tuple[float, float, float]:
        """Read the instrument's own X, Y and Z of the last measurement, Y in cd/m²."""
        command = "read X, Y, Z"

        def read() -> list[float]:
            found = self._link.confirmed_reply("MEDR,2,1,1", "([0-9A-F]{8},?){3}", command)
            return parse_hex_floats(self._link, found[0].split(","), command)

        with self._line.within(self.reply_time):
            x, y, z = self._link.call_with_retry(command, read)
        return x, y, z

    def health(self) -> dict[str, str]:
        """Read serial number, measuring angle and calibration date."""
        command = "health"

        def read() -> dict[str, str]:
            angle = int(self._link.confirmed_reply("STSR", "[0-2]", command)[0])
            date = self._link.confirmed_reply(
                "DTCR", "([0-9]{4})([0-9]{2})([0-9]{2}),[0-9]{6}", command
            )
            return {
                "serial number": self._identity.serial,
                "measuring angle": f"{_ANGLES[angle]:g}°",
                "calibrated": f"{date[1]}-{date[2]}-{date[3]}",
            }

        with self._line.within(self.reply_time):
            return self._link.call_with_retry(command, read)

    def unplugged_reason(self) -> str | None:
        """Return why the instrument counts as unplugged, empty while it is connected."""
        return self._line.unplugged_reason()

    def make_safe(self) -> None:
        """Stop a running measurement."""
        with self._line.within(self.reply_time):
            self._link.get_ready("make safe")

    def kill(self) -> None:
        """Cancel the running call and all later ones; from any thread."""
        self._line.cancel()

    def __enter__(self) -> Self:
        try:
            with self._line.within(self.reply_time):
                self._line.open()
                self._link.get_ready("open")
        except BaseException:
            self._line.close()
            raise
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            if self._identity.serial:
                with self._line.within(self.reply_time):
                    self.make_safe()
                    # Leave remote mode, so that the instrument's keys work again.
                    self._link.ask("RMTS,0", "close")
        except DeviceError as failure:
            log.warning("left as it is: %s", failure)
        finally:
            self._line.close()

    def _check(self, command: str) -> None:
        """Verify that the same instrument answers, and apply the requested settings."""
        found = self._link.confirmed_reply(
            "IDDR", "([A-Z]{2}-[0-9]{4}[A-Z ]{2}),([0-9]),([0-9]{7})", command
        )
        identity = Identity(f"Konica Minolta {found[1].strip()}", found[3], simulated=False)
        known = self._identity
        if known.serial and known != identity:
            raise self._line.error(
                command,
                f"another instrument answers: {identity.model}, number {identity.serial}, "
                f"not {known.serial}",
                "Plug the first one in again, or open the bench again",
            )
        self._identity, self._line.model = identity, identity.model
        self._link.ask("MSWE,0", command)
        self._link.set("NDFS", str(self._requested_settings.external_nd), "NDFR", command)
        self._link.set("LNSS", str(self._requested_settings.lens), "LNSR", command)
        self._link.set("SCMS", self._requested_settings.sync, "SCMR", command)
        self._set_speed(command)

    def _set_speed(self, command: str) -> None:
        """Set the measuring mode, integration time and internal filter."""
        try:
            self._link.set(
                "SPMS",
                f"{self._requested_settings.speed},{self._requested_settings.nd}",
                "SPMR",
                command,
            )
        except CodeError as error:
            if (
                error.code != "00"
                or self._requested_settings.nd != NDS["auto"]
                or self._requested_settings.speed[0] not in "012"
            ):
                raise
            # Firmware up to 1.01 always chooses its filter itself and rejects that argument.
            self._link.set("SPMS", self._requested_settings.speed, "SPMR", command)

    def _note_progress(self) -> None:
        self.alive_at = time.monotonic()

    def _read_conditions(self) -> tuple[float, bool, float]:
        """Read the last measurement's integration time in s, internal filter and angle.

        The second value is whether the internal filter was used. The angle is in radians.
        """
        found = self._link.confirmed_reply("MEDR,0,0,1", _CONDITIONS, COMMAND)
        told = (found[1], found[2], found[5], found[6])
        want = self._requested_settings
        wanted = (want.speed[0], want.sync[0], str(want.lens), str(want.external_nd))
        integration = int(found[3]) * 1e-6
        if told != wanted or not 0 < integration <= 121:
            raise self._line.error(
                COMMAND, f"it was measured under other conditions: {found[0]}", "Measure again"
            )
        return integration, found[4] == "1", math.radians(_ANGLES[int(found[7])])
