"""Scripted faults of devices: which device fails, at which frame, and how."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

from drivers.errors import DeviceError
from drivers.interfaces import Clock

Role = Literal["slm", "filter", "camera", "targets"]

FrameKind = Literal["late frame", "dropped frame", "stale frame", "wrong exposure", "corrupt frame"]

Kind = Literal["error", "silence", "slow", "hung", "disconnect", FrameKind]

FRAME_KINDS: tuple[Kind, ...] = get_args(FrameKind)
"""Kinds of faults that affect a camera's frame; no other device has them."""


@dataclass(frozen=True)
class Fault:
    """One fault in a script.

    device: the device's role. frame: index of the planned frame from which on it can occur, at the
    device's next call. times: number of calls that fail. seconds: of bench time by which a slow
    call takes longer, or for which a device stays disconnected.
    """

    device: Role
    kind: Kind
    frame: int = 0
    times: int = 1
    seconds: float = 1.0

    def __post_init__(self) -> None:
        if self.device not in get_args(Role):
            raise ValueError(f"device is {self.device!r}; choose {', '.join(get_args(Role))}")
        if self.kind not in get_args(Kind):
            raise ValueError(f"kind is {self.kind!r}; choose {', '.join(get_args(Kind))}")
        if self.kind in FRAME_KINDS and self.device != "camera":
            raise ValueError(
                f"kind is {self.kind!r} for the {self.device}; only the camera has frames"
            )
        if self.frame < 0 or self.times < 1:
            raise ValueError(
                f"frame is {self.frame} and times {self.times}; "
                "frame counts from 0, and a fault strikes once at least"
            )
        if not 0 <= self.seconds < math.inf:
            raise ValueError(f"seconds is {self.seconds:g}; it must be finite and not negative")


class FaultScript:
    """The faults that have still to occur, and the devices that are disconnected now."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self.script = tuple(faults)
        self._left = [fault.times for fault in self.script]
        self.away_until: dict[str, float] = {}
        """Until when, by the bench's clock, the device of a role is disconnected."""
        self.frame = 0
        """Index of the planned frame that the bench takes now."""

    def take_fault(self, role: str, frame: bool) -> Fault | None:
        """Return the fault that occurs in a device's call, or None.

        frame: whether the call asks a camera for a frame.
        """
        for number, fault in enumerate(self.script):
            fits = fault.device == role and (frame or fault.kind not in FRAME_KINDS)
            if fits and self._left[number] and self.frame >= fault.frame:
                self._left[number] -= 1
                return fault
        return None

    def put_off(self, fault: Fault) -> None:
        """Put off to the next call a fault that can't occur in the present one."""
        self._left[next(n for n, one in enumerate(self.script) if one is fault)] += 1

    @property
    def is_unused(self) -> bool:
        """Return whether no fault has occurred yet."""
        return self._left == [fault.times for fault in self.script]


class FaultInjector:
    """Cause the scripted faults of one opened device.

    Each call takes its fault when it begins, so that a call fails before it has changed anything.
    """

    def __init__(self, script: FaultScript, role: str, model: str, clock: Clock) -> None:
        self._script, self._role, self._model, self._clock = script, role, model, clock
        self._killed = threading.Event()
        self._unplugged = False

    def require_plugged(self) -> None:
        """Raise DeviceError if the device to open is unplugged."""
        if self._clock.now() < self._script.away_until.get(self._role, -math.inf):
            raise self._error("open", "there is no such device", "Plug it in")

    def begin(self, command: str, reply_time: float, *, frame: bool = False) -> Fault | None:
        """Cause the fault that the script has for a call, if it has one.

        Returns the fault if the call goes on in spite of it. Raises DeviceError if the call fails.
        """
        self.require_alive(command)
        if self._unplugged:
            raise self._error(command, "the device is disconnected", "Plug it in")
        fault = self._script.take_fault(self._role, frame)
        if fault is None or fault.kind in FRAME_KINDS:
            return fault
        now = self._clock.now()
        if fault.kind == "slow":
            self._clock.wait_until(now + fault.seconds, self._killed.is_set)
            self.require_alive(command)
            return fault
        if fault.kind == "disconnect":
            self._unplugged = True
            self._script.away_until[self._role] = now + fault.seconds
            raise self._error(command, "the device was disconnected", "Plug it in")
        if fault.kind == "hung":
            self._killed.wait()
            self.require_alive(command)
        if fault.kind == "silence":
            self._clock.wait_until(now + reply_time, self._killed.is_set)
            self.require_alive(command)
            raise self._error(command, f"no reply within {reply_time:g} s", "Check the cable")
        raise self._error(command, "the device answers ERROR", "Switch it off and on")

    def kill(self) -> None:
        """Mark the device as killed, and end a hanging call."""
        self._killed.set()

    @property
    def is_killed(self) -> bool:
        """Return whether the device was killed."""
        return self._killed.is_set()

    def require_alive(self, command: str) -> None:
        """Raise DeviceError if the device was killed; nothing waits for its reply any more."""
        if self.is_killed:
            raise self._error(command, "the device was killed", "Open it again")

    def _error(self, command: str, reply: str, remedy: str) -> DeviceError:
        """Return the DeviceError that a fault raises."""
        return DeviceError(self._model, command, reply, remedy)
