"""A Thorlabs FW102C or FW212C filter wheel behind its serial port.

Sources: Thorlabs' manual of the FW102C/FW212C, chapter 5.2.3, for the commands; the public drivers
of pyLabLib, msl-equipment and Odemis for the observed behaviour of real wheels.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from simulator.machines.machine import FaultyMachine, Reply
from simulator.machines.usb_wheels import shorter_path

_PROMPT = b"> "
_NOT_DEFINED = b"Command error CMD_NOT_DEFINED\r"
_ARG_INVALID = b"Command error CMD_ARG_INVALID\r"

_COMMAND = re.compile(rb"([a-z]+)(?:(\?)|=([0-9]+))")


class ThorlabsWheelMachine(FaultyMachine):
    """Simulate a Thorlabs filter wheel: its commands and its turning.

    slots: 6 or 12. firmware: "1.0", which has fewer commands and needs a line ">" before each, or a
    later one such as "1.07". step: seconds from a slot to the next, slow and fast. on_slot: called
    with every slot that comes into the light.
    """

    own_faults: tuple[str, ...] = ("busy forever", "stuck", "error code")

    def __init__(
        self,
        slots: int = 6,
        firmware: str = "1.07",
        position: int = 1,
        step: tuple[float, float] = (2.0, 1.0),
        on_slot: Callable[[int], None] | None = None,
    ) -> None:
        if slots not in (6, 12):
            raise ValueError(f"slots is {slots}; a wheel has 6 or 12")
        if not 1 <= position <= slots:
            raise ValueError(f"position is {position}; the wheel has 1 to {slots}")
        super().__init__()
        self.firmware, self._old = firmware, firmware == "1.0"
        self._state = {"pos": position, "pcount": slots, "trig": 0, "speed": 1}
        self._state |= {"sensors": 1, "baud": 1}
        self._saved = dict(self._state)
        self._step, self._turned = step, on_slot
        self._switched_on, self._lead_line_received = True, False
        self._line, self._input_buffer = bytearray(), bytearray()
        self._answer: tuple[float, bytes] | None = None
        self._hangs = False
        self._path: list[tuple[float, int]] = []

    @property
    def position(self) -> int:
        """Return the slot that is in the light."""
        return self._state["pos"]

    @property
    def settings(self) -> dict[str, int]:
        """Return the settings: the reply to each query."""
        return dict(self._state)

    @property
    def saved_settings(self) -> dict[str, int]:
        """Return the settings that are kept when the wheel is switched off."""
        return dict(self._saved)

    def feed(self, data: bytes, t: float) -> list[Reply]:
        # 256 bytes wait while the wheel turns; further bytes are lost.
        self._input_buffer += data[: 256 - len(self._input_buffer)]
        replies = self._advance(t)
        while self._input_buffer and self._answer is None:
            byte = bytes(self._input_buffer[:1])
            del self._input_buffer[:1]
            replies.append(Reply(t, byte))
            if byte != b"\r":
                self._line += byte
                continue
            line, self._line = bytes(self._line), bytearray()
            replies += self._begin(line, t)
        return replies

    def _begin(self, line: bytes, t: float) -> list[Reply]:
        """Carry out a command, and return wake-up calls for when the wheel turns and replies."""
        self._path = []
        output = self._command_output(line, t)
        # The reply leaves 2 ms after the command or, if the wheel turns, after its arrival.
        at = (self._path[-1][0] if self._path else t) + 0.002
        self._hangs = bool(self._path) and "busy forever" in self._faults
        if self._path and self._faults & {"stuck", "busy forever"}:
            self._path = []
        self._answer = at, output + _PROMPT
        return [Reply(time, b"") for time, _ in self._path] + [Reply(at, b"")]

    def _advance(self, t: float) -> list[Reply]:
        """Turn to the state at time t, and return the replies due."""
        while self._path and self._path[0][0] <= t:
            self._state["pos"] = self._path.pop(0)[1]
            if self._turned:
                self._turned(self._state["pos"])
        if self._hangs and "busy forever" in self._faults:
            return []
        if self._answer is None or self._answer[0] > t:
            return []
        (_, output), self._answer, self._hangs = self._answer, None, False
        return [Reply(t, output)]

    def _command_output(self, line: bytes, t: float) -> bytes:
        """Return the reply to a command, without the prompt."""
        if self._switched_on:
            self._switched_on = False
            return b"\0\0" + _NOT_DEFINED
        primed, self._lead_line_received = self._lead_line_received, line == b">"
        if not line:
            return b""
        if "error code" in self._faults or (self._old and not primed):
            return _NOT_DEFINED
        if line == b"*idn?":
            return b"THORLABS FW102C/FW212C Filter Wheel version %s\r" % self.firmware.encode()
        if line == b"save":
            self._saved = dict(self._state)
            return b""
        found = _COMMAND.fullmatch(line)
        name = found[1].decode() if found else ""
        unknown = {"pcount", "speed", "sensors"} if self._old else set()
        if not found or name not in set(self._state) - unknown:
            return _NOT_DEFINED
        if found[2]:
            return b"%d\r" % self._state[name]
        return self._set(name, int(found[3]), t)

    def _set(self, name: str, value: int, t: float) -> bytes:
        count = self._state["pcount"]
        legal = {"pos": range(1, count + 1), "pcount": (6, 12)}.get(name, (0, 1))
        if value not in legal:
            return _ARG_INVALID
        if name == "pos":
            way = shorter_path(self.position, value, count)
            seconds = self._step[self._state["speed"]]
            self._path = [(t + i * seconds, slot) for i, slot in enumerate(way, 1)]
        else:
            self._state[name] = value
        if name == "pcount" and self.position > value:
            self._state["pos"] = 1
        return b""
