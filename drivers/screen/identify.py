"""Which screen is which: listed, and written on each."""

from __future__ import annotations

import subprocess
import sys

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.screen.session import connect
from drivers.x11 import XError
from drivers.x11.outputs import Output, outputs

_MODEL = "screens"
_STARTING = 10.0


def screens(display: str | None = None) -> list[Output]:
    """The screens that are lit, in the X server's order; DeviceError if none can be asked."""
    x = connect(_MODEL, display)
    try:
        with x:
            return outputs(x)
    except XError as error:
        remedy = "Look whether the X server is up and has RandR"
        raise DeviceError(_MODEL, "list", str(error), remedy) from error


def identify(display: str | None = None, seconds: float = 5.0) -> list[Output]:
    """Show its number and name on each screen for some seconds, and list the screens."""
    there = screens(display)
    command = [sys.executable, "-m", "drivers.screen", "--seconds", f"{seconds:g}"]
    if display is not None:
        command += ["--display", display]
    try:
        done = subprocess.run(
            command, timeout=seconds + _STARTING, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise _unseen("its windows don't end") from error
    if done.returncode:
        raise _unseen((done.stderr.strip().splitlines() or ["no window came up"])[-1])
    return there


def listed(there: list[Output]) -> str:
    """One line a screen: number, output, size and place, rate, maker, model, serial number."""
    lines = []
    for number, output in enumerate(there, 1):
        monitor = output.monitor
        who = " ".join(filter(None, (monitor.maker, monitor.model, monitor.serial)))
        words = [f"{number}", output.name, f"{output.width}x{output.height}"]
        words += [f"at {output.x},{output.y}", f"{output.refresh:.2f} Hz", who or "no EDID"]
        words += ["primary"] if output.primary else []
        lines.append("  ".join(words))
    return "\n".join(lines)


def show_names(display: str | None, seconds: float) -> None:
    """Put the names up in this process, which Qt's environment is changed for."""
    x = connect(_MODEL, display)
    with x:
        there, name = outputs(x), x.display
    from drivers.screen.plates import show_plates

    show_plates(name, there, RealClock(), seconds)


def _unseen(reply: str) -> DeviceError:
    return DeviceError(_MODEL, "identify", reply, "Look whether Qt's X11 plugin works")
