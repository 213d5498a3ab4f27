"""Serial ports in this process behind pyserial's URL sim://NAME, which wait by the bench's clock.

pyserial finds this module by its name in the packages of `serial.protocol_handler_packages`.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from typing import Any

import serial

from drivers.interfaces import Clock
from simulator.wire.line import SimulatedLine


@dataclass
class _SimPort:
    """A line at its port name; one open port at a time holds it."""

    line: SimulatedLine
    clock: Clock
    held: threading.Lock = field(default_factory=threading.Lock)


_SOCKETS: dict[str, _SimPort] = {}


def plug_in(name: str, line: SimulatedLine, clock: Clock) -> str:
    """Plug a line into the serial port sim://NAME, and return this URL.

    Parameters
    ----------
    name : str
        Name of the port, in upper or lower case. A line that has it already is replaced.
    line : SimulatedLine
        The line to the instrument.
    clock : Clock
        The bench's clock, by which the port waits.

    Returns
    -------
    str
        The URL for pyserial.
    """
    if __package__ not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(__package__)
    _SOCKETS[name.lower()] = _SimPort(line, clock)
    return f"sim://{name}"


def unplug(name: str) -> None:
    """Unplug the line at the serial port sim://NAME; an open port remains usable.

    Parameters
    ----------
    name : str
        Name of the port, in upper or lower case; an unknown name has no effect.
    """
    _SOCKETS.pop(name.lower(), None)


class Serial(serial.SerialBase):  # type: ignore[misc]
    """A pyserial port whose far end is a simulated line of this process."""

    is_open: bool

    def open(self) -> None:
        name = str(self.port).partition("://")[2].lower()
        socket = _SOCKETS.get(name)
        if socket is None:
            raise serial.SerialException(2, f"could not open port {self.port}: no such port")
        if self.is_open:
            raise serial.SerialException("the port is open already")
        if socket.line.is_unplugged(socket.clock.now()):
            raise serial.SerialException(2, f"could not open port {self.port}: it is unplugged")
        if not socket.held.acquire(blocking=False):
            raise serial.SerialException(16, f"could not open port {self.port}: it is in use")
        self._socket = socket
        self._line, self._clock = socket.line, socket.clock
        self._pulls = self._line.unplug_count(self._clock.now())
        self._cancelled, self._held = threading.Event(), bytearray()
        self.is_open = True
        self.reset_input_buffer()

    def close(self) -> None:
        if self.is_open:
            self.is_open = False
            self._socket.held.release()

    def _reconfigure_port(self) -> None:
        """Accept any port settings, since there is nothing to set."""

    def _update_rts_state(self) -> None: ...

    def _update_dtr_state(self) -> None: ...

    def _update_break_state(self) -> None: ...

    def _receive_arrived(self) -> float:
        """Move bytes from the line into the port's buffer, and return the time."""
        if not self.is_open:
            raise serial.PortNotOpenError()
        now = self._clock.now()
        if self._line.is_unplugged(now) or self._line.unplug_count(now) > self._pulls:
            self._line.receive(now)
            raise serial.SerialException(5, f"port {self.port}: the device is disconnected")
        self._held += self._line.receive(now)
        return now

    @property
    def in_waiting(self) -> int:
        self._receive_arrived()
        return len(self._held)

    def read(self, size: int = 1) -> bytes:
        now = self._receive_arrived()
        late = now + (math.inf if self.timeout is None else self.timeout)
        while not (len(self._held) >= size or now >= late or self._cancelled.is_set()):
            then = min(self._line.next_event_time(), self._line.next_unplug_time(now), late)
            if then == math.inf:
                # Another thread may send meanwhile, so the port looks again after 50 ms.
                then = now + 0.05
            self._clock.wait_until(max(then, now), self._cancelled.is_set)
            now = self._receive_arrived()
        taken = bytes(self._held[:size])
        del self._held[:size]
        return taken

    def cancel_read(self) -> None:
        self._cancelled.set()

    def write(self, data: Any) -> int:
        sent = bytes(data)
        self._line.send(sent, self._receive_arrived())
        return len(sent)

    def flush(self) -> None: ...

    def reset_input_buffer(self) -> None:
        self._receive_arrived()
        self._held.clear()

    def reset_output_buffer(self) -> None: ...
