"""What all filter wheels have in common: slots, choice by wavelength, and routes between slots."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from typing import Self

from drivers.errors import DeviceError
from drivers.interfaces import Setting, Slot, Surroundings
from drivers.option_checks import is_number, require_within


def parse_slots(slots_nm: Sequence[Sequence[float]], names: Sequence[str] = ()) -> tuple[Slot, ...]:
    """Make the slots from the options of a bench file; ValueError for a wrong option.

    slots_nm: centre and full width at half maximum of each slot, in nanometres. names: of each
    slot; by default the centres.
    """
    if isinstance(slots_nm, str) or not isinstance(slots_nm, Sequence) or not slots_nm:
        raise ValueError(f"slots_nm is {slots_nm!r}; give [centre, width] of every slot")
    for number, pair in enumerate(slots_nm, start=1):
        if not isinstance(pair, Sequence) or len(pair) != 2 or not all(map(_is_length, pair)):
            raise ValueError(
                f"slots_nm of slot {number} is {pair!r}; give [centre, width] in nanometres, "
                "both greater than 0"
            )
    if not _are_names(names, len(slots_nm)):
        raise ValueError(
            f"names is {names!r}; give {len(slots_nm)} different names, one a slot, or none"
        )
    said = tuple(names) or tuple(f"{centre:g} nm" for centre, _ in slots_nm)
    return tuple(
        Slot(name, round(centre * 1e3) * 1e-12, width * 1e-9)
        for name, (centre, width) in zip(said, slots_nm, strict=True)
    )


def _is_length(value: object) -> bool:
    return is_number(value) and value > 0


def _are_names(names: Sequence[str], count: int) -> bool:
    if isinstance(names, str) or not isinstance(names, Sequence):
        return False
    if not all(isinstance(name, str) and name for name in names):
        return False
    return len(names) in (0, count) and len(set(names)) == len(names)


def plan_route(
    start: int,
    end: int,
    count: int,
    avoid: Collection[int] = (),
    *,
    max_leg: int = 0,
    forward_only: bool = False,
) -> list[int]:
    """Return the slots at which to stop on the way, the last of them `end`.

    The route is empty if the wheel is at `end` already. A wheel takes the shorter way to each stop;
    between opposite slots its direction is unknown. If a slot of `avoid` lies on the shorter way,
    stops lead the wheel around the other side. avoid: slots that must not cross the light on the
    way; `start` and `end` may be among them. max_leg: largest number of slots in one move, 0 for
    any. forward_only: whether the wheel turns only to higher numbers, and from the last to the
    first. Raises ValueError if every route crosses a slot of `avoid`.
    """
    for name, slot in (("start", start), ("end", end)):
        if not 1 <= slot <= count:
            raise ValueError(f"{name} is slot {slot}; the wheel has 1 to {count}")
    if start == end:
        return []
    ways = [_path_between(start, end, count, 1)]
    if not forward_only:
        ways.append(_path_between(start, end, count, -1))
    free = [way for way in ways if not set(way[:-1]) & set(avoid)]
    if not free:
        crossed = sorted({slot for way in ways for slot in way[:-1]} & set(avoid))
        raise ValueError(f"every way from slot {start} to slot {end} crosses {crossed}")
    way = min(free, key=len)
    # A move to the opposite slot may take either direction, so it is allowed only if both ways
    # are free.
    most = count if forward_only else max((count - 1) // 2, 1)
    if len(free) == len(ways) and not forward_only:
        most = max(most, count // 2)
    most = min(most, max_leg) if max_leg else most
    legs = math.ceil(len(way) / most)
    return [way[math.ceil(len(way) * leg / legs) - 1] for leg in range(1, legs + 1)]


def _path_between(start: int, end: int, count: int, step: int) -> list[int]:
    """Return the slots after `start` up to `end` that are passed one way; step: 1 or -1."""
    steps = (end - start) * step % count
    return [(start - 1 + step * i) % count + 1 for i in range(1, steps + 1)]


def steps_between(start: int, end: int, count: int) -> int:
    """Return the number of steps between two slots on the shorter way."""
    return min((end - start) % count, (start - end) % count)


class SlottedFilter(ABC):
    """Base of spectral filters whose bands are the slots of a wheel."""

    model = ""
    _slots: tuple[Slot, ...]

    @property
    @abstractmethod
    def slot(self) -> int:
        """Slot that stands in the light."""

    @abstractmethod
    def set_slot(self, number: int) -> Setting[int]:
        """Turn to a slot."""

    @property
    def slots(self) -> tuple[Slot, ...]:
        return self._slots

    @property
    def wavelength_range(self) -> tuple[float, float]:
        centres = [slot.wavelength for slot in self._slots]
        return min(centres), max(centres)

    @property
    def bandwidth(self) -> float:
        return self._slots[self.slot - 1].bandwidth

    @property
    def wavelength(self) -> float:
        return self._slots[self.slot - 1].wavelength

    def set_wavelength(self, wavelength: float) -> Setting[float]:
        """Turn to the slot whose centre is within 1 pm of the wavelength."""
        for number, slot in enumerate(self._slots, start=1):
            if abs(slot.wavelength - wavelength) < 1e-12:
                setting = self.set_slot(number)
                return Setting(wavelength, slot.wavelength, setting.ready_at)
        raise self._refuse(
            f"tune to {wavelength * 1e9:.1f} nm",
            "no slot passes it",
            f"Choose one of {', '.join(map(_slot_label, self._slots))}",
        )

    def make_safe(self) -> None:
        """Park at the first slot."""
        self.set_slot(1)

    def _refuse(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self.model, command, reply, remedy)

    def _require_slot(self, number: int, command: str) -> None:
        if not 1 <= number <= len(self._slots):
            raise self._refuse(command, "no such slot", f"Choose 1 to {len(self._slots)}")


class Wheel(SlottedFilter):
    """Base of motorised filter wheels; sub-classes add the communication.

    slots_nm, names: see parse_slots(). avoid: numbers of slots that must not cross the light on
    the way to another one, such as an empty one. step_ms: longest time from a slot to the next.
    settling_ms: time after which a filter that has arrived doesn't shake any more.

    A driver defines `model`, `_read_slot()` and `_turn_to()`; `_query_time`, the seconds that all
    its queries take in addition to the turning; and `_max_leg` and `_forward_only`, see
    plan_route(). A command must end at the time `_deadline` of the bench's clock.
    """

    model = "filter wheel"
    _query_time = 2.0
    _max_leg = 0
    _forward_only = False

    def __init__(
        self,
        surroundings: Surroundings,
        slots_nm: Sequence[Sequence[float]],
        names: Sequence[str] = (),
        avoid: Sequence[int] = (),
        step_ms: float = 2000.0,
        settling_ms: float = 0.0,
    ) -> None:
        self._clock = surroundings.clock
        self._slots = parse_slots(slots_nm, names)
        if not _are_slots(avoid, len(self._slots)):
            raise ValueError(f"avoid is {avoid!r}; give numbers from 1 to {len(self._slots)}")
        if not is_number(step_ms) or not 0 < step_ms <= 60_000:
            raise ValueError(f"step_ms is {step_ms!r}; it must be more than 0 and up to 60000")
        require_within("settling_ms", settling_ms, 0, 60_000)
        self._avoid = frozenset(avoid)
        self._step = step_ms * 1e-3
        self._time_granted, self._deadline = math.inf, math.inf
        self.settling = settling_ms * 1e-3

    @property
    def reply_time(self) -> float:
        """Seconds for the longest turn, with all queries."""
        return self._turning_time

    @property
    def _turning_time(self) -> float:
        count = len(self._slots)
        longest = count - 1 if self._avoid or self._forward_only else count // 2
        return longest * self._step + self._query_time

    @property
    def slot(self) -> int:
        """Slot that is reported now."""
        self._start_deadline()
        return self._read_slot("read the slot")

    def set_slot(self, number: int) -> Setting[int]:
        """Turn to a slot, and wait until it stands there."""
        command = f"turn to slot {number}"
        self._require_slot(number, command)
        self._start_deadline()
        for stop in self._route(command, number):
            self._turn_to(command, stop)
        return Setting(number, number, self._clock.now() + self.settling)

    def _start_deadline(self, seconds: float | None = None) -> None:
        """Set `_deadline` to now plus `seconds`, by default the turning time."""
        self._time_granted = self._turning_time if seconds is None else seconds
        self._deadline = self._clock.now() + self._time_granted

    def _route(self, command: str, number: int) -> list[int]:
        """Plan the route from the present slot to another one."""
        start, count = self._read_slot(command), len(self._slots)
        try:
            return plan_route(
                start,
                number,
                count,
                self._avoid,
                max_leg=self._max_leg,
                forward_only=self._forward_only,
            )
        except ValueError as error:
            raise self._refuse(
                command, str(error), "Choose another slot, or take it out of avoid"
            ) from None

    def _read_slot(self, command: str) -> int:
        """Wait until the wheel stands, and return its slot; DeviceError if it doesn't."""
        raise NotImplementedError

    def _turn_to(self, command: str, number: int) -> None:
        """Turn the shorter way to a slot; DeviceError unless it arrives."""
        raise NotImplementedError

    def _open(self) -> None:
        """Open the connection, or raise DeviceError."""

    def _close(self) -> None:
        """Close the connection."""

    def __enter__(self) -> Self:
        try:
            self._open()
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            self.make_safe()
        except DeviceError:
            # An exception from the with block is more informative than this one.
            if error is None:
                raise
        finally:
            self._close()


def _slot_label(slot: Slot) -> str:
    """Format a slot's centre wavelength, and its name if that's another."""
    centre = f"{slot.wavelength * 1e9:g} nm"
    return centre if slot.name == centre else f"{centre} ({slot.name})"


def _are_slots(numbers: Sequence[int], count: int) -> bool:
    if isinstance(numbers, str) or not isinstance(numbers, Sequence):
        return False
    return all(type(number) is int and 1 <= number <= count for number in numbers)
