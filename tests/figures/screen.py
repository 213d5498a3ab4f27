"""Whether a panel's screen shows every grey level as it was given, whatever scales the desktop."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from drivers.screen import ScreenSLM
from drivers.x11 import XError
from figures import Figure
from simulator.screens import NEIGHBOUR, PANEL, NoXServer, XServer, require_program, xorg

SCALES = (1.0, 1.25, 1.5, 1.75, 2.0)

TROUBLES = (OSError, subprocess.SubprocessError, DeviceError, XError)
"""What may come of a server or a tool that isn't there, or isn't well."""

_PICTURES = 3
_MANAGER = "openbox"
_PATIENCE = 30.0
_WALLPAPER = ("-mod", "5", "3", "-fg", "#c83264", "-bg", "#1e90ff")
"""Something that isn't black, so that it can be told whether anything was drawn on it."""


@dataclass
class Compared:
    """Pixels of the panel and of its neighbour: compared, and how many of them differed."""

    panel: int = 0
    wrong: int = 0
    neighbour: int = 0
    touched: int = 0


def screen_figure(folder: Path) -> list[Figure]:
    """Random noise at five scales of the desktop, with a window manager and without."""
    name = "SLM's screen read back by xwd, noise, desktop scaled by 1 to 2, neighbour beside it"
    goal = "every pixel equal, neighbour untouched"
    found = Compared()
    rng = np.random.default_rng(0)
    try:
        require_tools()
        with xorg(folder) as server:
            for scale in SCALES:
                for manager in (True, False):
                    compare(server, found, rng, scale, manager=manager, pictures=_PICTURES)
    except TROUBLES as error:
        return [Figure(name, goal, f"not measured: {error}", None)]
    measured = (
        f"{found.wrong} of {found.panel / 1e6:.1f} million pixels differ; "
        f"{found.touched} of the neighbour's {found.neighbour / 1e6:.1f} million"
    )
    return [Figure(name, goal, measured, not found.wrong and not found.touched)]


def require_tools() -> None:
    """NoXServer if something to scale and to manage a desktop isn't installed."""
    for tool, package in (
        ("xrdb", "x11-xserver-utils"),
        ("xsetroot", "x11-xserver-utils"),
        ("xprop", "x11-utils"),
        (_MANAGER, "openbox"),
    ):
        require_program(tool, package)


def compare(
    server: XServer,
    found: Compared,
    rng: np.random.Generator,
    scale: float,
    *,
    manager: bool,
    pictures: int,
) -> None:
    """Show pictures of noise on a desktop that is scaled, and add to what was found.

    The neighbour must stay as it was, before the panel opened and after it closed.
    """
    with _desktop(server, scale, manager=manager):
        before = server.pixels()[NEIGHBOUR]
        with ScreenSLM(Surroundings(RealClock()), display=server.display) as slm:
            for _ in range(pictures):
                grey = rng.integers(0, 256, slm.shape, np.uint8)
                slm.show("noise", grey)
                seen = server.pixels()
                found.panel += grey.size
                found.wrong += _differ(seen[PANEL], grey[..., None])
                _add_neighbour(found, seen, before)
        _add_neighbour(found, server.pixels(), before)


def _add_neighbour(found: Compared, seen: NDArray[np.uint8], before: NDArray[np.uint8]) -> None:
    found.neighbour += before.shape[0] * before.shape[1]
    found.touched += _differ(seen[NEIGHBOUR], before)


def _differ(seen: NDArray[np.uint8], right: NDArray[np.uint8]) -> int:
    """Pixels that differ in any of their colours."""
    return int((seen != right).any(axis=-1).sum())


@contextmanager
def _desktop(server: XServer, scale: float, *, manager: bool) -> Iterator[None]:
    """A desktop whose programs are told to scale in every way that Qt knows."""
    dots = str(round(96 * scale))
    scaling = {
        "QT_SCALE_FACTOR": str(scale),
        "QT_SCREEN_SCALE_FACTORS": f"DUMMY1={scale}",
        "QT_FONT_DPI": dots,
        "QT_USE_PHYSICAL_DPI": "1",
    }
    with ExitStack() as stack:
        stack.enter_context(_environment(scaling))
        stack.callback(server.run, "xrdb", "-remove")
        server.run("xrdb", "-nocpp", "-merge", stdin=f"Xft.dpi: {dots}\n")
        stack.callback(server.run, "xsetroot", "-solid", "black")
        server.run("xsetroot", *_WALLPAPER)
        if manager:
            stack.enter_context(server.program(_MANAGER))
            _await_manager(server)
        yield


def _await_manager(server: XServer) -> None:
    late = time.monotonic() + _PATIENCE
    while "window id" not in server.run("xprop", "-root", "_NET_SUPPORTING_WM_CHECK"):
        if time.monotonic() > late:
            raise NoXServer(f"{_MANAGER} doesn't manage windows. Try it by hand: {_MANAGER}")
        time.sleep(0.05)


@contextmanager
def _environment(given: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in given}
    os.environ.update(given)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


MEASUREMENTS = {"screen": screen_figure}
