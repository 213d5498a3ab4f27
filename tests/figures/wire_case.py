"""What a driver behind a simulated wire is asked, and how its machine is plugged in."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from drivers.interfaces import Clock, Surroundings
from simulator.wire import SimulatedLine, WireFault, plug_in, unplug

Rng = np.random.Generator

_NAMES = itertools.count()


@dataclass(frozen=True)
class Command:
    """Something that a device is asked.

    run: asks it, and gives back its answer. right: whether that answer is the truth about the
    machine. seconds: that are documented for it, where they are more than the reply time.
    """

    run: Callable[[Any, Rng], Any]
    right: Callable[[Any, Any], bool]
    seconds: float = 0.0


@dataclass(frozen=True)
class Cable:
    """A machine that is plugged in.

    address: where a driver finds it. truth: what Command.right is told of the machine.
    """

    address: str
    inject: Callable[[WireFault], None]
    mend: Callable[[], None]
    truth: Any


Plugging = Callable[[Any, Clock, int], AbstractContextManager[Cable]]
"""Plugs a machine in, with the bench's clock and a seed of what is left to chance."""


@dataclass(frozen=True)
class WireCase:
    """A driver and its machine.

    machine: a fresh one, ready for use. device: the driver at an address, not yet open. delay:
    seconds by which late answers are late, more than the driver waits for them. variant: of
    another case with the same driver.
    """

    name: str
    machine: Callable[[], Any]
    plugged: Plugging
    device: Callable[[Surroundings, str], Any]
    commands: dict[str, Command]
    delay: float = 3.0
    variant: bool = False


def serial(baudrate: int) -> Plugging:
    """By a serial line."""

    @contextmanager
    def plugged(machine: Any, clock: Clock, seed: int) -> Iterator[Cable]:
        line = SimulatedLine(machine, baudrate=baudrate, seed=seed)
        name = f"figure-{next(_NAMES)}"
        try:
            yield Cable(plug_in(name, line, clock), line.inject, line.clear_faults, machine)
        finally:
            unplug(name)

    return plugged


@contextmanager
def usb(machine: Any, clock: Clock, seed: int) -> Iterator[Cable]:
    """By a USB bus of its own."""
    # It needs pyusb, which serial machines don't.
    from simulator.wire.usb_backend import UsbBus, register_bus, unregister_bus

    bus = UsbBus(clock, seed)
    plug = bus.plug_in(machine)
    name = f"figure-{next(_NAMES)}"
    try:
        yield Cable(
            register_bus(name, bus), plug.inject, plug.clear_faults, WheelNow(machine, clock)
        )
    finally:
        unregister_bus(name)


@contextmanager
def unheard() -> Iterator[None]:
    """Nobody reads what drivers log of harm that is done to them on purpose, thousandfold."""
    log = logging.getLogger("drivers")
    before = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(before)


class WheelNow:
    """A wheel on a USB bus; such machines know no time of their own."""

    def __init__(self, machine: Any, clock: Clock) -> None:
        self.machine = machine
        self._clock = clock

    @property
    def position(self) -> int:
        """Where it stands; 0 while it turns."""
        at: int = self.machine.wheel.resting_slot(self._clock.now())
        return at

    @property
    def says_it_turns(self) -> bool:
        """Which one that is broken says for ever."""
        return not self.machine.wheel.reported_slot(self._clock.now())
