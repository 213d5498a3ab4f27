"""Drivers behind a wire: every command, every fault at random moments, no lie and no hang."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from figures import Figure
from figures.serial_cases import SERIAL_CASES
from figures.usb_cases import USB_CASES
from figures.wire_case import Cable, Command, Rng, WireCase, unheard
from labapp.common.console import print_message
from simulator.clock import VirtualClock
from simulator.wire import WIRE_FAULT_KINDS, WireFault

_MOMENTS = 20

_MARGIN = 1.0
"""Seconds beyond the documented time."""


@dataclass(frozen=True)
class Suffered:
    """How a command with a fault ended. wrong: what isn't as it must be, empty if all is."""

    case: str
    command: str
    fault: WireFault
    failed: bool
    wrong: str


_SERIAL = "serial driver: every command, every fault, 20 random moments"
_USB = "USB wheels: every command, every fault, 20 random moments"


def serial_fault_figure(folder: Path) -> list[Figure]:
    """Each serial driver with each fault during each of its commands, at random moments."""
    with unheard():
        return _figures(_SERIAL, SERIAL_CASES)


def usb_fault_figure(folder: Path) -> list[Figure]:
    """Each driver of a USB wheel, likewise."""
    with unheard():
        return _figures(_USB, USB_CASES)


def _figures(name: str, cases: Iterable[WireCase]) -> list[Figure]:
    figures = []
    for case in cases:
        found = []
        for kind in kinds(case):
            print_message(f"  {case.name}: {kind}")
            found += list(suffer(case, kind, _MOMENTS))
        wrong = [f"{one.command}, {one.fault}: {one.wrong}" for one in found if one.wrong]
        failed = sum(one.failed for one in found)
        measured = (
            f"{len(found) - len(wrong)} of {len(found)} right: {len(found) - failed} answered "
            f"truly, {failed} DeviceErrors in time, the next command worked"
        )
        figures.append(
            Figure(
                f"{name}: {case.name}",
                "truth or a DeviceError in time; the next command works",
                measured + (f"; first trouble: {wrong[0]}" if wrong else ""),
                not wrong,
            )
        )
    return figures


def kinds(case: WireCase) -> tuple[str, ...]:
    """All that can go wrong with a case."""
    return (*WIRE_FAULT_KINDS, *case.machine().own_faults)


def suffer(case: WireCase, kind: str, moments: int, seed: int = 0) -> Iterator[Suffered]:
    """A fault of one kind during each command."""
    for number, name in enumerate(case.commands):
        for moment in range(moments):
            words = [seed, kinds(case).index(kind), number, moment]
            yield suffer_once(case, kind, name, np.random.default_rng(words))


def suffer_once(case: WireCase, kind: str, name: str, rng: Rng) -> Suffered:
    """One command with one fault that begins before it or during it."""
    command = case.commands[name]
    usual = _Trial(case, rng).run(name, command, None)[0]
    trial = _Trial(case, rng)
    begins = float(rng.choice([0.0, rng.uniform(0.0, usual)]))
    lasts = float(rng.choice([np.inf, rng.uniform(0.0, 1.5)]))
    fault = WireFault(kind, begins, lasts, delay=case.delay)
    _, failed, wrong = trial.run(name, command, fault)
    return Suffered(case.name, name, fault, failed, wrong)


class _Trial:
    """A fresh machine on its wire, and its driver; open but where opening is what is tried."""

    def __init__(self, case: WireCase, rng: Rng) -> None:
        self._case, self._rng = case, rng
        self._clock = VirtualClock()
        self._seed = int(rng.integers(2**31))

    def run(self, name: str, command: Command, fault: WireFault | None) -> tuple[float, bool, str]:
        """Seconds that it took, whether it failed, and what was wrong with that."""
        with self._case.plugged(self._case.machine(), self._clock, self._seed) as cable:
            self._cable: Cable = cable
            device = self._case.device(Surroundings(self._clock), cable.address)
            try:
                if name != "open":
                    device.__enter__()
                return self._try(device, name, command, fault)
            finally:
                cable.mend()
                device.__exit__(None, None, None)

    def _try(
        self, device: Any, name: str, command: Command, fault: WireFault | None
    ) -> tuple[float, bool, str]:
        began = self._clock.now()
        if fault is not None:
            from_now = began + fault.at
            self._cable.inject(WireFault(fault.kind, from_now, fault.seconds, delay=fault.delay))
        wrong = self._ask(device, command)
        took = self._clock.now() - began
        late = max(command.seconds, device.reply_time) + _MARGIN
        if took > late:
            return took, False, f"took {took:.2f} s instead of {late:.2f}"
        if fault is None or wrong not in ("", "DeviceError"):
            return took, wrong != "", wrong
        failed = wrong == "DeviceError"
        self._cable.mend()
        if name == "open" and not failed:
            device.__exit__(None, None, None)
        after = self._ask(device, command)
        return took, failed, after and f"the next command: {after} {self._said}"

    def _ask(self, device: Any, command: Command) -> str:
        """What is wrong with the answer; a DeviceError is told as just that."""
        self._said = ""
        try:
            told = command.run(device, self._rng)
        except DeviceError as error:
            self._said = str(error)
            return "DeviceError"
        except Exception as error:
            return f"{type(error).__name__}: {error}"
        return "" if command.right(told, self._cable.truth) else f"{told} isn't true"


MEASUREMENTS = {"wire": serial_fault_figure, "usb": usb_fault_figure}
