"""A simulated SLM, whose panel shows what is on a screen."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from drivers.errors import DeviceError
from drivers.screen.screen_choice import ScreenRequest, choose_screen
from drivers.x11 import ScreenReader, XConnection, XError
from drivers.x11.outputs import Output, list_outputs
from labapp.bench.virtual_bench.instruments import ServedInstrument, ServingContext
from labapp.bench.virtual_bench.shared_world import SharedWorld
from labapp.common.console import print_message
from labapp.common.errors import UserError
from optics.slm import Panel
from simulator.screens import NoXServer, xvfb


class ScreenMirror:
    """Copies the pixels of a screen to the panel of the virtual world on each update.

    If the screen can't be read, the panel is dark, like one without a signal, and the next update
    looks for the screen again.
    """

    def __init__(self, shared: SharedWorld, display: str, request: ScreenRequest) -> None:
        self._shared, self._display, self._wanted = shared, display, request
        self._turn = threading.Lock()
        self._reader: ScreenReader | None = None
        self._trouble, self._closed = "", False
        self.output = self._open()

    def update(self) -> None:
        """Copy the screen to the panel if it was drawn on since the last update."""
        with self._turn:
            if self._closed:
                return
            try:
                if self._reader is None:
                    self._open()
                reader = self._reader
                grey = reader.grey() if reader is not None and reader.has_changed() else None
            except (XError, DeviceError, UserError) as error:
                self._drop()
                grey = np.zeros((self._wanted.height, self._wanted.width), np.uint8)
                self._report_trouble(f"the panel has no signal: {error}")
            else:
                self._report_trouble("")
        if grey is not None:
            with self._shared.exclusive_access() as world:
                world.grey = grey

    def close(self) -> None:
        """Close the screen; later updates do nothing.

        A later update may come from a frame that is still being computed.
        """
        with self._turn:
            self._closed = True
            self._drop()

    def _drop(self) -> None:
        """Close the screen's reader, if it is open."""
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    def _open(self) -> Output:
        found = _find_output(self._display, self._wanted)
        self._reader = ScreenReader(self._display, found.region)
        return found

    def _report_trouble(self, trouble: str) -> None:
        if trouble and not self._trouble:
            print_message(trouble)
        self._trouble = trouble


def serve_panel(panel: Panel, display: str, screen: str, site: ServingContext) -> ServedInstrument:
    """Serve an SLM that shows a screen, until the site's stack is left.

    The screen belongs to the X server `display`, or to an Xvfb that is started if `display` is
    empty. Raises UserError if there is no such screen, or if it is the operator's own.
    """
    rows, columns = panel.shape
    display = display or _start_xvfb(rows, columns, site.stack)
    wanted = ScreenRequest(screen, columns, rows, panel.frame_rate, allow_primary=True)
    try:
        watched = ScreenMirror(site.shared, display, wanted)
    except (XError, DeviceError) as error:
        raise UserError(
            f"{error}" if isinstance(error, DeviceError) else f"display {display!r}: {error}."
        ) from error
    site.stack.callback(watched.close)
    found = watched.output
    if found.primary and found.refresh:
        raise UserError(
            f"screen {found.name!r} is the operator's own: patterns would cover it. Name another "
            "with --screen, or leave --display out for a screen that only programs see."
        )
    site.shared.before_frame = watched.update
    watched.update()
    return ServedInstrument(
        "screen-slm",
        {
            "screen": found.name,
            "width": columns,
            "height": rows,
            "refresh_hz": round(found.refresh or panel.frame_rate, 3),
            "display": display,
            "settling_ms": panel.settling * 1e3,
            # A primary output without a refresh rate belongs to a virtual screen that nobody sees,
            # so that patterns may cover it.
            "allow_primary": found.primary,
        },
    )


def _find_output(display: str, request: ScreenRequest) -> Output:
    x = XConnection(display)
    try:
        there = list_outputs(x)
    finally:
        x.close()
    # The refresh rate doesn't decide: the driver gets the rate of the chosen screen.
    try:
        chosen = choose_screen(request, [replace(output, refresh=0.0) for output in there])
    except DeviceError:
        choose_screen(request, there)  # this raises an error that lists the true refresh rates
        raise
    return next(output for output in there if output.number == chosen.number)


def _start_xvfb(rows: int, columns: int, stack: ExitStack) -> str:
    """Start an X server with an invisible screen, and return its display."""
    try:
        return stack.enter_context(xvfb(columns, rows)).display
    except NoXServer as error:
        raise UserError(
            f"the SLM needs a screen, and {error}. Or name a real one with --display and "
            "--screen, or leave the SLM out with --slm none."
        ) from error
