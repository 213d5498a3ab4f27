"""Serial drivers whose instruments answer nonsense: no hang, no crash, no wrong value."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from figures import Figure
from figures.fuzzed_machine import FuzzedMachine
from figures.serial_cases import SERIAL_CASES
from figures.wire_case import Rng, WireCase, unheard
from labapp.common.console import print_message
from simulator.clock import VirtualClock

_REPLIES = 100_000

_TOLD = 10_000
"""After so many more it is said how far it got."""

_COMMANDS = 40
"""With one driver, until a fresh one is opened."""


_NAME = "serial driver: 100 000 changed answers"


def fuzz_figure(folder: Path) -> list[Figure]:
    """Answers and echoes changed by chance, until 100 000 were, for each serial driver."""
    with unheard():
        return [_figure(case) for case in SERIAL_CASES if not case.variant]


def _figure(case: WireCase) -> Figure:
    changed = true = failed = told = 0
    wrong: list[str] = []
    for seed in range(_REPLIES):
        for count, ended in fuzz(case, seed):
            changed += count
            true += ended == ""
            failed += ended == "DeviceError"
            if ended not in ("", "DeviceError"):
                wrong.append(ended)
        if changed >= told + _TOLD:
            told = changed
            print_message(f"  {case.name}: {changed} changed")
        if changed >= _REPLIES:
            break
    measured = (
        f"{changed} changed: {true} commands answered truly, {failed} DeviceErrors, "
        f"{len(wrong)} others"
    )
    return Figure(
        f"{_NAME}: {case.name}",
        "no hang, no crash, no wrong value",
        measured + (f"; first: {wrong[0]}" if wrong else ""),
        not wrong,
    )


def fuzz(case: WireCase, seed: int) -> Iterator[tuple[int, str]]:
    """Some commands to a driver: the answers that were changed, and how each command ended.

    It ends with "" if the answer was the truth, with "DeviceError", or with what was wrong.
    """
    rng = np.random.default_rng([seed, 77])
    clock = VirtualClock()
    machine = FuzzedMachine(case.machine(), rng, 0.0)
    # Often few answers are changed, so that commands get far; sometimes nearly all.
    share = float(10 ** rng.uniform(-2.0, -0.05))
    names = [name for name in case.commands if name != "open"]
    with case.plugged(machine, clock, seed) as cable:
        device = case.device(Surroundings(clock), cable.address)
        try:
            device.__enter__()
            machine.share = share
            for _ in range(_COMMANDS):
                name = names[int(rng.integers(len(names)))]
                before, began = machine.changed, clock.now()
                ended = _ask(case, name, device, machine, rng)
                limit = max(device.reply_time, case.commands[name].seconds) + 1.0
                if clock.now() - began > limit:
                    ended = f"{name} took {clock.now() - began:.2f} s"
                yield machine.changed - before, ended
        finally:
            machine.share = 0.0
            device.__exit__(None, None, None)


def _ask(case: WireCase, name: str, device: object, machine: FuzzedMachine, rng: Rng) -> str:
    command = case.commands[name]
    try:
        told = command.run(device, rng)
    except DeviceError:
        return "DeviceError"
    except Exception as error:
        return f"{name}: {type(error).__name__}: {error}"
    return "" if command.right(told, machine.machine) else f"{name}: {told} isn't true"


MEASUREMENTS = {"fuzz": fuzz_figure}
