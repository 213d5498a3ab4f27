"""Thorlabs' filter wheels FW102C (6 slots) and FW212C (12 slots), over their serial port.

Source: Thorlabs' manual of the FW102C/FW212C, chapter 5.2.3. The wheel speaks as to a person
at a terminal: it echoes each command, tells a value where one was asked for, and then prompts,
after a move as soon as that is done.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from typing import TypeVar

from drivers.errors import DeviceError
from drivers.interfaces import Identity, Setting, Surroundings
from drivers.serial_line import SerialLine
from drivers.wheel import Wheel, steps_between

T = TypeVar("T")

log = logging.getLogger(__name__)

_PROMPT = b"> "

_PATIENCE = 1.0
"""Seconds for an answer that needs no turning."""

_PROMPTS = 5
"""Times that it is brought to its prompt before it is given up."""

_QUIET = 0.05
"""Seconds without a byte, after which nothing more is expected."""

_STEP_MS = {True: 2000.0, False: 4000.0}
"""Milliseconds for a slot, fast and slow: twice what others have seen it need."""

_BODY = re.compile(rb"\0*(?:([ -~]+)[\r\n]+)?")
"""Between echo and prompt."""

_IDENTITY = re.compile(r"THORLABS FW102C/FW212C Filter Wheel version ([0-9]+\.[0-9]+)")

_ERRORS = {
    "CMD_NOT_DEFINED": "it doesn't know the command (CMD_NOT_DEFINED)",
    "CMD_ARG_INVALID": "it refuses the value (CMD_ARG_INVALID)",
}

_MODES = {"input": 0, "output": 1}


class ThorlabsWheel(Wheel):
    """A FW102C or FW212C.

    port: of its USB cable, such as "/dev/ttyUSB0". slots_nm, names, avoid, settling_ms: as in
    Wheel; slots_nm has an entry for each of its 6 or 12 slots. fast: how it turns. step_ms: the
    most that it needs for a slot; by default 2000 if fast and 4000 if not. baudrate: 115200, or
    9600 where it was set so. sensors: whether its lamps stay on while it stands; in the dark
    they are stray light. trigger: "input" to turn on by a pulse, "output" to give one for each
    turn.

    Firmware 1.0 can't be told speed and sensors, nor can it tell how many slots it has.
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
        if not isinstance(trigger, str) or trigger not in _MODES:
            raise ValueError(f"trigger is {trigger!r}; choose {' or '.join(_MODES)}")
        step = _STEP_MS[fast] if step_ms is None else step_ms
        super().__init__(surroundings, slots_nm, names, avoid, step, settling_ms)
        if len(self._slots) not in (6, 12):
            raise ValueError(
                f"slots_nm has {len(self._slots)} slots; give all 6 of a FW102C or 12 of a FW212C"
            )
        self.model = "Thorlabs FW102C" if len(self._slots) == 6 else "Thorlabs FW212C"
        self._line = SerialLine(self.model, port, self._clock, baudrate=baudrate)
        self._wanted = {"speed": int(fast), "sensors": int(sensors), "trig": _MODES[trigger]}
        self._firmware = ""
        self._primed = False
        self._last = 1

    @property
    def identity(self) -> Identity:
        """The wheel has no serial number to tell."""
        return Identity(self.model, "", simulated=False)

    @property
    def slot(self) -> int:
        with self._line.within(self.reply_time):
            return super().slot

    def set_slot(self, number: int) -> Setting[int]:
        """Turn to a slot and wait until the wheel stands there."""
        with self._line.within(self.reply_time):
            return super().set_slot(number)

    def health(self) -> dict[str, str]:
        """Firmware and settings, as the wheel tells them."""

        def read() -> dict[str, str]:
            return {name: self._agreed(f"{name}?", "health") for name in ("pos", *self._settable)}

        with self._line.within(self.reply_time):
            told = self._persistently("health", read)
        return {"firmware": self._firmware, "slot": told.pop("pos"), **told}

    def save(self) -> None:
        """Have the wheel keep its settings for when it is switched on again."""
        with self._line.within(self.reply_time):
            self._persistently("save", lambda: self._tell("save", "save"))

    def kill(self) -> None:
        """End a call that goes on, and all later ones; from any thread."""
        self._line.cancel()

    def gone(self) -> str | None:
        """Why it counts as unplugged, empty while it is there; see Device."""
        return self._line.gone()

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
            self._get_ready("open")

    def _close(self) -> None:
        self._line.close()

    @property
    def _settable(self) -> tuple[str, ...]:
        return ("trig",) if self._firmware == "1.0" else ("speed", "sensors", "trig", "pcount")

    def _where(self, command: str) -> int:
        count = len(self._slots)
        self._last = self._persistently(command, lambda: self._number("pos?", command, count))
        return self._last

    def _persistently(self, command: str, work: Callable[[], T]) -> T:
        """The result of work, tried again where something late may have got in between."""
        self._get_ready(command)
        try:
            return work()
        except DeviceError:
            if self._line.cancelled or not self._line.is_open:
                raise
        self._get_ready(command)
        return work()

    def _go(self, command: str, number: int) -> None:
        turning = steps_between(self._last, number, len(self._slots)) * self._step
        self._get_ready(command)
        failure = None
        try:
            self._tell(f"pos={number}", command, turning + _PATIENCE)
        except DeviceError as error:
            if self._line.cancelled or not self._line.is_open:
                raise
            failure = error
        try:
            stands = self._where(command)
        except DeviceError as error:
            raise (error if self._line.cancelled else failure or error) from None
        if stands != number and failure:
            raise failure
        if stands != number:
            raise self._refuse(
                command,
                f"it stands at slot {stands}: it is stuck, or was turned by hand",
                "Switch it off, turn the wheel by hand once, switch it on",
            )

    def _get_ready(self, command: str) -> None:
        """Bring it to its prompt, unless it is there, and check that it is as it should be.

        A wheel that still turns prompts only when it stands.
        """
        if self._line.in_step and not self._line.settle(0.0, _QUIET, command):
            return
        turning = len(self._slots) // 2 * self._step
        late = self._clock.now() + min(turning, self._line.time_left)
        prompts = 0
        while True:
            try:
                self._line.settle(_QUIET, _PATIENCE, command)
                self._line.write(b"\r", command)
                self._line.read_until(_PROMPT, command, _PATIENCE)
                prompts += 1
                self._line.settle(_QUIET, _PATIENCE, command)
                self._check(command)
            except DeviceError:
                # A prompt says that it doesn't turn: more of them change nothing.
                over = prompts >= _PROMPTS or self._clock.now() >= late
                if self._line.cancelled or not self._line.is_open or over:
                    raise
            else:
                self._line.in_step = True
                return

    def _check(self, command: str) -> None:
        """That it is the same wheel, set as wanted."""
        firmware = self._ask_firmware(command)
        if self._firmware not in ("", firmware):
            raise self._line.error(
                command,
                f"another wheel answers: firmware {firmware}, not {self._firmware}",
                "Plug the first one in again, or open the bench again",
            )
        self._firmware = firmware
        if firmware != "1.0":
            count = self._number("pcount?", command, 12)
            if count != len(self._slots):
                raise self._line.error(
                    command,
                    f"the wheel has {count} slots, and slots_nm {len(self._slots)}",
                    "Give slots_nm an entry for every slot, empty ones too",
                )
        for name, value in self._wanted.items():
            if name in self._settable and self._number(f"{name}?", command, 1, 0) != value:
                self._tell(f"{name}={value}", command)
                if self._number(f"{name}?", command, 1, 0) != value:
                    raise self._line.error(command, f"{name} doesn't become {value}")

    def _ask_firmware(self, command: str) -> str:
        """Its version; whether it wants a line before each command is found out, too."""
        try:
            answer = self._agreed("*idn?", command)
        except _UnknownCommand:
            self._primed = not self._primed
            try:
                answer = self._agreed("*idn?", command)
            except DeviceError:
                self._primed = not self._primed
                raise
        found = _IDENTITY.fullmatch(answer)
        if found is None:
            raise self._line.error(
                command, f"{answer!r} is no Thorlabs wheel", "Choose its port by: labapp devices"
            )
        return found[1]

    def _number(self, question: str, command: str, most: int, least: int = 1) -> int:
        answer = self._agreed(question, command)
        if not re.fullmatch("[0-9]{1,2}", answer) or not least <= int(answer) <= most:
            raise self._line.error(command, f"{question} gives {answer!r}, not {least} to {most}")
        return int(answer)

    def _agreed(self, question: str, command: str) -> str:
        """An answer given three times in a row: noise and late answers don't agree."""
        answer, times = self._tell(question, command), 1
        for _ in range(4):
            before, answer = answer, self._tell(question, command)
            times = times + 1 if answer == before else 1
            if times == 3:
                return answer
        raise self._line.error(command, f"{question} gives {answer!r} and others in turn")

    def _tell(self, text: str, command: str, seconds: float = _PATIENCE) -> str:
        """Say something; what comes back before the prompt, but for the echo."""
        if self._primed:
            self._exchange(b">", command, _PATIENCE)
        answer = self._exchange(text.encode(), command, seconds)
        found = re.fullmatch("Command error (.*)", answer)
        if found is None:
            return answer
        reply = _ERRORS.get(found[1].strip(), answer)
        kind = _UnknownCommand if found[1].strip() == "CMD_NOT_DEFINED" else DeviceError
        self._line.in_step = False
        remedy = "Try again; switch the wheel off and on"
        raise kind(self.model, command, f"{text}: {reply}", remedy)

    def _exchange(self, sent: bytes, command: str, seconds: float) -> str:
        self._line.write(sent + b"\r", command)
        came = self._line.read_until(_PROMPT, command, seconds)
        if not came.startswith(sent + b"\r"):
            raise self._line.error(command, f"{sent!r} was echoed as {came[:60]!r}")
        found = _BODY.fullmatch(came[len(sent) + 1 : -len(_PROMPT)])
        if found is None:
            raise self._line.error(command, f"{sent!r} was answered by {came[:60]!r}")
        return (found[1] or b"").decode()


class _UnknownCommand(DeviceError):
    """The wheel says that it doesn't know a command."""
