"""The small X client by itself: what it holds, and what it says of servers that it can't have."""

from __future__ import annotations

import os
import re
import signal
import subprocess

import pytest
from xservers import wait_for, xvfb

from drivers.errors import DeviceError
from drivers.screen.identify import identify_screens
from drivers.x11 import ScreenReader, XConnection, XError
from simulator.screens import running_server

pytestmark = pytest.mark.xvfb


@pytest.mark.parametrize(
    ("display", "said"),
    [
        ("foo", "'foo' is no name of a display, which is such as ':0'"),
        (":987", "no X server answers at ':987'"),
    ],
)
def test_a_display_that_cannot_be_had_is_named(display, said):
    with pytest.raises(XError, match=re.escape(said)):
        XConnection(display)


def test_a_screen_that_the_server_has_not_got_is_named(server):
    with pytest.raises(XError, match=r"has no screen of that number"):
        XConnection(f"{server.display}.7")


def test_what_greets_too_late_is_let_go():
    with xvfb(64, 64) as slow:
        before = len(os.listdir("/proc/self/fd"))
        os.kill(slow.process, signal.SIGSTOP)
        with pytest.raises(XError, match="doesn't answer"):
            XConnection(slow.display)
        os.kill(slow.process, signal.SIGCONT)
        wait_for(lambda: len(os.listdir("/proc/self/fd")) <= before, "the connection closes")


def test_a_reader_without_shared_memory_keeps_none():
    """The server hasn't got the extension: what was fetched for it must be given back."""
    with running_server(["Xvfb", "-screen", "0", "64x48x24", "-extension", "MIT-SHM"]) as plain:

        def segments():
            told = plain.run("ipcs", "-m", "-p").splitlines()
            return [line for line in told if str(os.getpid()) in line.split()]

        before = segments()
        with ScreenReader(plain.display) as reader:
            assert reader.grey().shape == (48, 64)
            assert segments() == before


def test_windows_that_do_not_come_up_are_told_in_a_line(server, monkeypatch):
    """By the last that Qt, or whoever else it was, has said."""

    def failed(*given, **named):
        return subprocess.CompletedProcess(given, 1, "", "Warning: this\nno Qt platform plugin\n")

    monkeypatch.setattr(subprocess, "run", failed)
    with pytest.raises(DeviceError, match=r"^screens: identify: no Qt platform plugin\. Look"):
        identify_screens(server.display)
