"""Turn an FW102C (6 slots) or FW212C (12 slots) over a serial port.

Source: Thorlabs' manual of the FW102C/FW212C, chapter 5.2.3.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

from drivers.errors import DeviceError
from drivers.interfaces import Identity, Setting, Surroundings
from drivers.serial_line import SerialLine
from drivers.thorlabs_wheel.prompt_client import REPLY_TIMEOUT, ThorlabsClient
from drivers.wheel import Wheel, steps_between

log = logging.getLogger(__name__)

_STEP_MS = {True: 2000.0, False: 4000.0}
"""Milliseconds per slot if fast, and if slow: twice the times that others have observed."""

_TRIGGER_MODES = {"input": 0, "output": 1}


class ThorlabsWheel(Wheel):
    """Turn the slots of a Thorlabs FW102C or FW212C filter wheel.

    Firmware 1.0 has no commands for speed, sensors and the number of slots.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock.
    port : str
        Serial port of its USB cable, such as "/dev/ttyUSB0".
    slots_nm : sequence of sequence of float
        Centre and full width at half maximum of each of the 6 or 12 slots' filters, in nanometres.
    names : sequence of str
        Names of the slots; by default their centres.
    avoid : sequence of int
        Slots that must not cross the light during a move.
    fast : bool
        Whether the wheel turns at its fast speed.
    step_ms : float, optional
        Longest time per slot in milliseconds; by default 2000 if fast, and 4000 if not.
    settling_ms : float
        Milliseconds from the end of a move until the filter has settled.
    baudrate : int
        115200, or 9600 if the wheel was configured so.
    sensors : bool
        Whether the lamps of its sensors stay on while it stands; they cause stray light.
    trigger : {"input", "output"}
        "input": a pulse advances the wheel. "output": the wheel sends a pulse for each move.

    Raises
    ------
    ValueError
        If an option is invalid.
    """

    def __init__(
        self,
        surroundings: Surroundings,
        port: str,
        slots_nm: Sequence[Sequence[float]],
        names: Sequence[str] = (),
        avoid: Sequence[int] = (),
        fast: bool = True,
        step_ms: float | None = None,
        settling_ms: float = 0.0,
        baudrate: int = 115200,
        sensors: bool = False,
        trigger: str = "input",
    ) -> None:
        if not isinstance(port, str) or not port:
            raise ValueError(f"port is {port!r}; look it up by: labapp devices")
        for name, value in (("fast", fast), ("sensors", sensors)):
            if not isinstance(value, bool):
                raise ValueError(f"{name} is {value!r}; give true or false")
        if type(baudrate) is not int or baudrate not in (9600, 115200):
            raise ValueError(f"baudrate is {baudrate!r}; the wheel has 115200 or 9600")
        if not isinstance(trigger, str) or trigger not in _TRIGGER_MODES:
            raise ValueError(f"trigger is {trigger!r}; choose {' or '.join(_TRIGGER_MODES)}")
        step = _STEP_MS[fast] if step_ms is None else step_ms
        super().__init__(surroundings, slots_nm, names, avoid, step, settling_ms)
        if len(self._slots) not in (6, 12):
            raise ValueError(
                f"slots_nm has {len(self._slots)} slots; give all 6 of a FW102C or 12 of a FW212C"
            )
        self.model = "Thorlabs FW102C" if len(self._slots) == 6 else "Thorlabs FW212C"
        self._line = SerialLine(self.model, port, self._clock, baudrate=baudrate)
        turning = len(self._slots) // 2 * self._step
        self._link = ThorlabsClient(self._line, turning, self._check)
        self._requested_settings = {
            "speed": int(fast),
            "sensors": int(sensors),
            "trig": _TRIGGER_MODES[trigger],
        }
        self._firmware = ""
        self._last_slot = 1

    @property
    def identity(self) -> Identity:
        """Model, without a serial number, which can't be read."""
        return Identity(self.model, "", simulated=False)

    @property
    def slot(self) -> int:
        with self._line.within(self.reply_time):
            return super().slot

    def set_slot(self, number: int) -> Setting[int]:
        """Turn to a slot and wait until it has arrived."""
        with self._line.within(self.reply_time):
            return super().set_slot(number)

    def health(self) -> dict[str, str]:
        """Read firmware version, slot and settings."""

        def read() -> dict[str, str]:
            return {
                name: self._link.confirmed_reply(f"{name}?", "health")
                for name in ("pos", *self._setting_names)
            }

        with self._line.within(self.reply_time):
            told = self._link.call_with_retry("health", read)
        return {"firmware": self._firmware, "slot": told.pop("pos"), **told}

    def save(self) -> None:
        """Store the settings, so that they apply after the next switching on."""
        with self._line.within(self.reply_time):
            self._link.call_with_retry("save", lambda: self._link.ask("save", "save"))

    def kill(self) -> None:
        """Cancel the running call and all later ones; from any thread."""
        self._line.cancel()

    def unplugged_reason(self) -> str | None:
        """Return why it counts as unplugged, empty while it is connected."""
        return self._line.unplugged_reason()

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            if self._firmware:
                self.make_safe()
        except DeviceError as failure:
            log.warning("left as it is: %s", failure)
        finally:
            self._close()

    def _open(self) -> None:
        with self._line.within(self.reply_time):
            self._line.open()
            self._link.get_ready("open")

    def _close(self) -> None:
        self._line.close()

    @property
    def _setting_names(self) -> tuple[str, ...]:
        """Names of the settings that the firmware knows."""
        return ("trig",) if self._firmware == "1.0" else ("speed", "sensors", "trig", "pcount")

    def _read_slot(self, command: str) -> int:
        count = len(self._slots)
        self._last_slot = self._link.call_with_retry(
            command, lambda: self._link.query_integer("pos?", command, count)
        )
        return self._last_slot

    def _turn_to(self, command: str, number: int) -> None:
        turning = steps_between(self._last_slot, number, len(self._slots)) * self._step
        self._link.get_ready(command)
        failure = None
        try:
            self._link.ask(f"pos={number}", command, turning + REPLY_TIMEOUT)
        except DeviceError as error:
            if self._line.is_cancelled or not self._line.is_open:
                raise
            failure = error
        try:
            stands = self._read_slot(command)
        except DeviceError:
            if self._line.is_cancelled or failure is None:
                raise
            # It may still be turning, and answers nothing until it has stopped.
            raise self._refuse(
                command, failure.reply, f"{failure.remedy}. If it only turns slowly, raise step_ms"
            ) from None
        if stands != number and failure:
            raise failure
        if stands != number:
            raise self._refuse(
                command,
                f"it stands at slot {stands}: it is stuck, or was turned by hand",
                "Switch it off, turn the wheel by hand once, switch it on",
            )

    def _check(self, command: str) -> None:
        """Verify that the same device answers, and apply the requested settings."""
        firmware = self._link.read_firmware(command)
        if self._firmware not in ("", firmware):
            raise self._line.error(
                command,
                f"another wheel answers: firmware {firmware}, not {self._firmware}",
                "Plug the first one in again, or open the bench again",
            )
        self._firmware = firmware
        if firmware != "1.0":
            count = self._link.query_integer("pcount?", command, 12)
            if count != len(self._slots):
                raise self._line.error(
                    command,
                    f"the wheel has {count} slots, and slots_nm {len(self._slots)}",
                    "Give slots_nm an entry for every slot, empty ones too",
                )
        for name, value in self._requested_settings.items():
            if (
                name in self._setting_names
                and self._link.query_integer(f"{name}?", command, 1, 0) != value
            ):
                self._link.ask(f"{name}={value}", command)
                if self._link.query_integer(f"{name}?", command, 1, 0) != value:
                    raise self._line.error(command, f"{name} doesn't become {value}")
