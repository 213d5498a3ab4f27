"""Commands that a person types, or a script writes, to served instruments until they stop."""

from __future__ import annotations

import math
import os
import select
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from labapp.bench.virtual_bench.instruments import ServedInstrument
from labapp.bench.virtual_bench.shared_world import SharedWorld
from labapp.common.command_end import note_interrupt
from labapp.common.console import handle_stop_signals, print_message
from labapp.common.typed_numbers import parse_number

HELP = """\
target NAME               put a target before the camera
fault NAME KIND [SECONDS] have something go wrong, for good if no seconds are given
mend NAME                 end all faults of an instrument
unplug NAME, plug NAME    pull the plug; put it in again, which ends all faults, too
state                     how the bench stands
help                      this, with the names that there are
quit                      end all instruments"""


class CommandInterpreter:
    """Executes command lines on served instruments; `is_over` is true after "quit"."""

    def __init__(
        self, shared: SharedWorld, targets: list[str], instruments: Mapping[str, ServedInstrument]
    ) -> None:
        self._shared, self._targets = shared, targets
        # Commands can only address instruments that have simulated faults.
        self._instruments = {name: one for name, one in instruments.items() if one.fault_kinds}
        self.is_over = False

    def execute(self, line: str) -> str:
        """Execute a line, and return the answer, which may be empty.

        Raises ValueError, with a message for the user, for a line that isn't understood.
        """
        words = line.split()
        if not words:
            return ""
        match words[0], words[1:]:
            case "quit", []:
                self.is_over = True
                return "ending"
            case "help", []:
                return self._help()
            case "state", []:
                return self._shared.describe_state()
            case "target", [_, *_] as rest:
                self._shared.place(name := " ".join(rest))
                return f"target {name}"
            case "fault", [name, *rest] if rest:
                return self._fail(name, rest)
            case "mend" | "plug" as verb, [name]:
                self._find_instrument(name).clear_faults()
                return f"{name} is {'mended' if verb == 'mend' else 'plugged in'}"
            case "unplug", [name]:
                self._find_instrument(name).inject_fault("disconnect", math.inf)
                return f"{name} is unplugged"
        raise ValueError(f"{line.strip()!r} isn't understood; type help")

    def _fail(self, name: str, rest: list[str]) -> str:
        seconds = math.inf
        if len(rest) > 1:
            with suppress(ValueError):
                seconds, rest = parse_number(rest[-1], "s"), rest[:-1]
        kind = " ".join(rest)
        if not seconds > 0:
            raise ValueError(f"{seconds:g} seconds; they must be more than 0")
        self._find_instrument(name).inject_fault(kind, seconds)
        return f"{name}: {kind}" + (f" for {seconds:g} s" if seconds < math.inf else "")

    def _find_instrument(self, name: str) -> ServedInstrument:
        if name not in self._instruments:
            known = ", ".join(self._instruments) or "none is served"
            raise ValueError(f"there is no instrument {name!r} that can fail; choose {known}")
        return self._instruments[name]

    def _help(self) -> str:
        lines = [HELP, f"targets: {', '.join(self._targets)}"]
        lines += [
            f"faults of {n}: {', '.join(one.fault_kinds)}" for n, one in self._instruments.items()
        ]
        return "\n".join(lines)


@contextmanager
def catch_stop_requests() -> Iterator[Callable[[], bool]]:
    """Yield a function that tells whether a signal has asked to stop.

    A second signal ends the block at once by KeyboardInterrupt.
    """
    asked = False

    def stop(number: int, frame: Any) -> None:
        nonlocal asked
        if number == signal.SIGINT:
            note_interrupt()
        if asked:
            raise KeyboardInterrupt
        asked = True

    with handle_stop_signals(stop):
        yield lambda: asked


def read_commands(
    talk: CommandInterpreter, stop_requested: Callable[[], bool], *, until_eof: bool
) -> None:
    """Execute typed command lines until a stop is requested.

    If `until_eof` is true, the end of standard input stops it as well.
    """
    source = None if sys.stdin is None else sys.stdin.fileno()
    rest = b""
    while not (stop_requested() or talk.is_over):
        waiting = [] if source is None or not _may_read(source) else [source]
        # After 0.2 s without input the loop checks whether it has to stop.
        if not select.select(waiting, [], [], 0.2)[0]:
            continue
        data = os.read(source or 0, 65536)
        *lines, rest = (rest + data).split(b"\n")
        if not data:
            lines, rest, source = [rest], b"", None
        for line in lines:
            if not talk.is_over:
                try:
                    answer = talk.execute(line.decode(errors="replace"))
                except ValueError as error:
                    answer = f"{error}."
                if answer:
                    print_message(answer)
        if source is None and until_eof:
            return


def _may_read(source: int) -> bool:
    """Return whether commands may be read from standard input.

    They may not if the process runs in the background of a terminal: the shell would then stop it
    for reading, and all instruments with it.
    """
    try:
        return os.tcgetpgrp(source) == os.getpgrp()
    except OSError:
        return True  # standard input isn't a terminal
