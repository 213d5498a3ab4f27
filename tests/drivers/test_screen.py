"""What a second display needs besides a display: its choice, its checks and its account."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from xservers import edid

from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from drivers.screen import ScreenSLM, list_screens
from drivers.screen.display_checks import gamma_ramp_error, readback_error
from drivers.screen.player import VideoPlayer
from drivers.screen.screen_choice import ScreenRequest, choose_screen
from drivers.screen.session import disable_scaling
from drivers.x11.edid import Monitor, read_edid
from drivers.x11.outputs import Output

OWN = Output("eDP-1", Monitor("AUO", "B140", "1"), 0, 0, 1920, 1080, 60.0, True)
PLUTO = Output(
    "HDMI-1", Monitor("HEC", "HE PLUTO-2.1", "6010-0042"), 1920, 0, 1920, 1080, 59.94, False
)
OTHER = Output("DP-1", Monitor("DEL", "U2720Q", "7"), 3840, 0, 3840, 2160, 60.0, False)


def wanted(screen="", allow_primary=False, width=1920, height=1080, refresh_hz=60.0):
    return ScreenRequest(screen, width, height, refresh_hz, allow_primary)


# The choice.


@pytest.mark.parametrize(
    "name", ["", "HDMI-1", "hdmi-1", "HE PLUTO-2.1", "6010-0042", "HE PLUTO-2.1 6010-0042"]
)
def test_a_screen_is_found_by_name_monitor_or_size(name):
    assert choose_screen(wanted(name), [OWN, PLUTO, OTHER]) is PLUTO


@pytest.mark.parametrize(
    ("asked", "there", "words"),
    [
        (wanted("HDMI-2"), [OWN, PLUTO], "no screen is called 'HDMI-2'.*eDP-1.*HDMI-1.*PLUTO"),
        (wanted(), [OWN, OTHER], "no screen has 1920x1080 pixels but the operator's"),
        (wanted(), [], "screens: none"),
        (wanted("eDP-1"), [OWN, PLUTO], "the operator's own .primary. screen"),
        (wanted("eDP-1"), [OWN], "the only screen.*allow_primary = true"),
        (wanted(), [OWN, PLUTO, dataclasses.replace(PLUTO, name="HDMI-2", y=1080)], "several"),
        (wanted("DP-1"), [OWN, OTHER], "DP-1 runs at 3840x2160 pixels.*--mode 1920x1080"),
        (wanted(refresh_hz=50), [OWN, PLUTO], "59.94 Hz, not 50.*--rate 50"),
        (wanted(), [OWN, dataclasses.replace(PLUTO, x=0)], "shows what eDP-1 shows, too"),
        (
            wanted(),
            [OWN, dataclasses.replace(PLUTO, distortion="it is turned or mirrored")],
            "doesn't show its pixels as they are: it is turned or mirrored",
        ),
        (
            wanted(),
            [OWN, dataclasses.replace(PLUTO, native=(1920, 1200))],
            "the monitor says that it has 1920x1200: it scales.*--mode 1920x1200",
        ),
    ],
)
def test_any_other_screen_is_refused(asked, there, words):
    with pytest.raises(DeviceError, match=words):
        choose_screen(asked, there)


def test_the_operators_screen_can_be_allowed():
    assert choose_screen(wanted("eDP-1", allow_primary=True), [OWN]) is OWN


def test_a_monitor_that_is_wrong_about_its_size_can_be_allowed():
    other = dataclasses.replace(PLUTO, native=(1280, 768))
    allowed = dataclasses.replace(wanted(), allowed=("native size",))
    assert choose_screen(allowed, [OWN, other]) is other
    same = dataclasses.replace(PLUTO, native=(1920, 1080))
    assert choose_screen(wanted(), [OWN, same]) is same


def test_a_monitor_is_read_from_its_edid():
    assert read_edid(edid(b"HE PLUTO-2.1", b"6010-0042")) == PLUTO.monitor
    assert read_edid(edid(b"thirteen long", b"")).model == "thirteen long"


def test_a_damaged_edid_names_nobody():
    good = edid(b"HE PLUTO-2.1", b"6010-0042")
    assert read_edid(b"") == read_edid(good[:100]) == Monitor()
    for at in range(128):
        damaged = bytearray(good)
        damaged[at] ^= 0x10
        assert read_edid(bytes(damaged)) == Monitor()


# The session.


@pytest.mark.parametrize(
    "environment",
    [
        {"XDG_SESSION_TYPE": "wayland", "DISPLAY": ":0"},
        {"WAYLAND_DISPLAY": "wayland-0", "DISPLAY": ":0"},
        {"WAYLAND_DISPLAY": "wayland-0"},
        {"QT_QPA_PLATFORM": "wayland;xcb", "DISPLAY": ":0"},
    ],
)
def test_wayland_is_refused(monkeypatch, environment):
    for name in ("XDG_SESSION_TYPE", "WAYLAND_DISPLAY", "DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(DeviceError, match=r"Wayland.*Log in to an X11"):
        list_screens()
    with (
        pytest.raises(DeviceError, match=r"Wayland.*Log in to an X11"),
        ScreenSLM(Surroundings(RealClock())),
    ):
        pass


def test_no_display_is_refused(monkeypatch):
    for name in ("XDG_SESSION_TYPE", "WAYLAND_DISPLAY", "DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(DeviceError, match="DISPLAY isn't set"):
        list_screens()
    with pytest.raises(DeviceError, match="no X server answers at ':4711'"):
        list_screens(":4711")


def test_nothing_that_scales_is_left():
    environment = {
        "QT_SCALE_FACTOR": "1.5",
        "QT_SCREEN_SCALE_FACTORS": "2",
        "QT_FONT_DPI": "192",
        "QT_USE_PHYSICAL_DPI": "1",
        "QT_QPA_PLATFORM": "offscreen",
        "HOME": "/home/a",
    }
    disable_scaling(environment, ":3")
    assert environment == {
        "QT_ENABLE_HIGHDPI_SCALING": "0",
        "QT_QPA_PLATFORM": "xcb",
        "DISPLAY": ":3",
        "HOME": "/home/a",
    }


# The checks.


def test_a_screen_that_shows_what_it_should_has_no_fault(rng):
    grey = rng.integers(0, 256, (90, 160), np.uint8)
    assert not readback_error(np.repeat(grey[..., None], 4, 2), grey)


def test_a_single_wrong_pixel_is_counted_in_any_colour(rng):
    grey = rng.integers(0, 256, (90, 160), np.uint8)
    for colour in range(3):
        seen = np.repeat(grey[..., None], 3, 2)
        seen[3, 4, colour] ^= 1
        assert readback_error(seen, grey).startswith("1 of 14400 pixels are wrong")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda seen: np.roll(seen, 1, axis=1), "scaled, shifted or covered"),
        (lambda seen: (seen * 0.9).astype(np.uint8), "colour management"),
    ],
)
def test_the_likely_cause_is_told(rng, spoil, words):
    grey = rng.integers(0, 256, (90, 160), np.uint8)
    seen = np.repeat(grey[..., None], 3, 2)
    assert words in readback_error(spoil(seen), grey)


def test_a_window_on_top_is_told_with_its_place(rng):
    grey = rng.integers(0, 255, (90, 160), np.uint8)
    seen = np.repeat(grey[..., None], 3, 2)
    seen[10:30, 40:100] = 255
    assert "another window lies on top, at 40,10, 60x20 pixels" in readback_error(seen, grey)


@pytest.mark.parametrize("size", [0, 256, 1024, 4096])
def test_a_ramp_that_changes_nothing_passes(size):
    plain = np.round(np.linspace(0, 65535, size))
    for kept in (plain, plain // 256 * 256, plain // 256 * 257):
        assert not gamma_ramp_error(np.tile(kept.astype(np.uint16), (3, 1)))


@pytest.mark.parametrize("size", [256, 1024])
@pytest.mark.parametrize(
    "bend",
    [
        lambda level: level**0.98,
        lambda level: 0.99 * level,
        lambda level: 0.01 + 0.99 * level,
        lambda level: 1 - level,
        lambda level: np.round(level * 63) / 63,
    ],
)
@pytest.mark.parametrize("colour", [0, 1, 2])
def test_a_ramp_that_changes_one_colour_is_told(size, bend, colour):
    plain = np.linspace(0, 1, size)
    ramp = np.tile(plain, (3, 1))
    ramp[colour] = bend(plain)
    assert "gamma ramp" in gamma_ramp_error(np.round(65535 * ramp).astype(np.uint16))


# The account.


class Screen:
    """Refreshes every 10 ms; a frame takes as long to draw as it is told."""

    def __init__(self):
        self.time, self.drawn, self.takes = 0.0, [], 0.002

    def draw(self, index):
        self.drawn.append(index)
        self.time += self.takes


def play(delays, frames=3, takes=0.002):
    """What a player tells whose process stood still for `delays` before each refresh."""
    screen = Screen()
    screen.takes = takes
    player = VideoPlayer(frames, 0.010, screen.draw, lambda: screen.time)
    number = 0
    for delay in delays:
        screen.time = max(screen.time, number * 0.010) + delay
        # The server tells the refresh that was wished for, or the latest.
        number = max(number, int(screen.time / 0.010 + 1e-9))
        number = player.on_refresh(number, number * 0.010)
    return player.presentations(), screen.drawn


def test_a_video_that_is_never_late_misses_nothing():
    told, drawn = play([0.001] * 30)
    assert drawn == list(told.frames) == [0, 1, 2] * 10
    assert told.times == pytest.approx(np.arange(1, 31) * 0.010)
    assert (told.count, told.missed) == (30, 0)


def test_a_stop_misses_refreshes_but_leaves_no_frame_out():
    told, drawn = play([0.001] * 5 + [0.0455] + [0.001] * 5)
    assert drawn == [0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1]
    assert told.missed == 4
    assert np.diff(told.times).max() == pytest.approx(0.050)


def test_a_computer_that_is_too_slow_misses_every_other_refresh():
    told, _ = play([0.001] * 10, takes=0.012)
    assert np.diff(told.times) == pytest.approx(0.020)
    assert told.missed == 9


def test_a_frame_that_no_refresh_showed_is_missed():
    now = [0.0]
    player = VideoPlayer(5, 0.010, lambda index: None, lambda: now[0])
    for time in (0.0, 0.001, 0.010):
        now[0] = time
        player.on_refresh(0, time)
    assert player.presentations().missed == 1


@pytest.mark.parametrize("lateness", [(0.4, 0.8), (0.3, 0.7, 0.3), (0.0, 0.6, 0.0, 0.6), (0.45,)])
def test_refreshes_that_are_told_late_are_neither_lost_nor_counted_twice(lateness):
    """As a busy server tells them that makes them up; one real miss lies behind them."""
    now = [0.0]
    player = VideoPlayer(5, 0.010, lambda index: None, lambda: now[0])
    for number, late in enumerate([0.0] * 20 + list(lateness)):
        now[0] = (number + late) * 0.010
        player.on_refresh(number, now[0])
    number += 2
    for later in range(5):
        now[0] = (number + later) * 0.010
        player.on_refresh(number + later, now[0])
    told = player.presentations()
    # A frame that seems to come too late, and the next one too soon, are a miss each.
    assert 1 <= told.missed <= 1 + 2 * sum(late > 0.5 for late in lateness)


def test_a_video_that_stands_still_is_late_before_it_goes_on():
    now = [0.0]
    player = VideoPlayer(5, 0.010, lambda index: None, lambda: now[0])
    player.on_refresh(0, 0.0)
    assert player.presentations().missed == 0
    now[0] = 0.1
    assert player.presentations().missed == 8


# The driver.


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"screen": 1}, "screen is 1"),
        ({"width": 0}, "width is 0"),
        ({"height": 1080.0}, "height is 1080.0"),
        ({"refresh_hz": float("nan")}, "refresh_hz is nan"),
        ({"refresh_hz": "60"}, "refresh_hz is '60'"),
        ({"settling_ms": -1}, "settling_ms is -1"),
        ({"display": "HDMI-1"}, "display is 'HDMI-1'.*such as ':0'"),
        ({"allow_primary": "yes"}, "allow_primary is 'yes'; write true or false"),
        ({"allow_ramp": 1}, "allow_ramp is 1"),
        ({"allow_properties": "CTM"}, "allow_properties is 'CTM'; give a list of names"),
        ({"allow_properties": [1]}, r"allow_properties is \[1\]"),
    ],
)
def test_bad_options_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        ScreenSLM(Surroundings(RealClock()), **options)


def test_importing_it_loads_nothing_heavy():
    code = (
        "import sys, drivers.screen, drivers.x11; "
        "print([m for m in ('PySide6', 'torch', 'serial') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
