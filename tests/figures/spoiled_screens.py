"""A panel's screen whose card somebody else sets wrong, before a run or during one."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from small_bench.files import SMALL
from small_bench.setups import small_setup

from drivers.x11 import XConnection
from drivers.x11.outputs import list_outputs
from figures.card_drivers import ANY_DRIVER, Property, card_driver
from figures.connector_properties import Connector, Value, connector
from labapp.bench.opening import BenchSetup
from labapp.files.bench_file import DeviceTable
from simulator.screens import XServer

OUTPUT = "DUMMY1"

_GAMMAS = ("1:.8:.6", "1:1:.9", ".9:.9:.9", "1:1.1:1")
_ROWS, _COLUMNS = SMALL.panel
_PARTS = ((72, 128), (90, 160))
"""Rows and columns of modes that are smaller than the panel: a part of its picture is seen."""


@dataclass(frozen=True)
class Spoiling:
    """Something that alters what a panel shows. word: one that must be said. is_settable: whether
    labapp may set it right by itself."""

    word: str
    apply: Callable[[], object]
    undo: Callable[[], object]
    is_settable: bool


class Desk:
    """A card's connector as its driver presents it, at sound values that are drawn by chance."""

    def __init__(
        self, server: XServer, made: Connector, driver: str, rng: np.random.Generator
    ) -> None:
        self.server, self._made, self._rng = server, made, rng
        self.properties = card_driver(driver, rng)
        for one in (*self.properties, *ANY_DRIVER):
            made.make(one.name, one.valid, self._sound(one), is_range=one.is_range)

    def spoil(self, kind: str) -> Spoiling:
        """One that is drawn by chance, of a kind: property, ramp, or panning."""
        if kind == "ramp":
            gamma = self._rng.choice(_GAMMAS)
            return Spoiling("gamma ramp", lambda: self._set(f"--gamma {gamma}"), self._plain, False)
        if kind == "panning":
            rows, columns = _PARTS[self._rng.integers(len(_PARTS))]
            words = f"--mode {columns}x{rows} --panning {_COLUMNS}x{_ROWS}+1280+0"
            return Spoiling("panning", lambda: self._set(words), self._whole, False)
        able = [one for one in self.properties if one.altering]
        one = able[self._rng.integers(len(able))]
        value, sound = self._draw(one.altering), self._sound(one)
        return Spoiling(
            one.name,
            lambda: self._made.set(one.name, value),
            lambda: self._made.set(one.name, sound),
            True,
        )

    def touch_something_else(self) -> None:
        """Set what has nothing to do with levels, or to the value that it has."""
        one = ANY_DRIVER[self._rng.integers(len(ANY_DRIVER))]
        self._made.set(one.name, self._sound(one))

    def altered(self) -> list[str]:
        """The properties that alter levels now, as xrandr tells them."""
        told = properties_of(self.server)
        return [
            one.name
            for one in self.properties
            if one.altering and told[one.name] not in map(_as_told, one.sound)
        ]

    def _sound(self, one: Property) -> Value:
        if one.sound:
            return self._draw(one.sound)
        drawn = one.valid[self._rng.integers(len(one.valid))]
        return drawn if isinstance(drawn, str) else (drawn,)

    def _draw(self, values: tuple[Value, ...]) -> Value:
        return values[self._rng.integers(len(values))]

    def _set(self, words: str) -> None:
        self.server.xrandr(f"--output {OUTPUT} {words}")

    def _plain(self) -> None:
        self._set("--gamma 1:1:1")

    def _whole(self) -> None:
        self._set(f"--panning 0x0 --mode {_COLUMNS}x{_ROWS} --pos 1280x0")


def add_panel(server: XServer) -> None:
    """Give the second screen of a bench's X server the small panel's size."""
    for rows, columns in (SMALL.panel, *_PARTS):
        across, down = columns + 40, rows + 10
        timing = (
            f"{columns} {columns + 8} {columns + 16} {across} {rows} {rows + 2} {rows + 4} {down}"
        )
        name = f"{columns}x{rows}"
        server.xrandr(f"--newmode {name} {60 * across * down / 1e6} {timing}")
        server.xrandr(f"--addmode {OUTPUT} {name}")
    server.xrandr(f"--output {OUTPUT} --mode {_COLUMNS}x{_ROWS} --pos 1280x0")


@contextmanager
def desk(server: XServer, driver: str, rng: np.random.Generator) -> Iterator[Desk]:
    """A desk whose connector is as before when the block ends."""
    with XConnection(server.display) as x:
        number = next(one.number for one in list_outputs(x) if one.name == OUTPUT)
    with connector(server.display, number) as made:
        yield Desk(server, made, driver, rng)


def properties_of(server: XServer) -> dict[str, str]:
    """The properties of the panel's connector as xrandr tells them."""
    whole = server.xrandr("--prop").split(f"\n{OUTPUT} ")[1].split("\nDUMMY2 ")[0]
    found, name = dict[str, str](), ""
    for line in whole.split("\n")[1:]:
        if line.startswith("\t\t"):
            # A long list goes on in the next line; what a property takes is told there, too.
            found[name] += "" if ":" in line else f" {line.strip()}"
        elif line.startswith("\t"):
            name, _, value = line.strip().partition(": ")
            found[name] = value.strip()
    return found


def _as_told(value: Value) -> str:
    return value if isinstance(value, str) else " ".join(map(str, value))


def setup_on(server: XServer) -> BenchSetup:
    """The small bench, whose panel is the server's second screen."""
    setup = small_setup(reply_s=30.0)
    options = {
        "screen": OUTPUT,
        "width": _COLUMNS,
        "height": _ROWS,
        "display": server.display,
        "settling_ms": 20.0,
    }
    table = DeviceTable(driver="screen-slm", options=options, simulated=True)
    devices = setup.bench.devices.model_copy(update={"slm": table})
    return replace(setup, bench=setup.bench.model_copy(update={"devices": devices}))


class Ear(logging.Handler):
    """Warnings of the application and its drivers, with the time by time.monotonic()."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.heard: list[tuple[float, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.heard.append((time.monotonic(), record.getMessage()))

    def named(self, word: str, since: float, until: float) -> bool:
        return any(word in words for at, words in self.heard if since <= at <= until)


@contextmanager
def listening() -> Iterator[Ear]:
    ear, loggers = Ear(), [logging.getLogger(room) for room in ("labapp", "drivers")]
    for logger in loggers:
        logger.addHandler(ear)
    try:
        yield ear
    finally:
        for logger in loggers:
            logger.removeHandler(ear)
