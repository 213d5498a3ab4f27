"""Check the options before the filter is opened."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from drivers.option_checks import require_within
from drivers.varispec.protocol import PALETTE_SIZE

RECALIBRATE = ("if needed", "correct", "always")


@dataclass(frozen=True)
class VariSpecOptions:
    """The options of VariSpec, which explains them; ValueError for an invalid one."""

    port: str
    baudrate: int
    settling_ms: float
    bandwidth_nm: float
    recalibrate: str
    exercise: bool
    palette_nm: tuple[float, ...]
    serial: str
    terminator: str

    def __post_init__(self) -> None:
        if not isinstance(self.port, str) or not self.port.strip():
            raise ValueError(f'port is {self.port!r}; name a port, "/dev/ttyUSB0" for example')
        _require_one_of("baudrate", self.baudrate, (9600, 19200, 115200))
        require_within("settling_ms", self.settling_ms, 0, 10_000)
        require_within("bandwidth_nm", self.bandwidth_nm, 0.01, 200)
        _require_one_of("recalibrate", self.recalibrate, RECALIBRATE)
        _require_one_of("exercise", self.exercise, (False, True))
        if len(self.palette_nm) > PALETTE_SIZE:
            raise ValueError(f"palette_nm has {len(self.palette_nm)} elements; 128 are most")
        for wavelength in self.palette_nm:
            require_within("palette_nm's element", wavelength, 100, 9999)
        if not isinstance(self.serial, str) or not re.fullmatch(r"[0-9]{0,5}", self.serial):
            raise ValueError(f'serial is {self.serial!r}; give its five digits, as "50527"')
        _require_one_of("terminator", self.terminator, ("\r", "\n"))


def as_tuple(name: str, values: Any) -> tuple[Any, ...]:
    """Convert an option from a list to a tuple; ValueError if it isn't a list."""
    if isinstance(values, (str, bytes)) or not isinstance(values, Sequence):
        raise ValueError(f"{name} is {values!r}; give a list of numbers")
    return tuple(values)


def _require_one_of(name: str, value: Any, choices: Sequence[Any]) -> None:
    """Raise ValueError unless an option has one of the allowed values."""
    if not isinstance(value, type(choices[0])) or value not in choices:
        raise ValueError(f"{name} is {value!r}; choose one of {', '.join(map(repr, choices))}")
