"""What a VariSpec's commands do, without bytes or time: VariSpec user manual 1.37, table 3.

Wavelengths are in nanometres here, as on the wire.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

PALETTE_SIZE = 128
"""Elements at most."""

NONE_CHOSEN = 255
"""The palette's element while none was chosen."""


class CommandError(Exception):
    """A command that can't be carried out. code: what R ? tells afterwards."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


@dataclass
class VariSpecState:
    """Everything that commands can set.

    shortest, longest: of the optics. on_tuned: is told each wavelength that is set.
    """

    shortest: float
    longest: float
    on_tuned: Callable[[float], None]
    wavelength: float = 0.0
    initialised: bool = False
    exercised: bool = False
    error: int = 0
    brief: int = 0
    sync: int = 1
    mode: int = 0
    jump: float = 5.0
    palette: list[float] = field(default_factory=list)
    element: int = NONE_CHOSEN
    pending: int = 0
    asleep: bool = False

    def tune(self, wavelength: float) -> None:
        if not self.initialised:
            raise CommandError(4)
        if not self.shortest <= wavelength <= self.longest:
            raise CommandError(12)
        self.wavelength = round(wavelength, 2)
        self.on_tuned(self.wavelength)

    def define(self, wavelength: float, element: int | None) -> None:
        """Add to the palette, or replace or (wavelength -1) delete an element of it."""
        if not self.initialised:
            raise CommandError(4)
        count = len(self.palette)
        element = count if element is None else element
        if wavelength == -1:
            if not 0 <= element < count:
                raise CommandError(11)
            del self.palette[element]
            return
        if not self.shortest <= wavelength <= self.longest:
            raise CommandError(12)
        if not 0 <= element <= min(count, PALETTE_SIZE - 1):
            raise CommandError(11)
        self.palette[element : element + 1] = [round(wavelength, 2)]

    def choose(self, element: int) -> None:
        if not self.initialised:
            raise CommandError(4)
        if not self.palette:
            raise CommandError(9)
        if not 0 <= element < len(self.palette):
            raise CommandError(11)
        self.element = element
        self.tune(self.palette[element])

    def choose_next(self, step: int) -> None:
        """The next element of the palette, which has no end, or the one before."""
        if not self.palette:
            raise CommandError(9)
        first = 0 if step > 0 else len(self.palette) - 1
        chosen = self.element != NONE_CHOSEN
        self.choose((self.element + step) % len(self.palette) if chosen else first)

    def pulse(self) -> None:
        """What a pulse at the sync port does."""
        if self.mode == 4:
            self.tune(self.wavelength + self.jump)
        else:
            self.choose_next(1)

    @property
    def status(self) -> int:
        """The bits that @ tells: table 2."""
        bits = (
            self.initialised,
            self.exercised,
            bool(self.palette),
            self.brief != 0,
            False,
            self.error != 0,
            True,
        )
        return sum(1 << place for place, bit in enumerate(bits) if bit)
