"""Merging and reporting records that aren't the demo's."""

from __future__ import annotations

import numpy as np
import pytest

from labapp.bench.opening import open_bench
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.pictures.report.figures import histogram_figure
from labapp.pictures.report.record_analysis import analyse_record
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.record.writer import RecordWriter
from labapp.runs.state import State
from optics.progress import Cancelled, Progress


def acquire(small, path, **changes):
    plan = PlanFile.model_validate(read_file(small.plan, PlanFile).model_dump() | changes)
    with open_bench(small.bench_files) as bench:
        return run_plan(bench, plan, path).path


def roles(**changes):
    return {"coded": "lens", "photograph": "star", "psf_window_px": 31, "iterations": 5} | changes


def test_wavelengths_are_merged_apart(small, tmp_path):
    analysis = analyse_record(acquire(small, tmp_path / "run.h5"))
    named = [(b.target, b.pattern, round(b.wavelength * 1e9)) for b in analysis.brackets]
    assert named == [("star", pattern, nm) for pattern in ("neutral", "lens") for nm in (540, 550)]
    assert all(b.exposures == [0.001, 0.008] for b in analysis.brackets)


def test_a_merged_rate_is_the_light_that_the_world_sent(small, tmp_path):
    """The sum over the star in electrons per second, against the noise-free light."""
    path = acquire(small, tmp_path / "run.h5")
    with open_bench(small.bench_files) as bench:
        bench.world.target = "star"
        light = bench.world.electron_rates()[0].numpy()
    bracket = next(b for b in analyse_record(path).brackets if b.name == "star, neutral, 550 nm")
    bright = light > 0.1 * light.max()
    assert bracket.rate[bright].sum() == pytest.approx(light[bright].sum(), rel=0.02)


def test_several_wavelengths_need_one_to_be_named(small, tmp_path):
    path = acquire(small, tmp_path / "run.h5", reconstruct=roles())
    with pytest.raises(UserError, match=r"540, 550 nm.*'wavelength_nm'"):
        analyse_record(path)
    path = acquire(small, tmp_path / "named.h5", reconstruct=roles(wavelength_nm=540))
    restored = {"wiener", "richardson-lucy", "total-variation", "poisson-tv"}
    assert set(analyse_record(path).images) == {"neutral", "coded", *restored}


@pytest.mark.parametrize("wrong", [{"photograph": "photograph"}, {"neutral": "ring"}])
def test_a_part_that_the_plan_lacks_is_named(small, tmp_path, wrong):
    path = acquire(small, tmp_path / "run.h5", reconstruct=roles(wavelength_nm=540, **wrong))
    with pytest.raises(UserError, match=r"has no frames of .* at 540 nm"):
        analyse_record(path)


def test_an_incomplete_run_is_merged_but_not_reconstructed(small, tmp_path):
    progress = Progress()
    plan = read_file(small.plan, PlanFile)
    with open_bench(small.bench_files) as bench:
        outcome = run_plan(
            bench,
            plan,
            tmp_path / "run.h5",
            Attendance(
                progress=progress,
                on_frame=lambda shot, frame: progress.cancel() if shot.index == 9 else None,
            ),
        )
    (bracket,) = analyse_record(outcome.path).brackets
    assert bracket.name == "star, neutral, 540 nm"
    cancelled = acquire(small, tmp_path / "whole.h5", reconstruct=roles(wavelength_nm=540))
    with RecordWriter(cancelled) as writer:
        writer.set_state(State.CANCELLED)
    with pytest.raises(UserError, match="CANCELLED, and a reconstruction needs all"):
        analyse_record(cancelled)


def test_without_dark_frames_the_sensors_data_stand_in_and_say_so(small, tmp_path):
    path = acquire(
        small,
        tmp_path / "run.h5",
        acquire=[
            {
                "targets": ["star"],
                "patterns": ["neutral"],
                "wavelengths_nm": [550],
                "exposures_ms": [1],
            }
        ],
    )
    (bracket,) = analyse_record(path).brackets
    assert bracket.dark_frames == 0
    assert abs(np.median(bracket.rate)) < 1000


def test_analysis_can_be_cancelled(small, tmp_path):
    path, progress = acquire(small, tmp_path / "run.h5"), Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        analyse_record(path, progress)


def test_a_record_without_a_reconstruction_has_a_gallery(labapp, small, tmp_path):
    path = acquire(small, tmp_path / "run.h5")
    code, printed, _ = labapp("report", path)
    assert code == 0
    assert "540" in printed
    page = (tmp_path / "report.html").read_text()
    assert "The merged pictures" in page
    with Record(path) as record:
        assert record.text("title") in page


def test_a_star_out_of_focus_is_reported_and_not_an_error(labapp, small, tmp_path):
    """Its neutral PSF is no peak, and the ring's centre isn't dark."""
    text = small.scene.read_text()
    small.scene.write_text(text.replace("distance_m = 2.0", "distance_m = 1.5"))
    ring = {"kind": "ring", "radius_um": 40, "width_um": 6, "iterations": 3}
    block = {"wavelengths_nm": [550], "exposures_ms": [1, 8]}
    path = acquire(
        small,
        tmp_path / "run.h5",
        patterns={"neutral": {"kind": "constant"}, "ring": ring},
        acquire=[
            {"targets": ["dark"], "patterns": ["neutral"], **block},
            {"targets": ["star", "photograph"], "patterns": ["neutral", "ring"], **block},
        ],
        reconstruct=roles(coded="ring", photograph="photograph", psf_window_px=61),
    )
    code, printed, _ = labapp("report", path)
    assert code == 0
    assert "light of the star inside the window" in printed
    assert 0 < analyse_record(path).psf.share_in_window < 0.95


def test_a_report_of_many_brackets_stays_readable(labapp, small, tmp_path):
    """Two brackets of six exposures: their 12 names would leave little room for the curves."""
    block = {
        "targets": ["star"],
        "patterns": ["neutral", "lens"],
        "wavelengths_nm": [550],
        "exposures_ms": [1, 2, 3, 4, 6, 8],
    }
    path = acquire(small, tmp_path / "run.h5", acquire=[block])
    code, _, errors = labapp("report", path, "--out", tmp_path)
    assert (code, errors) == (0, "")
    figure = histogram_figure(analyse_record(path))
    (axes,) = figure.axes
    assert axes.get_title() == "Exposures (the first 10 of 12)"
    assert len(axes.get_legend().get_texts()) == 10
