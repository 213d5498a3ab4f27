"""Devices that are unplugged while a run waits for others."""

import logging
import threading
import time

import pytest

from labapp.runs.acquisition import unplug_monitor
from labapp.runs.acquisition.unplug_monitor import UnplugMonitor

PATIENCE = 60


class Watched:
    """A device as the lookout sees it."""

    can_report_unplugging = True

    def __init__(self):
        self.why = ""
        self.looks = 0

    def unplugged_reason(self):
        self.looks += 1
        return self.why

    def looked_at(self):
        """Return when it was looked at, from now on."""
        seen, late = self.looks, time.monotonic() + PATIENCE
        while self.looks < seen + 2:
            assert time.monotonic() < late
            time.sleep(0.001)


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(unplug_monitor, "_POLL_INTERVAL", 0.005)


def test_what_goes_and_comes_is_told_once(caplog):
    caplog.set_level(logging.INFO, "labapp")
    one, other = Watched(), Watched()
    with UnplugMonitor({"filter": one, "slm": other}) as looks:
        for why in ("the port isn't there", "still not", None, ""):
            one.why = why
            one.looked_at()
            assert looks.message == (
                "filter, still not"
                if why in ("still not", None)
                else f"filter, {why}"
                if why
                else ""
            )
        other.looked_at()
    assert [record.getMessage() for record in caplog.records] == [
        "filter unplugged: the port isn't there. Plug it in again, the run goes on",
        "filter is there again",
    ]
    looks = one.looks
    time.sleep(0.05)
    assert one.looks == looks


def test_one_that_hangs_hides_no_other():
    class Hanging(Watched):
        def unplugged_reason(self):
            threading.Event().wait(1.0)
            return ""

    other = Watched()
    with UnplugMonitor({"camera": Hanging(), "filter": other}) as looks:
        other.why = "its plug is out"
        other.looked_at()
        assert "filter" in looks.message


def test_what_cannot_tell_isnt_looked_at():
    one = Watched()
    one.can_report_unplugging = False
    with UnplugMonitor({"filter": one}):
        time.sleep(0.05)
    assert one.looks == 0
