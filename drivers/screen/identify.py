"""List the screens, and show a label with its name on each, to find the SLM's."""

from __future__ import annotations

import subprocess
import sys

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.screen.session import connect_display
from drivers.x11 import XError
from drivers.x11.outputs import Output, list_outputs

_MODEL = "screens"


def list_screens(display: str | None = None) -> list[Output]:
    """List the lit screens in the X server's order.

    Parameters
    ----------
    display : str, optional
        The X server, as in DISPLAY; this session's if left out.

    Returns
    -------
    list of Output
        Name, monitor, position, size and refresh rate of each screen.

    Raises
    ------
    DeviceError
        If no X server answers, or it lacks the RandR extension.
    """
    x = connect_display(_MODEL, display)
    try:
        with x:
            return list_outputs(x)
    except XError as error:
        remedy = "Look whether the X server is up and has RandR"
        raise DeviceError(_MODEL, "list", str(error), remedy) from error


def identify_screens(display: str | None = None, seconds: float = 5.0) -> list[Output]:
    """List the screens, and label each with its number and name, to find the SLM's.

    Parameters
    ----------
    display : str, optional
        The X server, as in DISPLAY; this session's if left out.
    seconds : float
        Seconds for which the labels are shown.

    Returns
    -------
    list of Output
        The screens in the order of their numbers.

    Raises
    ------
    DeviceError
        If no X server answers, or the labels couldn't be shown.
    """
    there = list_screens(display)
    command = [sys.executable, "-m", "drivers.screen", "--seconds", f"{seconds:g}"]
    if display is not None:
        command += ["--display", display]
    try:
        # The child process has 10 s to start and end besides.
        done = subprocess.run(
            command, timeout=seconds + 10.0, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise _identify_error("its windows don't end") from error
    if done.returncode:
        raise _identify_error((done.stderr.strip().splitlines() or ["no window came up"])[-1])
    return there


def format_listing(outputs: list[Output]) -> str:
    """Format one numbered line for each output.

    A line gives the screen's number, output, size, position, refresh rate and monitor.
    """
    lines = []
    for number, output in enumerate(outputs, 1):
        monitor = output.monitor
        who = " ".join(filter(None, (monitor.maker, monitor.model, monitor.serial)))
        words = [f"{number}", output.name, f"{output.width}x{output.height}"]
        words += [f"at {output.x},{output.y}", f"{output.refresh:.2f} Hz", who or "no EDID"]
        words += ["primary"] if output.primary else []
        lines.append("  ".join(words))
    return "\n".join(lines)


def show_names(display: str | None, seconds: float) -> None:
    """Show the labels everywhere; this process's environment is changed.

    Qt needs other environment variables to draw pixel for pixel.
    """
    x = connect_display(_MODEL, display)
    with x:
        there, name = list_outputs(x), x.display
    from drivers.screen.screen_labels import show_labels

    show_labels(name, there, RealClock(), seconds)


def _identify_error(reply: str) -> DeviceError:
    return DeviceError(_MODEL, "identify", reply, "Look whether Qt's X11 plugin works")
