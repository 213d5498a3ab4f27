"""The virtual bench's panel: a screen that is watched, and the X server behind it."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from drivers.screen.screen_choice import ScreenRequest
from labapp.bench.virtual_bench import panels
from labapp.bench.virtual_bench.panels import ScreenMirror
from labapp.common.errors import UserError
from simulator.screens import server

pytestmark = pytest.mark.xvfb


class World:
    """What is watched of a shared world: the grey levels that it was given."""

    def __init__(self):
        self.greys = []

    @contextmanager
    def exclusive_access(self):
        world = SimpleNamespace(grey=None)
        yield world
        self.greys.append(world.grey)


def test_a_panel_that_was_closed_looks_no_more():
    """A picture may be made while all ends, in a thread that nobody waits for."""
    with ExitStack() as stack:
        display = panels._start_xvfb(48, 64, stack)
        world = World()
        panel = ScreenMirror(world, display, ScreenRequest("", 64, 48, 60.0, allow_primary=True))
        panel.update()
        assert [grey.shape for grey in world.greys] == [(48, 64)]
        panel.close()
        panel.update()
        assert len(world.greys) == 1
        assert panel._reader is None
        panel.close()


def test_an_x_server_that_hangs_is_told_and_ended(tmp_path, monkeypatch):
    """It would last longer than any test may take."""
    program, number = tmp_path / "Xvfb", tmp_path / "number"
    program.write_text(f"#!/bin/sh\necho $$ >{number}\nexec sleep 1000\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(server, "_START_TIMEOUT", 1.0)
    with pytest.raises(UserError, match="Xvfb didn't start"), ExitStack() as stack:
        panels._start_xvfb(48, 64, stack)
    assert not Path("/proc", number.read_text().strip()).exists()
