"""Frames that show something else than they were taken for are doubted, and good ones aren't."""

import math

import numpy as np
import pytest
from plans import block, plan_of

from labapp.bench.opening import open_bench
from labapp.files.plan_file import Reconstruction
from labapp.runs.acquisition.attendance import Attendance, Idle
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.frame_doubts import (
    FrameDoubts,
    lack_of_light,
    light_in_the_dark,
    star_out_of_focus,
    star_that_is_none,
    target_doubt,
)
from labapp.runs.record.reader import Record
from labapp.runs.shots import Shot
from labapp.runs.state import State
from optics.camera import Camera, Sensor
from optics.progress import Cancelled, Progress

SENSOR = Sensor(bits=12, gain=2.6, read_noise=2.4, dark_current=1.0, black_level=64.0)
CAMERA = Camera(sensor=SENSOR)
SHAPE = (200, 300)


def frame(electrons, exposure=0.1, seed=1):
    """A frame of light in electrons, by EMVA 1288: Poisson and normal noise, gain, rounding."""
    rng = np.random.default_rng(seed)
    mean = np.broadcast_to(electrons, SHAPE) + SENSOR.dark_current * exposure
    read = rng.poisson(mean) + rng.normal(0, SENSOR.read_noise, SHAPE)
    counts = np.rint(read / SENSOR.gain + SENSOR.black_level)
    return np.clip(counts, 0, SENSOR.full_scale).astype(np.uint16)


def spot(width, peak):
    """A Gaussian star of a full width at half maximum in pixels, and a peak in electrons."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return peak * np.exp(-4 * math.log(2) * ((y - 90) ** 2 + (x - 140) ** 2) / width**2)


def saturated(image, share, seed=2):
    """The image with a share of its pixels at full scale."""
    hot = np.random.default_rng(seed).permutation(image.size)[: round(share * image.size)]
    image.flat[hot] = SENSOR.full_scale
    return image


@pytest.mark.parametrize("exposure", [1e-3, 0.1, 3.0, 30.0])
def test_a_dark_is_believed_with_its_hot_pixels(exposure):
    for seed in range(5):
        image = saturated(frame(0.0, exposure, seed), 1e-3, seed)
        assert light_in_the_dark(SENSOR, exposure, image) == ""


def test_a_dark_with_two_percent_of_saturated_pixels_is_doubted():
    said = light_in_the_dark(SENSOR, 0.1, saturated(frame(0.0), 0.02))
    assert said == "2 % of the pixels of this dark frame are saturated"


def test_a_dark_with_even_light_is_doubted():
    # 130 electrons are 50 DN.
    said = light_in_the_dark(SENSOR, 0.1, frame(130.0))
    assert said == "this dark frame reads 114 DN, and 64 DN are the dark's at most"


def test_a_target_without_light_is_doubted():
    assert lack_of_light(SENSOR, 0.1, frame(0.0)).startswith("no pixel has light")
    assert lack_of_light(SENSOR, 0.1, frame(spot(3.0, 200.0))) == ""


@pytest.mark.parametrize("width", [2.0, 5.0])
def test_a_star_is_a_point(width):
    image = frame(spot(width, 8000.0) + 2.0)
    assert star_that_is_none(SENSOR, 0.1, image) == ""
    assert star_out_of_focus(CAMERA, 550e-9, 0.1, image) == ""


def test_a_photograph_in_the_place_of_the_star_is_doubted():
    tiles = np.kron(np.random.default_rng(3).uniform(500, 5000, (10, 15)), np.ones((20, 20)))
    said = star_that_is_none(SENSOR, 0.1, frame(tiles))
    assert said.endswith("this is no star")


@pytest.mark.parametrize("width", [16.0, 30.0])
def test_a_wide_star_is_out_of_focus(width):
    said = star_out_of_focus(CAMERA, 550e-9, 0.1, frame(spot(width, 8000.0)))
    # Of a Gaussian, the area above half the peak is a disk as wide as the full width.
    seen = float(said.split()[3])
    assert seen == pytest.approx(width, abs=1.0)
    # 1.03 times 550 nm times f/5 focused at 2 m, on pixels of 3.45 µm: 0.88 of a pixel.
    assert said.endswith("pixels wide, and 1.0 in focus: focus the lens")


def test_a_clipped_or_a_dim_star_is_not_judged():
    wide = spot(30.0, 1e6)
    assert star_out_of_focus(CAMERA, 550e-9, 0.1, frame(wide)) == ""
    assert star_that_is_none(SENSOR, 0.1, frame(wide)) == ""
    assert star_out_of_focus(CAMERA, 550e-9, 0.1, frame(spot(30.0, 20.0))) == ""


def shot(target, exposure=0.1, role="light", pattern="neutral"):
    return Shot(0, 0, 0, target, pattern, 550e-9, exposure, role)


def test_roles_and_exposures_decide_what_is_judged():
    plan = plan_of(block(targets=["star"])).model_copy(
        update={"reconstruct": Reconstruction(coded="ring", star="pinhole", dark="cap")}
    )
    taken = [shot("pinhole", 0.1), shot("pinhole", 0.8), shot("cap", role="dark")]
    doubts = FrameDoubts(plan, CAMERA, taken)
    empty, wide = frame(0.0), frame(spot(30.0, 8000.0))
    assert doubts.doubt(taken[0], empty) == ""
    assert doubts.doubt(taken[1], empty).startswith("pinhole at 800 ms: no pixel has light")
    assert "30 pixels wide" in doubts.doubt(taken[0], wide)
    assert doubts.doubt(shot("pinhole", pattern="ring"), wide) == ""
    assert doubts.doubt(shot("star"), wide) == ""
    assert doubts.doubt(taken[2], empty) == ""
    assert "dark frame" in doubts.doubt(taken[2], frame(130.0))
    doubts.settle(taken[2])
    assert doubts.doubt(taken[2], frame(130.0)) == ""


def test_targets_that_a_person_places_are_judged_by_their_names():
    empty, lit, wide = frame(0.0), frame(130.0), frame(spot(30.0, 8000.0))
    for target, pattern, image, words in (
        ("dark", "neutral", empty, ""),
        ("dark", "neutral", lit, "this dark frame reads 114 DN"),
        ("star", "neutral", empty, "no pixel has light"),
        ("star", "neutral", wide, "the star is 30 pixels wide"),
        ("star", "ring", wide, ""),
        ("photograph", "neutral", empty, "no pixel has light"),
        ("photograph", "neutral", lit, ""),
    ):
        said = target_doubt(CAMERA, target, pattern, 550e-9, 0.1, image)
        assert said.startswith(words), (target, pattern)
        assert bool(said) == bool(words), (target, pattern)


@pytest.fixture
def small_bench(small):
    with open_bench(small.bench_files) as opened:
        yield opened


@pytest.fixture
def lit_darks():
    """Frames of a photograph that are called dark."""
    return plan_of(block(targets=["photograph"], exposures_ms=[400], repeats=2, role="dark"))


def test_a_run_takes_a_doubted_frame_again_and_keeps_it_when_told(small_bench, lit_darks, tmp_path):
    answers, said = iter([False, True]), []

    def judge(doubt, shot, frame, progress):
        said.append((doubt, shot.repeat, frame.number))
        return next(answers)

    outcome = run_plan(small_bench, lit_darks, tmp_path / "run.h5", Attendance(judge=judge))
    assert (outcome.state, outcome.message) == (State.COMPLETE, "")
    assert [repeat for _, repeat, _ in said] == [0, 0]
    assert said[0][2] < said[1][2]
    assert "photograph at 400 ms: this dark frame reads" in said[0][0]
    with Record(outcome.path) as record:
        assert record.frame_count == 2
        texts = [text for _, text in record.log]
    assert "taken again" in texts
    assert "kept by a person" in texts


def test_where_nobody_is_asked_the_log_has_the_doubt(small_bench, lit_darks, tmp_path):
    outcome = run_plan(small_bench, lit_darks, tmp_path / "run.h5")
    assert outcome.state is State.COMPLETE
    with Record(outcome.path) as record:
        assert sum("is doubted" in text for _, text in record.log) == 1


def test_a_resumed_run_asks_about_frames_and_pauses_for_its_caller(
    small_bench, lit_darks, tmp_path
):
    """Whether the record is given by its path or held makes no difference."""
    progress, asked, waited = Progress(), [], []

    def end(*given):
        progress.cancel()
        raise Cancelled

    path = tmp_path / "run.h5"
    assert run_plan(small_bench, lit_darks, path, Attendance(progress, judge=end)).missing

    class Waiting(Idle):
        def begin(self):
            waited.append(len(asked))
            again.resume()

    again = Progress()
    again.pause()

    def judge(doubt, *given):
        asked.append(doubt)
        return True

    resumed = resume_run(small_bench, path, Attendance(again, judge=judge, meanwhile=Waiting()))
    assert (resumed.state, waited, len(asked)) == (State.COMPLETE, [0], 1)
