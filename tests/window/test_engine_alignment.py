"""The engine's part in finding and focusing, without a window: it ends, and restores settings."""

import json
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import tifffile
from small_bench.setups import small_setup

from drivers.errors import DeviceError
from drivers.manual import ManualTargets
from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.runs.acquisition.attendance import wait_until
from labapp.window.commands import SetExposure, SetLive
from labapp.window.engine.alignment import EXPOSURE_JOB, Alignment
from labapp.window.engine.bench_controller import BenchController
from labapp.window.engine.frame_pacer import FramePacer
from labapp.window.engine.jobs import Jobs
from labapp.window.engine.kept_pictures import KeptPictures
from labapp.window.engine.waiting_view import WaitingView
from labapp.window.focus_history import KEPT_SECONDS, FocusHistory
from labapp.window.measuring_messages import (
    ExposureFound,
    FindExposure,
    PictureMeasured,
    RegionReading,
    StarReading,
)
from labapp.window.messages import BenchState, JobEnded, LiveFrame
from optics.progress import Cancelled, Progress
from simulator.faults import Fault


class FakeChannel:
    """A window that takes all, and sends what the test puts in line."""

    closed = False

    def __init__(self):
        self.reports, self.line = [], []

    def send(self, report):
        self.reports.append(report)

    def take_command_of(self, kinds, timeout):
        found = next((one for one in self.line if type(one) in kinds), None)
        if found is not None:
            self.line.remove(found)
        return found

    def of(self, kind):
        return [one for one in self.reports if isinstance(one, kind)]


class FakeSender:
    """Hands every picture to the window at once."""

    has_room = True

    def __init__(self, channel):
        self._channel, self.on_frame, self.discards = channel, lambda: None, 0

    def offer(self, frame, request=0, on_sent=lambda _: None):
        self._channel.send(frame)
        on_sent(frame)
        self.on_frame()

    def discard(self):
        self.discards += 1


class Desk:
    """A bench with the engine's parts around it, before the star."""

    def __init__(self, bench):
        self.bench, self.channel, self.errors = bench, FakeChannel(), []
        self.controller = BenchController(bench)
        self.controller.place_target("star")
        self.controller.set_exposure(1e-3)
        self.jobs = Jobs(self.channel)
        self.sender = FakeSender(self.channel)
        self.alignment = Alignment(bench, self.channel, self.sender, self.controller, self.jobs)
        self.waiting = WaitingView(
            bench,
            self.channel,
            self.sender,
            self.controller,
            FramePacer(self.sender),
            {FindExposure: self.alignment.by_bench[FindExposure]},
            self.alignment.offer,
            self.errors.append,
        )

    def wait(self, frames):
        """Wait as a run does, until so many frames have come."""
        wait_until(lambda: len(self.channel.of(LiveFrame)) >= frames, Progress(), self.waiting)


@contextmanager
def desk(**options):
    with open_bench(small_setup(**options)) as bench:
        made = Desk(bench)
        yield made
        made.channel.closed = True
        made.alignment.close()


def test_an_exposure_is_found_and_requested():
    with desk() as at:
        at.alignment.by_bench[FindExposure](FindExposure(0.6, (16, 32, 32, 32)))
        (found,) = at.channel.of(ExposureFound)
        assert found.level == pytest.approx(0.6, rel=0.06)
        assert at.controller.exposure == found.exposure
        at.controller.try_exposure(2e-3)
        at.controller.restore_settings()
        assert at.controller.exposure == found.exposure


def test_who_cancels_has_the_exposure_of_before():
    with desk() as at:
        at.sender.on_frame = lambda: at.jobs.cancel(EXPOSURE_JOB)
        at.alignment.by_bench[FindExposure](FindExposure(0.6, None))
        assert at.channel.of(ExposureFound) == []
        assert len(at.channel.of(LiveFrame)) == 1
        assert [one.job for one in at.channel.of(JobEnded)] == [EXPOSURE_JOB]
        assert at.controller.exposure == 1e-3


def test_darkness_leaves_the_exposure_and_says_why():
    with desk() as at:
        at.controller.place_target("dark")
        with pytest.raises(UserError, match="stays as it was: nothing is seen in the longest"):
            at.alignment.by_bench[FindExposure](FindExposure(0.6, None))
        assert at.controller.exposure == 1e-3


def test_a_wait_shows_pictures_and_sets_back_what_it_set():
    with desk() as at:
        at.channel.line.append(SetExposure(5e-3))
        at.wait(3)
        assert {one.exposure for one in at.channel.of(LiveFrame)} == {5e-3}
        assert at.controller.exposure == 1e-3
        states = at.channel.of(BenchState)
        assert states[0].live
        assert states[0].waiting
        assert not states[-1].live
        assert not states[-1].waiting


def test_a_wait_obeys_nothing_that_would_move_the_bench():
    with desk() as at:
        other = object()
        at.channel.line += [other, SetExposure(5e-3)]
        at.wait(2)
        assert at.channel.line == [other]


def test_pictures_of_a_wait_end_and_begin_by_f5():
    with desk() as at:
        at.channel.line.append(SetLive(False))
        looks = iter(range(8))
        wait_until(lambda: next(looks) == 7, Progress(), at.waiting)
        assert (at.channel.of(LiveFrame), at.errors) == ([], [])
        # None that was on its way comes after F5.
        assert at.sender.discards == 1
        at.channel.line += [SetLive(False), SetLive(True)]
        at.wait(1)
        assert at.errors == []


def test_a_camera_that_fails_in_a_wait_ends_the_pictures_and_not_the_run():
    with desk() as at:
        at.waiting.begin()
        broken = DeviceError("camera", "capture", "gone", "Mend it")

        def fail(cancelled):
            raise broken

        at.controller.take_frame = fail
        for _ in range(3):
            at.waiting.step(lambda: False)
        assert at.errors == [broken]
        at.waiting.end()
        assert not at.channel.of(BenchState)[-1].live


def test_faults_of_planned_frames_do_not_strike_in_a_wait():
    with desk(faults=[Fault("camera", "dropped frame", frame=0)]) as at:
        at.wait(3)
        assert at.errors == []
        assert at.bench.camera_world.faults.is_unused


def test_what_is_searched_for_ends_with_the_wait():
    with desk() as at:
        at.alignment.is_given_up = lambda: at.waiting.is_over
        at.channel.line.append(FindExposure(0.6, None))
        at.wait(1)
        assert at.channel.of(ExposureFound) == []
        assert at.controller.exposure == 1e-3


def test_a_target_that_is_being_placed_has_no_name(monkeypatch):
    with desk() as at:
        at.waiting.note_placing(True)
        at.wait(1)
        # The bench places it by itself, and knows what stands there.
        assert at.channel.of(LiveFrame)[-1].target == "star"
        by_hand = ManualTargets.by_hand
        monkeypatch.setattr(type(at.bench.targets), "by_hand", by_hand, raising=False)
        at.waiting.note_placing(True)
        at.wait(2)
        assert at.channel.of(LiveFrame)[-1].target == "being placed"


def test_a_cancelled_run_ends_its_wait():
    with desk() as at:
        progress = Progress()
        at.sender.on_frame = progress.cancel
        with pytest.raises(Cancelled):
            wait_until(lambda: False, progress, at.waiting)
        assert not at.channel.of(BenchState)[-1].waiting


def picture(number):
    image = np.full((64, 96), number, np.uint16)
    return LiveFrame(image, "star", "neutral", 550e-9, 1e-3, number)


def test_the_picture_that_is_shown_is_the_one_that_is_kept(tmp_path):
    with open_bench(small_setup()) as bench:
        kept = KeptPictures(bench)
        for number in range(1, 7):
            kept.offer(picture(number))
        first, second = kept.keep(4, tmp_path / "new"), kept.keep(4, tmp_path / "new")
        assert first != second
        with tifffile.TiffFile(first) as file:
            assert (file.asarray() == 4).all()
            assert json.loads(file.pages[0].description)["number"] == 4
        with pytest.raises(UserError, match="Picture 1 isn't there any more"):
            kept.keep(1, tmp_path)
        (tmp_path / "file").write_text("")
        with pytest.raises(UserError, match="Choose another place"):
            kept.keep(4, tmp_path / "file" / "new")


def measurement(taken_at, fwhm, *, target="star", top=0):
    star = None if fwhm is None else StarReading(5.0, 5.0, fwhm, fwhm, 0.0, 100.0, 0)
    region = RegionReading(
        (top, 0, 8, 8), 0.0, 0.0, 0, 0, 0, 0, None if fwhm is None else 1 / fwhm, "", star, ""
    )
    return PictureMeasured(1, target, 550e-9, taken_at, region, None)


def test_the_best_is_what_was_seen_steadily():
    history = FocusHistory()
    for moment, fwhm in enumerate([9.0, 9.0, 5.0, 5.0, 1.0, 5.0, 5.0, 9.0, 9.0, None]):
        history.add(measurement(float(moment), fwhm))
    # Of 1, once, the median of five knows nothing.
    assert history.best_fwhm == 5.0
    assert history.best_focus == pytest.approx(1 / 5)
    assert len(history.points) == 10


def test_what_does_not_compare_begins_a_course_of_its_own():
    history = FocusHistory()
    for moment in range(3):
        history.add(measurement(float(moment), 4.0))
    history.add(measurement(3.0, 8.0, top=1))
    assert [point.fwhm for point in history.points] == [8.0]
    history.add(measurement(4.0, 7.0, top=1, target="photograph"))
    assert history.best_fwhm == 7.0
    history.add(measurement(5.0 + KEPT_SECONDS, 6.0, top=1, target="photograph"))
    assert len(history.points) == 1
    history.add(replace(measurement(6.0, 1.0), region=None))
    assert len(history.points) == 1
    history.clear()
    assert history.best_fwhm is None
