"""The demo as a user gets it: the pictures are real, and so are the figures."""

from __future__ import annotations

import json
import re

import cv2
import numpy as np
import pytest
from figures.first_light import prediction_error
from figures.star_energy import DECADES, GOAL, measure_star

from labapp.files.reading import bundled_path
from labapp.pictures.report.tables import as_data
from labapp.runs.record.reader import Record
from labapp.runs.state import State


def test_the_best_reconstruction_gains_three_decibels_and_structure(demo):
    scores = demo.analysis.scores
    best = scores[demo.analysis.best_method]
    assert best.psnr >= scores["coded"].psnr + 3
    assert best.ssim > scores["coded"].ssim


@pytest.mark.sweep
def test_the_measured_psf_is_that_of_a_direct_quadrature(demo):
    """The judge shares no code with the engine; 5 % leaves room for the star's photons."""
    assert prediction_error(demo.record) <= 0.05


def test_the_unmodulated_share_is_found_again(demo):
    # The bench file says 5 %.
    assert demo.analysis.psf.unmodulated == pytest.approx(0.05, abs=0.005)


def test_the_ring_lies_where_the_plan_wants_it(demo):
    """80 µm on a sensor of 3.45 µm pixels."""
    shape = demo.analysis.psf.modulated_psf
    y, x = np.indices(shape.shape) - shape.shape[0] // 2
    radius = np.hypot(y, x)
    around = np.abs(radius - 80 / 3.45) < 8
    assert (shape * radius)[around].sum() / shape[around].sum() == pytest.approx(
        80 / 3.45, rel=0.02
    )


def test_merged_rates_agree_with_every_unclipped_exposure(demo):
    """An exposure without clipping, less its dark frame, is an estimate of its own."""
    bracket = next(b for b in demo.analysis.brackets if b.target == "photograph")
    with Record(demo.record) as record:
        camera = record.bench.build_camera()
        index = record.select(target="photograph", pattern="neutral", exposure_asked=0.4)[0]
        darks = record.select(target="dark", exposure_asked=0.4)
        dark = np.mean([record.image(i) for i in darks], axis=0)
        single = (record.image(index) - dark) * camera.sensor.gain / 0.4
    assert bracket.rate.mean() == pytest.approx(single.mean(), rel=2e-3)


@pytest.mark.sweep
def test_the_stars_energy_is_the_noise_free_light_each_decade_below_the_peak(demo, tmp_path):
    found = measure_star(demo.record, tmp_path)
    assert len(found.rings) >= DECADES - 1
    assert found.worst <= GOAL


def test_the_record_is_complete_and_says_that_it_is_simulated(demo):
    with Record(demo.record) as record:
        assert record.state is State.COMPLETE
        assert record.simulated_devices == ["camera", "filter", "slm", "targets"]
        plans = record.effect_plan["plans"]
    assert {(one["pattern"], one["wavelength_nm"]) for one in plans} == {
        ("neutral", 550.0), ("ring", 550.0)
    }  # fmt: skip
    assert {one["target"] for one in plans} >= {"dark", "star", "photograph"}


def test_the_report_needs_nothing_else(demo):
    page = (demo.folder / "report.html").read_text()
    sources = re.findall(r'(?:src|href)="([^"]{0,40})', page)
    assert len(sources) >= 7
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "SIMULATED" in page
    for heading in ("Exposures", "Point spread function", "Photographs", "Time"):
        assert heading in page
    # How restorations used the variance map, and what it gained.
    assert "dB expected against one noise for all pixels" in page
    picture = cv2.imread(str(demo.folder / "report.png"))
    assert min(picture.shape[:2]) > 1000
    assert picture.std() > 20


def test_the_figures_as_data_are_json(demo):
    data = json.loads(json.dumps(as_data(demo.analysis), allow_nan=False))
    assert data["best"] in data["scores"]
    assert {"compute patterns", "acquire", "merge exposures", "report"} <= set(data["seconds"])
    assert len(data["exposures"]) == 4
    assert "used: " in data["variance_map"]["total-variation"]
    assert data["calibrations"] == data["calibration_doubts"] == []


@pytest.mark.sweep
def test_a_report_is_made_again_from_the_record_alone(demo, labapp, tmp_path):
    code, printed, _ = labapp("report", demo.record, "--out", tmp_path, "--json")
    assert code == 0
    said = json.loads(printed)
    for name, score in demo.analysis.scores.items():
        assert said["scores"][name]["psnr_db"] == pytest.approx(score.psnr, abs=1e-6)
    assert {p.name for p in tmp_path.iterdir()} == {"report.png", "report.html"}
    code, _, complaint = labapp("report", demo.record, "--out", tmp_path)
    assert code == 1
    assert "--force" in complaint


@pytest.mark.sweep
def test_the_demos_photograph_is_restored_from_its_record(labapp, demo, tmp_path):
    """Against the neutral photograph of the same run, which the restoration doesn't see."""
    out = tmp_path / "after.npy"
    code, _, errors = labapp("reconstruct", demo.record, "--out", out, "--json")
    assert code == 0, errors
    brackets = {b.pattern: b.rate for b in demo.analysis.brackets if b.target == "photograph"}
    white = np.percentile(brackets["neutral"], 99.9)
    truth, coded = brackets["neutral"] / white, brackets["ring"] / white
    middle = (slice(26, -26), slice(39, -39))
    after = np.load(out) / white
    assert psnr(after[middle], truth[middle]) > psnr(coded[middle], truth[middle]) + 6


def psnr(image, truth):
    return 10 * np.log10(1 / np.mean((image - truth) ** 2))


def test_show_tells_what_a_record_holds(demo, labapp):
    code, printed, _ = labapp("show", demo.record)
    assert code == 0
    for word in ("COMPLETE", "SIMULATED", "simulated camera", "shot noise", "100, 400, 1600"):
        assert word in printed
    code, printed, _ = labapp("show", demo.record, "--json")
    assert json.loads(printed)["state"] == "COMPLETE"


def test_devices_tells_what_there_is_to_work_with(labapp):
    code, printed, _ = labapp("devices", "--json")
    said = json.loads(printed)
    assert code == 0
    assert {d["kind"] for d in said["devices"]} == {"SIMULATED"}
    assert said["drivers"]["simulated-camera"] == ""


def test_a_device_that_is_not_there_hides_no_other(labapp, tmp_path):
    bench = tmp_path / "bench.toml"
    text = bundled_path("bench.toml").read_text()
    bench.write_text(
        text.replace('"simulated-spectroradiometer"', '"cs2000"\noptions = { port = "/dev/none" }')
    )
    code, printed, _ = labapp("devices", "--json", "--bench", bench)
    *others, last = json.loads(printed)["devices"]
    assert code == 0
    assert {d["kind"] for d in others} == {"SIMULATED"}
    assert (last["device"], last["model"], last["kind"]) == (
        "spectroradiometer",
        "cs2000",
        "FAILED",
    )
    assert "/dev/none" in last["limits"]


@pytest.mark.sweep
def test_a_users_own_photograph_is_taken(labapp, tmp_path):
    """A checkerboard of any size and depth fills the frame."""
    board = (np.indices((90, 130)) // 10).sum(0) % 2 * np.uint16(60000)
    cv2.imwrite(str(tmp_path / "mine.png"), board.astype(np.uint16))
    code, printed, _ = labapp(
        "demo", "--image", tmp_path / "mine.png", "--out", tmp_path / "out", "--json"
    )
    assert code == 0
    assert json.loads(printed)["best"]
    with Record(tmp_path / "out" / "run.h5") as record:
        index = record.select(target="photograph", pattern="neutral", exposure_asked=0.4)[0]
        image = record.image(index).astype(float)
    corners = [image[:60, :60], image[:60, -60:], image[-60:, :60], image[-60:, -60:]]
    assert all(corner.std() > 100 for corner in corners)
