"""A VariSpec's state and what commands do to it (user manual 1.37, table 3).

Wavelengths are in nanometres here, as on the wire.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum

NONE_CHOSEN = 255
"""Number that stands for the palette's element while none is chosen."""


class VariSpecErrorCode(IntEnum):
    """Error codes of a VariSpec, as the query `R ?` reports them."""

    SYNTAX = 1
    READ_ONLY = 2
    ILLEGAL_EXERCISES = 3
    NOT_INITIALISED = 4
    ILLEGAL_INITIALISATION = 5
    ILLEGAL_MODE = 7
    NO_DRIVE_LEVELS = 8
    NO_PALETTE = 9
    NO_SUCH_ELEMENT = 11
    WAVELENGTH_OUT_OF_RANGE = 12
    STEP_TOO_LARGE = 14
    ILLEGAL_SYNC = 17


class CommandError(Exception):
    """Raised when a VariSpec can't carry out a command. code: what `R ?` reports afterwards."""

    def __init__(self, code: VariSpecErrorCode) -> None:
        super().__init__(code)
        self.code = code


@dataclass
class VariSpecState:
    """State of a VariSpec that commands can set.

    shortest, longest: wavelengths of the optics. on_tuned: called with each wavelength that is set.
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
            raise CommandError(VariSpecErrorCode.NOT_INITIALISED)
        if not self.shortest <= wavelength <= self.longest:
            raise CommandError(VariSpecErrorCode.WAVELENGTH_OUT_OF_RANGE)
        self.wavelength = round(wavelength, 2)
        self.on_tuned(self.wavelength)

    def define(self, wavelength: float, element: int | None) -> None:
        """Add, replace or delete (wavelength -1) an element of the palette."""
        if not self.initialised:
            raise CommandError(VariSpecErrorCode.NOT_INITIALISED)
        count = len(self.palette)
        element = count if element is None else element
        if wavelength == -1:
            if not 0 <= element < count:
                raise CommandError(VariSpecErrorCode.NO_SUCH_ELEMENT)
            del self.palette[element]
            return
        if not self.shortest <= wavelength <= self.longest:
            raise CommandError(VariSpecErrorCode.WAVELENGTH_OUT_OF_RANGE)
        # The palette holds 128 elements at most.
        if not 0 <= element <= min(count, 127):
            raise CommandError(VariSpecErrorCode.NO_SUCH_ELEMENT)
        self.palette[element : element + 1] = [round(wavelength, 2)]

    def choose(self, element: int) -> None:
        if not self.initialised:
            raise CommandError(VariSpecErrorCode.NOT_INITIALISED)
        if not self.palette:
            raise CommandError(VariSpecErrorCode.NO_PALETTE)
        if not 0 <= element < len(self.palette):
            raise CommandError(VariSpecErrorCode.NO_SUCH_ELEMENT)
        self.element = element
        self.tune(self.palette[element])

    def choose_next(self, step: int) -> None:
        """Choose the next or previous element of the palette, cyclically."""
        if not self.palette:
            raise CommandError(VariSpecErrorCode.NO_PALETTE)
        first = 0 if step > 0 else len(self.palette) - 1
        chosen = self.element != NONE_CHOSEN
        self.choose((self.element + step) % len(self.palette) if chosen else first)

    def pulse(self) -> None:
        """Carry out the effect of a pulse at the sync port."""
        if self.mode == 4:
            self.tune(self.wavelength + self.jump)
        else:
            self.choose_next(1)

    @property
    def status(self) -> int:
        """Return the status bits, the reply to `@` (table 2 of the manual)."""
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
