"""`labapp explain`, as a person asks it."""

import json

import cv2
import numpy as np
import pytest
from small_bench.files import FULL_WELL, TINY

OVER = ["--exposure-ms", "20"]


@pytest.fixture
def ask(tiny, labapp):
    def asked(*options, scene=None):
        return labapp("explain", scene or tiny.scene, "--bench", tiny.bench, *options)

    return asked


def plan_of(ask, *options):
    code, printed, _ = ask("--json", *options)
    assert code == 0
    return json.loads(printed)


def test_the_table_names_every_effect_its_level_and_why(ask):
    code, printed, _ = ask("--target", "star", *OVER)
    assert code == 0
    flat = " ".join(printed.split())
    assert "star at 550 nm, 20 ms, tolerance 0.01" in flat
    for words in ("read noise", "diffraction", "left", "if off", "why", "2.4 electrons"):
        assert words in flat
    assert "The picture is within" in flat
    assert "of everything on, as estimated, for" in flat


def test_the_sum_of_all_bounds_keeps_within_the_tolerance(ask):
    for tol in ("0.1", "0.01"):
        data = plan_of(ask, "--target", "star", "--tol", tol, *OVER)
        assert data["tol"] == float(tol)
        assert sum(one["error"]["mean"] for one in data["decisions"]) >= 0
        assert data["error"] <= float(tol)
        assert data["error"] <= sum(one["relative"] for one in data["decisions"]) + 1e-12
        assert data["work"] <= data["most_work"]
        assert all(one["why"] and one["physics"] and one["source"] for one in data["decisions"])


def test_estimates_decide_unless_bounds_are_asked_for(ask):
    """The table says which; and what an effect's finest level would add, with the time of all."""
    estimated, proved = (
        plan_of(ask, "--target", "star", *more, *OVER) for more in ((), ("--decide-by", "bound"))
    )
    assert (estimated["decided_by"], proved["decided_by"]) == ("estimate", "bound")
    assert estimated["work"] <= proved["work"]
    for data in (estimated, proved):
        assert data["planning_cpu_s"] > 0
        assert 0 < data["picture_cpu_s"] <= data["finest_picture_cpu_s"]
        assert all(one["work"] <= one["finest_work"] * 1.001 for one in data["decisions"])
    for more, words in (((), "as estimated"), (("--decide-by", "bound"), "at most")):
        _, printed, _ = ask("--target", "star", *more, *OVER)
        flat = " ".join(printed.split())
        assert f"a level leaves, {words}." in flat
        assert "Deciding took" in flat
        assert "what its finest level would add" in flat


def test_without_an_exposure_the_brightest_pixel_is_half_full(ask, labapp, tiny):
    import h5py

    data = plan_of(ask, "--target", "star")
    out = tiny.folder / "one.h5"
    asked = ["--target", "star", "--exposure-ms", str(data["exposure_ms"]), "--out", out]
    code, _, complaint = labapp("simulate", tiny.scene, "--bench", tiny.bench, *asked)
    assert code == 0, complaint
    with h5py.File(out) as file:
        assert file["electrons"][...].max() == pytest.approx(0.5 * FULL_WELL, rel=0.15)


def test_the_first_lit_target_is_explained_and_darkness_has_an_exposure(ask):
    assert plan_of(ask)["target"] == "star"
    data = plan_of(ask, "--target", "dark")
    assert data["target"] == "dark"
    assert data["exposure_ms"] == 1000
    assert {"dark current", "read noise"} <= {one["effect"] for one in data["decisions"]}


def test_forced_effects_win_and_are_said_to_be(ask):
    data = plan_of(ask, "--target", "star", "--set", "read noise=off", *OVER)
    (line,) = (one for one in data["decisions"] if one["effect"] == "read noise")
    assert line["forced"]
    assert line["level"] == "off"
    assert data["error"] > data["tol"]
    _, printed, _ = ask("--target", "star", "--set", "read noise=off", *OVER)
    assert "off, forced" in " ".join(printed.split())


def test_an_effect_may_be_forced_to_a_level(ask):
    data = plan_of(ask, "--target", "star", "--set", "shot noise=Gaussian", *OVER)
    (line,) = (one for one in data["decisions"] if one["effect"] == "shot noise")
    assert line["forced"]
    assert line["level"] == "Gaussian"


def test_a_pattern_is_what_the_panel_shows(ask, tiny):
    path = tiny.folder / "pattern.png"
    steep = np.random.default_rng(0).integers(0, 200, TINY.panel, dtype=np.uint8)
    cv2.imwrite(str(path), steep)
    neutral = plan_of(ask, "--target", "star", *OVER)
    shown = plan_of(ask, "--target", "star", "--pattern", path, *OVER)
    changes = {
        one["effect"]: one["why"] for one in shown["decisions"] if one["effect"] == "PSF reach"
    }
    assert changes != {
        one["effect"]: one["why"] for one in neutral["decisions"] if one["effect"] == "PSF reach"
    }


def test_a_check_renders_the_middle_with_everything_on(ask):
    """What was planned is within its tolerance there; what is forced off is found missing."""
    tolerant = ("--target", "star", "--tol", "0.1", "--check", *OVER)
    data = plan_of(ask, *tolerant)
    assert 0 <= data["middle"]["mean"] <= 0.1
    _, printed, _ = ask(*tolerant)
    assert "The picture's middle is" in " ".join(printed.split())
    code, printed, _ = ask("--json", *tolerant, "--set", "shot noise=off")
    assert code in (0, 1)
    missing = json.loads(printed)["middle"]
    assert missing["sigma"] > 10 * data["middle"]["sigma"]
    assert plan_of(ask, "--target", "star", *OVER)["middle"] is None


@pytest.mark.parametrize("decide_by", ["estimate", "bound"])
def test_an_audit_says_of_each_error_whether_it_held(ask, decide_by):
    options = ("--target", "star", "--tol", "0.1", "--audit", "--pairs", "2", *OVER)
    options = (*options, "--decide-by", decide_by)
    data = plan_of(ask, *options)
    below = [one for one in data["decisions"] if one["level"] != one["levels"][-1]]
    singles = [one for one in data["audit"] if len(one["effects"]) == 1]
    assert len(singles) == 2 * len(below)
    assert len(data["audit"]) - len(singles) <= 2
    assert not any(one["broken"] for one in data["audit"])


@pytest.mark.sweep
def test_estimates_hold_where_a_grating_moves_the_picture(labapp, tmp_path):
    """The picture's finest detail then turns fastest over the filter's band."""
    grating = str(tmp_path / "grating.png")
    assert labapp("pattern", "blaze", "period_px=6.1", "angle_deg=75", "--out", grating)[0] == 0
    code, printed, _ = labapp(
        "explain", "display", "--pattern", grating, "--audit", "--pairs", "1", "--json"
    )
    assert not [one for one in json.loads(printed)["audit"] if one["broken"]]
    assert code == 0


@pytest.mark.sweep
def test_bounds_hold_in_pixels_that_get_little_of_a_star(labapp):
    """Few wavelengths change a dim pixel's noise most, far from the star's image."""
    options = ("--decide-by", "bound", "--set", "filter bandwidth=3", "--audit", "--pairs", "0")
    code, printed, _ = labapp("explain", "star", *options, "--json")
    audits = json.loads(printed)["audit"]
    assert ["filter bandwidth"] in [one["effects"] for one in audits]
    assert not [one for one in audits if one["broken"]]
    assert code == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--target", "moon"], ["moon", "dark, star"]),
        (["--set", "moonlight=on"], ["moonlight", "no such effect", "read noise"]),
        (["--set", "shot noise=loud"], ["loud", "Gaussian", "Poisson"]),
        (["--set", "shot noise"], ["an effect and its level"]),
        (["--exposure-ms", "0"], ["--exposure-ms 0", "positive"]),
        (["--exposure-ms", "nan"], ["--exposure-ms", "isn't a number"]),
        (["--tol", "0"], ["--tol 0", "between 0 and 1"]),
        (["--tol", "2"], ["--tol 2", "between 0 and 1"]),
        (["--decide-by", "guess"], ["--decide-by", "guess", "estimate", "bound"]),
        (["--wavelength-nm", "100"], ["100"]),
        (["--pairs", "-1", "--audit"], ["-1"]),
    ],
    ids=lambda value: " ".join(value) if value and value[0].startswith("--") else "",
)
def test_what_cannot_be_asked_is_said_in_words(ask, options, words):
    code, _, complaint = ask(*options)
    assert code != 0
    assert "Traceback" not in complaint
    for word in words:
        assert word in complaint


def test_a_pattern_of_another_panel_is_refused(ask, tiny):
    path = tiny.folder / "pattern.png"
    cv2.imwrite(str(path), np.zeros((10, 12), np.uint8))
    code, _, complaint = ask("--pattern", path)
    assert code == 1
    assert "12x10" in complaint
    assert "64x48" in complaint


def test_a_bench_of_real_devices_has_nothing_to_explain(ask, tiny):
    text = tiny.bench.read_text()
    tiny.bench.write_text(text.replace('"simulated-slm"', '"holoeye-slm"'))
    code, _, complaint = ask()
    assert code == 1
    assert "real devices" in complaint


def test_help_teaches(labapp):
    code, printed, _ = labapp("explain", "--help")
    assert code == 0
    for word in ("--target", "--audit", "--set", "EFFECT=LEVEL", "SCENE.toml", "to half"):
        assert word in printed
