"""The panel on a real second screen: Xorg with two outputs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from figures.presentations import watched_video
from figures.screen import SCALES, Compared, compare, require_tools
from xservers import REPLYING, be_patient, edid, wait_for, xorg

from drivers import ports
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.interfaces import Surroundings
from drivers.screen import ScreenSLM, driver, identify_screens
from drivers.x11 import ScreenReader, XConnection
from drivers.x11.outputs import list_outputs, read_gamma_ramp
from simulator.screens import NEIGHBOUR, PANEL, lay_out

pytestmark = [pytest.mark.xorg, pytest.mark.usefixtures("patient")]


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with xorg(tmp_path_factory.mktemp("xorg")) as running:
        yield running


@pytest.fixture
def bench(server, monkeypatch):
    """A server whose screens are as on a bench, before and after."""
    for name in ("WAYLAND_DISPLAY", "XDG_SESSION_TYPE"):
        monkeypatch.delenv(name, raising=False)
    yield server
    lay_out(server)


def opened(server, **options):
    return ScreenSLM(Surroundings(RealClock()), **{"display": server.display, **options})


@pytest.fixture
def slm(bench):
    with opened(bench) as device:
        yield device


def noise(rng, *shape):
    return rng.integers(0, 256, shape or (1080, 1920), np.uint8)


def process_of(slm) -> int:
    return slm._window._process.pid


# Pixels.


@pytest.mark.parametrize(
    ("scale", "manager"),
    [
        (1.5, True),
        pytest.param(1, False, marks=pytest.mark.sweep),
        *(pytest.param(scale, True, marks=pytest.mark.sweep) for scale in SCALES if scale != 1.5),
        pytest.param(1.5, False, marks=pytest.mark.sweep),
    ],
)
def test_every_pixel_is_shown_whatever_scales_the_desktop(bench, rng, scale, manager):
    require_tools()
    found = Compared()
    compare(bench, found, rng, scale, manager=manager, pictures=2)
    assert found == Compared(panel=2 * 1080 * 1920, neighbour=3 * 1080 * 1280)
    wait_for(lambda: not bench.pixels().any(), "nothing on the screens")


def test_neutral_at_the_start_and_at_the_end(bench, rng):
    with opened(bench) as slm:
        assert slm.displayed_pattern == "neutral"
        assert not bench.pixels()[PANEL].any()
        slm.show("noise", noise(rng))
        assert slm.displayed_pattern == "noise"
        slm.make_safe()
        assert slm.displayed_pattern == "neutral"
        assert not bench.pixels()[PANEL].any()


def test_a_setting_stands_after_the_panel_has_settled(bench, rng):
    clock = RealClock()
    with ScreenSLM(Surroundings(clock), display=bench.display, settling_ms=1000) as slm:
        before = clock.now()
        setting = slm.show("noise", noise(rng))
        after = clock.now()
    assert setting.request == setting.actual == "noise"
    assert before + 1 < setting.ready_at <= after + 1 + slm.frame_time


def test_the_reader_sees_what_xwd_sees(bench, slm, rng):
    with ScreenReader(bench.display, (1280, 0, 1920, 1080)) as reader:
        assert reader.has_changed()
        # Right after it was opened, a screen may be painted more than once.
        wait_for(lambda: not reader.has_changed(), "unchanged")
        grey = noise(rng)
        slm.show("noise", grey)
        wait_for(reader.has_changed, "a change")
        assert (reader.grey() == bench.pixels()[PANEL][..., 1]).all()
        assert (reader.colours() == grey[..., None]).all()
        wait_for(lambda: not reader.has_changed(), "unchanged")


ON_TOP = """
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QColor, QGuiApplication, QPainter, QRasterWindow
class Bright(QRasterWindow):
    def paintEvent(self, event):
        painter = QPainter(self)
        painter.fillRect(0, 0, 300, 200, QColor("orange"))
        painter.end()
app = QGuiApplication([])
window = Bright()
window.setFlags(Qt.BypassWindowManagerHint)
window.setTitle("intruder")
window.setGeometry(1500, 300, 300, 200)
window.show()
timer = QTimer(interval=1)
timer.timeout.connect(window.raise_)
timer.start()
app.exec()
"""


def intruder(server):
    """A window that always comes back to the top."""
    return server.program(
        "env", "QT_ENABLE_HIGHDPI_SCALING=0", "QT_QPA_PLATFORM=xcb", sys.executable, "-c", ON_TOP
    )


def show_and_look(slm, grey):
    """On a busy computer a window may come back only after the picture was found right."""
    slm.show("under it", grey)
    wait_for(lambda: not slm.displayed_pattern, "an error")


def is_on_top(server):
    return (server.pixels()[301, 1501] == (0, 165, 255)).all()  # orange


def test_a_window_that_lies_on_top_is_covered(bench, slm, rng):
    with bench.program("xclock", "-geometry", "300x200+1500+300"):
        wait_for(lambda: "xclock" in bench.run("xwininfo", "-root", "-tree"), "the clock's window")
        grey = noise(rng)
        slm.show("over it", grey)
        assert (bench.pixels()[PANEL] == grey[..., None]).all()


def test_a_window_that_stays_on_top_is_named_with_its_place(bench, slm, rng):
    with intruder(bench):
        wait_for(lambda: is_on_top(bench), "a window on top")
        with pytest.raises(DeviceError, match="on top, at 220,300, 300x200 pixels"):
            show_and_look(slm, noise(rng))
    grey = noise(rng)
    slm.show("again", grey)
    assert (bench.pixels()[PANEL] == grey[..., None]).all()


def test_a_video_that_is_covered_is_told_at_the_next_call(bench, slm, rng):
    slm.play("video", noise(rng, 5, 1080, 1920))
    assert slm.displayed_pattern == "video"
    with intruder(bench):
        wait_for(lambda: is_on_top(bench), "a window on top")

        def told() -> bool:
            try:
                return not slm.displayed_pattern
            except DeviceError as error:
                return "on top" in str(error)

        # It looks twice a second, as soon as the machine has time for it.
        wait_for(told, "a word of what is on top")
    slm.make_safe()
    assert slm.displayed_pattern == "neutral"


def saver(server) -> int:
    """What MIT-SCREEN-SAVER's QueryInfo tells: 1 is on."""
    with XConnection(server.display) as x:
        return x.query_extension("MIT-SCREEN-SAVER", 1, "I", x.setup.root)[1]


def test_no_screen_saver_comes_while_it_is_open(bench, rng):
    bench.run("xset", "s", "1", "1")
    try:
        wait_for(lambda: saver(bench) == 1, "a screen saver")
        grey = noise(rng)
        with opened(bench) as slm:
            bench.run("xset", "s", "reset")
            wait_for(lambda: saver(bench) != 1, "no screen saver")
            slm.show("noise", grey)
            time.sleep(1.5)
            assert saver(bench) != 1
            assert (bench.pixels()[PANEL] == grey[..., None]).all()
    finally:
        bench.run("xset", "s", "off")
        bench.run("xset", "s", "reset")


# Videos.


@pytest.mark.parametrize("hold_up", [pytest.param(False, marks=pytest.mark.sweep), True])
def test_a_video_comes_in_order_and_what_comes_late_is_told(bench, hold_up):
    found, times = watched_video(bench, 3.0, hold_up=hold_up)
    assert (found.backwards, found.torn, found.untrue) == (0, 0, 0), found
    # The eye knows to a refresh when the first and the last frame came that it saw.
    assert found.unreported <= 1, found
    assert 1 / found.period == pytest.approx(60, rel=1e-3)
    # A busy machine shows fewer frames, and misses the more refreshes.
    assert found.frames + found.missed > 60
    assert bool(times) == hold_up
    assert found.missed >= times // 2


def test_a_stopped_window_is_a_reported_miss(slm, rng):
    slm.play("video", noise(rng, 4, 1080, 1920))
    wait_for(lambda: slm.presentations().count > 20, "twenty frames")
    before = slm.presentations()
    os.kill(process_of(slm), signal.SIGSTOP)
    time.sleep(0.2)
    os.kill(process_of(slm), signal.SIGCONT)
    late = before.missed + 0.2 / slm.frame_time - 2
    wait_for(lambda: slm.presentations().missed >= late, "a miss that is told")
    wait_for(lambda: slm.presentations().count > before.count + 20, "twenty frames more")
    after = slm.presentations()
    gap = np.diff(after.times).max()
    assert gap > 0.15
    assert (after.frames == np.arange(after.count) % 4).all()
    counted = int(slm.health()["video presentations missed"])
    assert counted >= after.missed


def test_a_still_ends_a_video(bench, slm, rng):
    slm.play("video", noise(rng, 3, 1080, 1920))
    grey = noise(rng)
    slm.show("still", grey)
    time.sleep(0.1)
    assert (bench.pixels()[PANEL] == grey[..., None]).all()
    with pytest.raises(DeviceError, match="no video plays"):
        slm.presentations()


# Death.


OWNER = """
import sys, time
import numpy as np
from drivers.clock import RealClock
from drivers.interfaces import Surroundings
from drivers.screen import ScreenSLM
with ScreenSLM(Surroundings(RealClock()), display=sys.argv[1]) as slm:
    slm.show("bright", np.full(slm.shape, 200, np.uint8))
    print("shown", flush=True)
    time.sleep(600)
"""


def test_the_screen_is_neutral_when_its_owner_was_killed(bench):
    owner = subprocess.Popen(
        [sys.executable, "-c", OWNER, bench.display], stdout=subprocess.PIPE, text=True
    )
    try:
        assert owner.stdout.readline().strip() == "shown"
        assert (bench.pixels()[PANEL] == 200).all()
    finally:
        owner.kill()
        owner.wait()
        owner.stdout.close()
    wait_for(lambda: not bench.pixels()[PANEL].any(), "neutral")


def test_a_window_that_hangs_is_an_error_in_time_and_comes_back(bench, rng, monkeypatch):
    monkeypatch.setattr(driver, "_TIMEOUTS", replace(driver._TIMEOUTS, call=REPLYING))
    with opened(bench) as slm:
        slm.show("noise", noise(rng))
        be_patient(monkeypatch)
        os.kill(process_of(slm), signal.SIGSTOP)
        with pytest.raises(DeviceError, match="no answer within 4 s; its process was killed"):
            slm.show("more", noise(rng))
        assert slm.displayed_pattern == "neutral"
        grey = noise(rng)
        slm.show("again", grey)
        assert (bench.pixels()[PANEL] == grey[..., None]).all()


# Screens that come and go.


def test_an_unplugged_screen_is_named_and_found_again(bench, slm, rng):
    slm.show("noise", noise(rng))
    neighbour, process = bench.pixels()[NEIGHBOUR], process_of(slm)
    bench.xrandr("--output DUMMY1 --off")
    for call in (
        lambda: slm.displayed_pattern,
        lambda: slm.show("noise", noise(rng)),
        lambda: slm.play("video", noise(rng, 2, 1080, 1920)),
        lambda: slm.health(),
        lambda: slm.presentations(),
        lambda: slm.make_safe(),
    ):
        with pytest.raises(DeviceError, match="DUMMY0"):
            call()
        # It has answered: one that had been waited for in vain would have been replaced.
        assert process_of(slm) == process
        assert (bench.pixels()[:1024, :1280] == neighbour[:1024]).all()
    lay_out(bench)
    assert slm.displayed_pattern == "neutral"
    assert not bench.pixels()[PANEL].any()
    grey = noise(rng)
    slm.show("again", grey)
    assert (bench.pixels()[PANEL] == grey[..., None]).all()
    assert slm.health()["screen lost"] == "1 times"


def test_a_screen_unplugged_between_two_calls_is_neutral(bench, slm, rng):
    slm.play("video", noise(rng, 2, 1080, 1920))
    bench.xrandr("--output DUMMY1 --off")
    lay_out(bench)
    wait_for(lambda: not bench.pixels()[PANEL].any(), "neutral")
    assert slm.displayed_pattern == "neutral"
    assert slm.health()["screen lost"] == "1 times"


def test_a_screen_that_moves_is_followed(bench, slm, rng):
    slm.show("noise", noise(rng))
    bench.xrandr("--output DUMMY1 --pos 0x0 --output DUMMY0 --pos 1920x0")
    assert slm.displayed_pattern == "neutral"
    grey = noise(rng)
    slm.show("there", grey)
    assert (bench.pixels()[:1080, :1920] == grey[..., None]).all()
    wait_for(lambda: not bench.pixels()[:1024, 1920:].any(), "nothing on the other screen")


# Which screen.


def test_the_operators_screen_is_refused(bench, rng):
    own = {"screen": "DUMMY0", "width": 1280, "height": 1024}
    with (
        pytest.raises(DeviceError, match=r"primary.*DUMMY0.*DUMMY1.*allow_primary"),
        opened(bench, **own),
    ):
        pass
    with opened(bench, **own, allow_primary=True) as slm:
        grey = noise(rng, 1024, 1280)
        slm.show("noise", grey)
        assert (bench.pixels()[:1024, :1280] == grey[..., None]).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"screen": "HDMI-7"}, "no screen is called 'HDMI-7'.*DUMMY0.*DUMMY1"),
        ({"width": 800, "height": 600}, "no screen has 800x600"),
        ({"screen": "DUMMY1", "width": 1280, "height": 1024}, "runs at 1920x1080"),
        ({"refresh_hz": 50.0}, "Hz, not 50"),
        ({"display": ":4711"}, "no X server answers"),
    ],
)
def test_a_wrong_screen_is_refused(bench, options, words):
    with pytest.raises(DeviceError, match=words), opened(bench, **options) as slm:
        slm.health()


def test_two_screens_of_the_size_are_ambiguous(bench):
    bench.xrandr("--addmode DUMMY2 1920x1080")
    bench.xrandr("--output DUMMY2 --mode 1920x1080 --pos 3200x0")
    bench.xrandr("")
    try:
        with pytest.raises(DeviceError, match="several screens"), opened(bench):
            pass
        with opened(bench, screen="DUMMY1") as slm:
            assert slm.identity.model == "screen DUMMY1"
    finally:
        bench.xrandr("--output DUMMY2 --off")


def test_a_mirrored_screen_is_refused(bench):
    bench.xrandr("--output DUMMY0 --pos 1280x0")
    with pytest.raises(DeviceError, match="shows what DUMMY0 shows"), opened(bench):
        pass


def tell_edid(server, data: bytes) -> None:
    """Have DUMMY1 say that it is a monitor."""
    with XConnection(server.display) as x:
        listed = server.xrandr("--verbose").split("DUMMY1 ")[1]
        number = int(listed.split("Identifier:")[1].split()[0], 16)
        given = (number, x.atom("EDID"), 19, 8, 0, len(data), data)
        x.send_extension_request("RANDR", 13, "IIIBBxxI128s", *given)
        x.atom("done")


def test_a_panel_is_known_by_what_its_monitor_tells(bench):
    tell_edid(bench, edid(b"HE PLUTO-2.1", b"6010-0042"))
    try:
        for name in ("HE PLUTO-2.1", "6010-0042", "he pluto-2.1 6010-0042"):
            with opened(bench, screen=name) as slm:
                assert slm.identity.model == "HE PLUTO-2.1"
                assert slm.identity.serial == "6010-0042"
        with opened(bench, screen="DUMMY1") as slm:
            tell_edid(bench, edid(b"HE PLUTO-2.1", b"6010-0043"))
            with pytest.raises(DeviceError, match="another monitor"):
                slm.show("noise", np.zeros(slm.shape, np.uint8))
            tell_edid(bench, edid(b"HE PLUTO-2.1", b"6010-0042"))
            slm.show("noise", np.zeros(slm.shape, np.uint8))
    finally:
        tell_edid(bench, bytes(128))


# Grey levels.


def test_a_gamma_ramp_is_refused_unless_it_is_allowed(bench, slm, rng):
    slm.show("noise", noise(rng))
    bench.xrandr("--output DUMMY1 --gamma 0.9")
    with pytest.raises(DeviceError, match="gamma ramp changes grey levels"):
        slm.show("noise", noise(rng))
    bench.xrandr("--output DUMMY1 --gamma 1 --brightness 0.95")
    with pytest.raises(DeviceError, match="gamma ramp"):
        slm.show("noise", noise(rng))
    with opened(bench, allow_ramp=True) as other:
        assert "not plain" in other.health()["gamma ramp"]
    bench.xrandr("--output DUMMY1 --gamma 1 --brightness 1")
    slm.show("noise", noise(rng))


# What is sent.


def test_a_smaller_mode_with_panning_is_named_and_a_panned_area_of_the_size_is_not(bench, slm, rng):
    slm.show("noise", noise(rng))
    bench.xrandr("--output DUMMY1 --panning 1920x1080+1280+0")
    assert slm.displayed_pattern == "noise"
    bench.xrandr("--output DUMMY1 --mode 1280x720 --panning 1920x1080+1280+0")
    words = r"only 1280x720 of 1920x1080 pixels are seen.*panning.*--panning 0x0"
    with pytest.raises(DeviceError, match=words):
        slm.displayed_pattern  # noqa: B018
    with pytest.raises(DeviceError, match=words), opened(bench):
        pass


def test_night_light_during_a_still_is_named(bench, slm, rng):
    slm.show("noise", noise(rng))
    bench.xrandr("--output DUMMY1 --gamma 1:.8:.6")
    with pytest.raises(DeviceError, match="gamma ramp changes grey levels by up to 47 of 255"):
        slm.displayed_pattern  # noqa: B018
    # Also if it is off again: the exposure saw it.
    bench.xrandr("--output DUMMY1 --gamma 1")
    with pytest.raises(DeviceError, match="while the pattern was shown"):
        slm.displayed_pattern  # noqa: B018
    slm.show("again", noise(rng))
    assert slm.displayed_pattern == "again"


def test_a_gamma_ramp_that_comes_and_goes_within_a_tenth_of_a_second_is_named(bench, slm, rng):
    slm.show("noise", noise(rng))
    with XConnection(bench.display) as x:
        crtc = next(one.crtc for one in list_outputs(x) if one.name == "DUMMY1")
        plain = read_gamma_ramp(x, crtc)
        for ramp, seconds in ((plain // 2, 0.1), (plain, 0.0)):
            body = ramp.astype("<u2").tobytes()
            # 24 is RRSetCrtcGamma; the X server tells nobody.
            x.send_extension_request("RANDR", 24, f"IH2x{len(body)}s", crtc, ramp.shape[1], body)
            x.atom("EDID")
            time.sleep(seconds)
        np.testing.assert_array_equal(read_gamma_ramp(x, crtc), plain)
    with pytest.raises(DeviceError, match=r"gamma ramp changes grey levels by up to 12[78] of 255"):
        slm.displayed_pattern  # noqa: B018


# Names on screens.


def test_screens_are_listed_among_what_is_plugged_in(bench, monkeypatch):
    monkeypatch.setenv("DISPLAY", bench.display)
    found = [(port.kind, port.address, port.description[:9]) for port in ports.screens()]
    assert found == [("screen", "DUMMY0", "1280x1024"), ("screen", "DUMMY1", "1920x1080")]
    monkeypatch.delenv("DISPLAY")
    assert ports.screens() == []


def test_each_screen_is_named_on_itself(bench):
    there = identify_screens(bench.display, seconds=0.1)
    assert [output.name for output in there] == ["DUMMY0", "DUMMY1"]
    assert [output.primary for output in there] == [True, False]
    assert there[1].region == (1280, 0, 1920, 1080)
    command = [sys.executable, "-m", "drivers.screen", "--display", bench.display]
    with bench.program(*command, "--seconds", "30"):
        wait_for(
            lambda: (p := bench.pixels())[PANEL].max() == 255 == p[:1024, :1280].max(), "plates"
        )
    wait_for(lambda: not bench.pixels().any(), "no plates")
