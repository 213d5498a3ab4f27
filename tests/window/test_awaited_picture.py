"""What the window is told while its picture isn't that of the settings any more."""

import contextlib
import socket
import time
from types import SimpleNamespace

import pytest

from drivers.hosted.message_socket import MessageSocket
from labapp.window.commands import SetExposure
from labapp.window.engine import picture_forecast
from labapp.window.engine.awaited_picture import AwaitedPicture
from labapp.window.engine.change_notifier import REPORT_INTERVAL
from labapp.window.engine.channel import Channel
from labapp.window.engine.live_tolerance import LiveTolerance
from labapp.window.engine.outdated_frame import OutdatedFrame
from labapp.window.engine.picture_forecast import PictureForecast
from labapp.window.messages import JobProgress, PictureAwaited


@pytest.fixture
def ends():
    engine, window = (MessageSocket(end.detach()) for end in socket.socketpair())
    channel = Channel(engine)
    yield channel, window
    window.close()


@pytest.fixture
def awaited(ends):
    made = AwaitedPicture(ends[0])
    ends[0].end_handlers.append(made.close)
    made.set_live(True)
    return made


def test_a_change_is_told_within_a_tenth_of_a_second(ends, awaited):
    # A busy machine may be late, but not every time.
    delays = []
    for request in range(1, 6):
        time.sleep(REPORT_INTERVAL)
        awaited.count_request()
        report = newest(ends[1], request)
        awaited.note_picture(request)
        assert (report.request, report.activity) == (request, "setting the devices")
        assert report.seconds_left is None
        delays.append(report.elapsed)
    assert min(delays) < 0.1


def test_what_is_done_and_the_time_left_are_of_the_newest_change(ends, awaited):
    awaited.count_request()
    awaited.note_activity(1, "computing the picture", 30.0)
    report = ends[1].receive(5)
    assert report.activity == "computing the picture"
    assert 29 < report.seconds_left < 30
    awaited.count_request()
    awaited.note_activity(1, "computing the picture", 30.0)
    awaited.note_job(JobProgress("preview", 0.5, "", 7.0))
    awaited.note_job(JobProgress("pattern", 0.5, "", 4.0))
    report = newest(ends[1], 2)
    assert report.activity == "computing the pattern"
    assert 3 < report.seconds_left < 4


def newest(line, request):
    while (report := line.receive(5)).request < request:
        pass
    return report


def test_nothing_is_told_once_the_picture_is_there_or_live_view_stops(ends, awaited):
    for number, end in ((1, lambda: awaited.note_picture(1)), (2, lambda: awaited.set_live(False))):
        awaited.count_request()
        assert ends[1].receive(5).request == number
        end()
        time.sleep(0.15)
        while (report := ends[1].receive_nowait()) is not None:
            assert isinstance(report, PictureAwaited)
        time.sleep(0.25)
        assert ends[1].receive_nowait() is None


def test_a_picture_of_before_a_change_is_not_what_is_awaited(ends, awaited):
    awaited.count_request()
    awaited.count_request()
    awaited.note_picture(1)
    assert (awaited.newest, awaited.reached) == (2, 1)
    assert ends[1].receive(5).request == 2


@pytest.mark.parametrize("simulated", [True, False])
def test_a_long_frame_is_given_up_for_a_command(ends, simulated):
    """A real camera is cancelled; a simulated one looks for itself between its steps."""
    channel, window = ends
    world = SimpleNamespace(is_picture_unwanted=None) if simulated else None
    outdated = OutdatedFrame(channel, LiveTolerance(None), world)
    with outdated.watch():
        look = world.is_picture_unwanted if simulated else outdated.is_cancelled
        assert not look()
        window.send(SetExposure(0.1))
        late = time.monotonic() + 5
        while not look():
            assert time.monotonic() < late
        assert outdated.is_given_up
        assert outdated.is_cancelled() is not simulated
    channel.take_command(1)
    with outdated.watch():
        assert not outdated.is_given_up


def test_a_new_tolerance_gives_up_a_simulated_picture(ends):
    world = SimpleNamespace(imaging=SimpleNamespace(tol=0.01, decide_by="bound"))
    tolerance = LiveTolerance(world)
    outdated = OutdatedFrame(ends[0], tolerance, world)
    with outdated.watch(), tolerance.during_frame():
        assert not world.is_picture_unwanted()
        tolerance.set(1e-4)
        assert world.is_picture_unwanted()
        assert outdated.is_given_up
    assert not world.is_picture_unwanted()


def test_the_forecast_follows_the_machine(monkeypatch):
    """Planning isn't part of the time by work, but of the time of the last picture."""
    plan, clock = SimpleNamespace(work=2e9), [100.0]
    monkeypatch.setattr(picture_forecast.time, "monotonic", lambda: clock[0])

    def planned(situation):
        clock[0] += 3.0
        return plan

    world = SimpleNamespace(
        imaging=SimpleNamespace(plan=planned), situation=lambda exposure: exposure
    )
    forecast = PictureForecast(world)
    assert forecast.last_seconds is None
    with forecast.learn():
        assert forecast.expected_seconds(0.1) > 0
        clock[0] += 5.0
    assert forecast.last_seconds == 8.0
    plan.work = 4e9
    assert forecast.expected_seconds(0.1) == pytest.approx(10.0)
    with contextlib.suppress(RuntimeError), forecast.learn():
        clock[0] += 50.0
        raise RuntimeError
    assert forecast.expected_seconds(0.1) == pytest.approx(10.0)


def test_what_cannot_be_planned_has_no_forecast():
    def plan(situation):
        raise ValueError("no phase at this wavelength")

    world = SimpleNamespace(imaging=SimpleNamespace(plan=plan), situation=lambda exposure: exposure)
    assert PictureForecast(world).expected_seconds(0.1) is None
