"""The turning of filter wheels from slot to slot."""

from __future__ import annotations

from collections.abc import Callable


class TurningWheel:
    """Simulate a filter wheel of `count` slots that needs `step` seconds per slot.

    both_ways: whether the wheel takes the shorter way; otherwise it turns forward only. on_slot:
    called with every slot that comes into the light. Times never decrease from call to call.
    """

    def __init__(
        self,
        count: int,
        position: int = 1,
        step: float = 0.5,
        both_ways: bool = True,
        on_slot: Callable[[int], None] | None = None,
    ) -> None:
        if count < 1 or not 1 <= position <= count:
            raise ValueError(f"position is {position} of {count}; count from 1")
        if not step > 0:
            raise ValueError(f"step is {step}; it must be greater than 0")
        self.count, self.step, self.both_ways = count, step, both_ways
        self.stuck = self.never_arrives = False
        self._turned = on_slot or (lambda slot: None)
        self._at, self.target = position, position
        self._way: list[int] = []
        self._since = 0.0

    def turn_to(self, slot: int, t: float) -> None:
        """Begin to turn to a slot; a wheel that is turning goes on from its present slot."""
        self.turn_through(shorter_path(self.slot_at(t), slot, self.count, self.both_ways), t)

    def turn_through(self, way: list[int], t: float) -> None:
        """Begin to turn through a list of slots."""
        if self.stuck:
            return
        self._way, self._since = way, t
        self.target = way[-1] if way else self._at

    def jump_to(self, slot: int, t: float) -> None:
        """Put the wheel at a slot without turning."""
        self._way, self._since, self._at, self.target = [], t, slot, slot
        self._turned(slot)

    def slot_at(self, t: float) -> int:
        """Return the slot that is in the light, or was the last to be."""
        while self._way and not self.stuck and t >= self._since + self.step:
            self._since += self.step
            self._at = self._way.pop(0)
            self._turned(self._at)
        return self._at

    def resting_slot(self, t: float) -> int:
        """Return the slot at which the wheel really stands; 0 while it turns."""
        at = self.slot_at(t)
        return 0 if self._way and not self.stuck else at

    def reported_slot(self, t: float) -> int:
        """Return the slot that the wheel reports; 0 if it says that it turns."""
        at = self.resting_slot(t)
        return 0 if self.never_arrives else at


def shorter_path(start: int, end: int, count: int, both_ways: bool = True) -> list[int]:
    """Return the slots that a wheel passes on its shorter way.

    The wheel turns forward if both ways are equally long, or if `both_ways` is false.
    """
    ahead = (end - start) % count
    back = count - ahead
    steps, sign = (ahead, 1) if not both_ways or ahead <= back else (back, -1)
    return [(start - 1 + sign * i) % count + 1 for i in range(1, steps + 1)]
