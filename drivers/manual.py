"""Targets that a person places by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from drivers.errors import DeviceError
from drivers.interfaces import Identity, Setting, Surroundings


class ManualTargets:
    """Target changer without a motor: the runner of a plan asks a person to place each target.

    `current_target` is the one that a person has confirmed, and empty before the first.

    names: of the targets. settling_ms: time until the bench is still after the person's touch.
    """

    by_hand = True
    reply_time = 0.5

    def __init__(
        self, surroundings: Surroundings, names: Sequence[str], settling_ms: float = 500.0
    ) -> None:
        if isinstance(names, str) or not names or not all(isinstance(n, str) for n in names):
            raise ValueError(f"names is {names!r}; give a list of one name or more")
        if not 0 <= settling_ms <= 1e6:
            raise ValueError(f"settling_ms is {settling_ms}; it must be from 0 to 1000000")
        self._clock = surroundings.clock
        self.names = tuple(names)
        self.current_target = ""
        self.settling = settling_ms * 1e-3

    @property
    def identity(self) -> Identity:
        return Identity("targets placed by hand", "", simulated=False)

    def place(self, name: str) -> Setting[str]:
        if name not in self.names:
            raise DeviceError(
                self.identity.model,
                f"place {name}",
                "no such target",
                f"Choose one of {', '.join(self.names)}",
            )
        self.current_target = name
        return Setting(name, name, self._clock.now() + self.settling)

    def make_safe(self) -> None:
        """Do nothing, because a target that was placed by hand is always safe."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Do nothing: there is no device to close."""
