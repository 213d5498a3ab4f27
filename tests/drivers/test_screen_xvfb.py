"""The panel on a virtual X display, which anybody can start: one screen, and a small one."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from xservers import REPLYING, be_patient, wait_for, xvfb

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import SLM, Surroundings
from drivers.screen import ScreenSLM, driver, identify_screens
from drivers.supervised import SupervisedDevice
from drivers.x11 import ScreenReader, XConnection, XError
from drivers.x11.shared_memory import XSharedMemory
from simulator.screens import running_server

pytestmark = [pytest.mark.xvfb, pytest.mark.usefixtures("patient")]

SHAPE = (120, 160)


def make(server, **options):
    given = {"width": 160, "height": 120, "display": server.display, "allow_primary": True}
    return ScreenSLM(Surroundings(RealClock()), **{**given, **options})


@pytest.fixture
def slm(server):
    with make(server) as device:
        yield device


def noise(rng, *frames):
    return rng.integers(0, 256, (*frames, *SHAPE), np.uint8)


def process_of(slm) -> int:
    return slm._window._process.pid


def test_the_only_screen_is_refused_unless_it_is_allowed(server):
    with (
        pytest.raises(DeviceError, match="the only screen"),
        make(server, screen="screen", allow_primary=False),
    ):
        pass


def test_it_is_an_slm(slm):
    device: SLM = slm
    assert device.shape == SHAPE
    assert device.frame_time == 1 / 60
    assert device.settling == 0.1
    assert not device.identity.simulated


def test_every_pixel_is_shown(server, slm, rng):
    for _ in range(5):
        grey = noise(rng)
        slm.show("noise", grey)
        assert (server.pixels() == grey[..., None]).all()
    slm.make_safe()
    assert not server.pixels().any()


def test_pictures_that_are_no_contiguous_arrays_are_shown(server, slm, rng):
    grey = rng.integers(0, 256, (SHAPE[1], SHAPE[0] * 2), np.uint8).T[::2]
    slm.show("noise", grey)
    assert (server.pixels() == grey[..., None]).all()


OF_ANOTHER_KIND = [
    np.zeros((120, 161), np.uint8),
    np.zeros((1, 120, 160), np.uint8),
    np.zeros(SHAPE),
    np.zeros(SHAPE, np.int8),
    np.uint8(0),
]


def test_pictures_and_videos_of_another_kind_are_refused(slm):
    for grey in OF_ANOTHER_KIND:
        with pytest.raises(DeviceError, match="isn't uint8 of 120x160"):
            slm.show("wrong", grey)
        with pytest.raises(DeviceError, match="isn't uint8 of framesx120x160"):
            slm.play("wrong", grey[None])
    with pytest.raises(DeviceError, match="isn't uint8"):
        slm.play("empty", np.zeros((0, *SHAPE), np.uint8))
    with pytest.raises(DeviceError, match="MiB are more than 1024"):
        slm.play("endless", np.broadcast_to(np.uint8(0), (60000, *SHAPE)))


def test_a_video_is_played_and_told(slm, rng):
    slm.play("video", noise(rng, 7))
    wait_for(lambda: slm.presentations().count > 20, "twenty frames")
    told = slm.presentations()
    assert (told.frames == np.arange(told.count) % 7).all()
    assert (np.diff(told.times) > 0).all()
    assert slm.health()["video paced by"] == "the screen's refreshes"
    assert slm.displayed_pattern == "video"


def test_a_dead_window_comes_back_neutral(server, slm, rng):
    slm.show("noise", noise(rng))
    os.kill(process_of(slm), signal.SIGKILL)
    wait_for(lambda: slm._window.is_dead, "its end")
    assert slm.displayed_pattern == "neutral"
    grey = noise(rng)
    slm.show("again", grey)
    assert (server.pixels() == grey[..., None]).all()


def test_a_window_that_is_killed_while_it_is_made_safe_has_a_successor(server, slm, rng):
    slm.show("noise", noise(rng))
    dead = process_of(slm)
    # It hears nothing more, and is killed when the call has begun.
    os.kill(dead, signal.SIGSTOP)
    killer = threading.Timer(0.3, os.kill, (dead, signal.SIGKILL))
    killer.start()
    slm.make_safe()
    killer.join()
    assert process_of(slm) != dead
    assert slm.displayed_pattern == "neutral"
    assert not server.pixels().any()


def test_a_supervised_panel_that_was_killed_is_named_and_revived(server, rng):
    with SupervisedDevice("slm", lambda: make(server)) as watched:
        watched.show("noise", noise(rng))
        watched._device.kill()
        with pytest.raises(DeviceError) as caught:
            watched.show("noise", noise(rng))
        assert caught.value.role == "slm"
        watched.revive()
        watched.show("noise", noise(rng))
        assert watched.displayed_pattern == "noise"
    wait_for(lambda: not server.pixels().any(), "nothing on the screen")


def test_a_closed_panel_says_so(server):
    slm = make(server)
    with pytest.raises(DeviceError, match="closed"):
        slm.make_safe()
    with slm:
        slm.make_safe()
    with pytest.raises(DeviceError, match="closed"):
        assert slm.displayed_pattern


def test_a_server_that_hangs_or_goes_is_an_error_in_time(rng, monkeypatch):
    """Under watch: a call that takes longer than its documented time leaves a dead device."""
    monkeypatch.setattr(driver, "_TIMEOUTS", replace(driver._TIMEOUTS, call=REPLYING))
    with xvfb(160, 120) as own, SupervisedDevice("slm", lambda: make(own)) as slm:
        slm.show("noise", noise(rng))
        os.kill(own.process, signal.SIGSTOP)
        try:
            for call in (lambda: slm.show("noise", noise(rng)), lambda: slm.displayed_pattern):
                with pytest.raises(DeviceError):
                    call()
                assert not slm.failure_reason
            with pytest.raises(XError, match="doesn't answer"):
                XConnection(own.display)
        finally:
            os.kill(own.process, signal.SIGCONT)
        be_patient(monkeypatch)
        slm.show("noise", noise(rng))
        assert slm.displayed_pattern == "noise"
        os.kill(own.process, signal.SIGKILL)
        for _ in range(2):
            with pytest.raises(DeviceError):
                slm.show("noise", noise(rng))
            assert not slm.failure_reason


def test_names_are_written_on_the_screen(server):
    (there,) = identify_screens(server.display, seconds=0.1)
    assert there.region == (0, 0, 160, 120)
    assert there.primary


# The reader.


def test_a_part_of_the_screen_can_be_read(server, slm, rng):
    grey = noise(rng)
    slm.show("noise", grey)
    with ScreenReader(server.display, (11, 7, 50, 31)) as reader:
        assert (reader.grey() == grey[7:38, 11:61]).all()
        assert (reader.colours() == grey[7:38, 11:61, None]).all()
    with ScreenReader(server.display) as reader:
        assert (reader.grey() == grey).all()


def test_a_reader_tells_whether_something_was_drawn(server, slm, rng):
    """On a busy machine a window is painted again, and the server tells of it late."""
    with ScreenReader(server.display) as reader:
        assert reader.has_changed()
        for _ in range(2):
            wait_for(lambda: not reader.has_changed(), "unchanged")
            slm.show("noise", noise(rng))
            wait_for(reader.has_changed, "a change")
        wait_for(lambda: not reader.has_changed(), "unchanged")


def test_what_is_not_on_the_screen_cannot_be_read(server):
    for region in ((0, 0, 161, 10), (-1, 0, 10, 10), (0, 0, 0, 10)):
        with pytest.raises(XError, match="isn't on the screen"):
            ScreenReader(server.display, region)


def test_a_server_that_cannot_share_memory_is_read_all_the_same(server, slm, rng, monkeypatch):
    def refused(*_):
        raise XError("not here")

    monkeypatch.setattr(XSharedMemory, "__init__", refused)
    grey = noise(rng)
    slm.show("noise", grey)
    with ScreenReader(server.display) as reader:
        assert (reader.grey() == grey).all()


def test_no_shared_memory_is_left_behind(server):
    def segments():
        """Of this process: others come and go on the same machine."""
        rows = [line.split() for line in server.run("ipcs", "-m", "-p").splitlines()]
        return {row[0] for row in rows if len(row) == 4 and row[2] == str(os.getpid())}

    with ScreenReader(server.display) as reader:
        reader.grey()
        assert len(segments()) == 1
    wait_for(lambda: not segments(), "no segment")


def test_a_screen_of_few_colours_cannot_be_read():
    with (
        running_server(["Xvfb", "-screen", "0", "64x64x16"]) as poor,
        pytest.raises(XError, match="isn't a screen of 8 bits a colour"),
    ):
        ScreenReader(poor.display)


def test_a_server_that_ended_is_named_and_its_next_one_is_found():
    """Nothing of the old window is of use: a new one is opened by the next call."""
    command = ["Xvfb", f":{40000 + os.getpid() % 10000}", "-screen", "0", "160x120x24"]
    grey = noise(np.random.default_rng(0))
    with ExitStack() as first:
        server = first.enter_context(running_server(command))
        with make(server) as slm:
            for _ in range(2):
                slm.show("noise", grey)
                assert slm.unplugged_reason() == ""
                first.close()
                wait_for(
                    lambda: slm.unplugged_reason() == f"the X server {server.display} has gone",
                    "gone",
                )
                with pytest.raises(DeviceError, match=r"the X server .* has gone"):
                    slm.show("noise", grey)
                with pytest.raises(DeviceError, match="no X server answers"):
                    slm.show("noise", grey)
                first.enter_context(running_server(command))
                slm.show("noise", grey)
                assert slm.displayed_pattern == "noise"
                with ScreenReader(server.display) as reader:
                    assert (reader.grey() == grey).all()


def test_an_output_that_is_off_is_gone_though_nobody_asks_the_window(slm, server):
    assert slm.unplugged_reason() == ""
    off = ["xrandr", "--display", server.display, "--output", "screen", "--off"]
    # Xvfb refuses a screen of no size, and switches its only output off before that.
    subprocess.run(off, check=False, stderr=subprocess.DEVNULL, timeout=60)
    assert "screens: none" in slm.unplugged_reason()
    server.xrandr("--output screen --mode 160x120")
    assert slm.unplugged_reason() == ""
