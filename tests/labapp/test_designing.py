"""`labapp pattern` and `labapp retrieve`: patterns as files, and the PSF that they will give."""

from __future__ import annotations

import json
import math

import cv2
import h5py
import numpy as np
import pytest
import torch

from labapp.bench.opening import open_bench
from labapp.files.bench_file import BenchFile
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.prediction.pattern_psf import predicted_psf
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from optics import patterns
from optics.camera import Camera, Panel
from optics.psf import PSFOperator
from optics.slm import grey_to_phase, phase_to_grey
from optics.targets import ring

pytestmark = pytest.mark.usefixtures("white_sheets")

PANEL = Panel(shape=(108, 192), pitch=80e-6, fill_factor=0.9)
WAVE = 550e-9


@pytest.fixture
def bench(small):
    return ["--bench", str(small.bench)]


def picture(path) -> np.ndarray:
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None
    return found


def lens() -> np.ndarray:
    return phase_to_grey(PANEL, patterns.fresnel_lens(PANEL, 20.0, WAVE), WAVE).numpy()


@pytest.mark.usefixtures("drawn")
def test_a_pattern_is_a_grey_picture_for_any_slm_software(labapp, bench, tmp_path):
    code, out, _ = labapp(
        "pattern", "lens", "focal_length_m=20", "--out", tmp_path / "a.png", *bench
    )
    assert code == 0
    grey = picture(tmp_path / "a.png")
    assert grey.dtype == np.uint8
    assert (grey == lens()).all()
    assert "a.png" in out
    drawn = picture(tmp_path / "a_psf.png")
    assert len(np.unique(drawn.reshape(-1, drawn.shape[-1]), axis=0)) > 50


def test_a_written_pattern_is_what_a_run_shows(labapp, bench, small, tmp_path):
    """PNG and design file, through the plan's image patterns into the record."""
    for name in ("a.png", "a.h5"):
        code, *_ = labapp(
            "pattern", "lens", "focal_length_m=20", "--out", tmp_path / name, *bench, "--force"
        )
        assert code == 0
    images = {name: {"kind": "image", "file": str(tmp_path / name)} for name in ("a.png", "a.h5")}
    block = {
        "targets": ["star"],
        "patterns": list(images),
        "wavelengths_nm": [550],
        "exposures_ms": [1],
    }
    plan = PlanFile.model_validate(
        {"version": 1, "title": "Images", "patterns": images, "acquire": [block]}
    )
    with open_bench(small.bench_files) as opened:
        path = run_plan(opened, plan, tmp_path / "run.h5").path
    with Record(path) as record:
        for name in images:
            assert (record.pattern(name) == lens()).all()


def test_a_design_file_says_how_it_was_made(labapp, bench, small, tmp_path):
    path = tmp_path / "ring.h5"
    code, out, _ = labapp(
        "retrieve", "ring", "radius_um=50", "width_um=8", "--iterations", "20", "--seed", "5",
        "--wavelength-nm", "532", "--out", path, "--json", *bench,
    )  # fmt: skip
    assert code == 0
    data = json.loads(out)
    with h5py.File(path) as file:
        entry = file["entry"]
        assert entry["definition"][()] == b"labapp_design"
        settings = json.loads(entry["settings"][()])
        assert settings["seed"] == 5
        assert settings["pattern"]["target"] == {"shape": "ring", "radius_um": 50, "width_um": 8}
        found = BenchFile.model_validate(json.loads(entry["bench"][()]))
        assert found == read_file(small.bench, BenchFile)
        assert set(json.loads(entry["versions"][()])) >= {"labapp", "torch"}
        assert entry["wavelength"][()] == pytest.approx(532e-9)
        assert entry["wavelength"].attrs["units"] == "m"
        grey, phase = entry["pattern/grey"][()], entry["pattern/phase"][()]
        assert grey.shape == phase.shape == (1, *PANEL.shape)
        assert (phase_to_grey(PANEL, torch.from_numpy(phase), 532e-9).numpy() == grey).all()
        # Axes as NeXus names them, metres, and the shapes that they go with.
        for name, signal in (("psf", "predicted"), ("target", "image")):
            group = entry[name]
            assert group.attrs["signal"] == signal
            assert list(group.attrs["axes"]) == ["moment", "y", "x"]
            lengths = tuple(len(group[axis]) for axis in ("moment", "y", "x"))
            assert group[signal].shape == lengths
            assert group["x"].attrs["units"] == "m"
        y, x = (entry["target"][axis][()] for axis in ("y", "x"))
        target = entry["target/image"][0]
        distance = np.hypot(y[:, None], x[None, :])
        assert np.average(distance, weights=target) == pytest.approx(50e-6, rel=0.05)
        quality = entry["quality"]
        assert quality["efficiency"][()].tolist() == data["quality"]["efficiency"]
        assert quality["method"][()].decode() == data["quality"]["method"]
    steered, efficiency = (data["quality"][one][0] for one in ("steered_share", "efficiency"))
    assert steered > 0.8
    # The panel's fill factor is 0.87, and a little unmodulated light falls on the ring.
    assert 0.6 < efficiency < 0.87 * steered + 0.05
    assert data["files"] == [str(path), str(tmp_path / "ring_psf.png")]


def test_phases_of_thousands_of_radians_are_kept_to_a_fraction_of_a_level(labapp, bench, tmp_path):
    """Against the formula in double precision, modulo the two waves that it is shown in."""
    asked = ("pattern", "lens", "focal_length_m=320", "centre_mm=[1000, 0]", "orders=2", *bench)
    assert labapp(*asked, "--out", tmp_path / "l.h5")[0] == 0
    with h5py.File(tmp_path / "l.h5") as file:
        phase, orders = file["entry/pattern/phase"][0], file["entry/pattern/orders"][()]
    truth = patterns.fresnel_lens(PANEL, 320.0, WAVE, (1.0, 0.0)).numpy()
    assert np.abs(truth).min() > 15_000
    wave = 2 * math.pi * 2
    assert orders == 2
    assert phase.min() >= 0
    assert phase.max() <= np.float32(wave)
    assert np.abs((phase - truth + wave / 2) % wave - wave / 2).max() < 2e-6


@pytest.mark.usefixtures("drawn")
def test_a_video_is_numbered_pictures_or_one_design_file(labapp, bench, tmp_path):
    asked = ("retrieve", "spiral", "radius_um=50", "--frames", "3", "--iterations", "5", *bench)
    code, out, _ = labapp(*asked, "--out", tmp_path / "v.png")
    assert code == 0
    frames = [picture(tmp_path / f"v_{k:03}.png") for k in range(3)]
    assert not (tmp_path / "v.png").exists()
    assert "v_000.png ... v_002.png" in out
    assert labapp(*asked, "--out", tmp_path / "v.h5", "--force")[0] == 0
    with h5py.File(tmp_path / "v.h5") as file:
        assert (file["entry/pattern/grey"][()] == frames).all()
        assert file["entry/pattern/frame_time"][()] == pytest.approx(1 / 60)


def test_a_target_that_moves_has_a_psf_for_every_moment(labapp, bench, tmp_path):
    """The mean distance of its light from the axis shrinks with it."""
    code, out, _ = labapp(
        "retrieve", "shrinking-spiral", "radius_um=60", "moments=2", "smallest=0.5",
        "--frames", "4", "--iterations", "20", "--out", tmp_path / "s.h5", "--json", *bench,
    )  # fmt: skip
    assert code == 0
    assert len(json.loads(out)["quality"]["efficiency"]) == 2
    with h5py.File(tmp_path / "s.h5") as file:
        psf = file["entry/psf/predicted"][()]
        y, x = (file["entry/psf"][axis][()] for axis in "yx")
    distance = np.hypot(y[:, None], x[None, :])
    # Unmodulated light is in the middle.
    away = [np.average(distance, weights=one * (distance > 10e-6)) for one in psf]
    assert away[1] / away[0] == pytest.approx(0.5, abs=0.15)


def test_the_predicted_psf_is_the_panel_operators_own(small):
    """A still pattern: the modulated light and the unmodulated share, by one call."""
    camera = read_file(small.bench, BenchFile).build_camera()
    grey = torch.from_numpy(lens())
    pixels = camera.sensor.window_plane((40, 40))
    (seen,) = predicted_psf(camera, grey[None], WAVE, pixels)
    operator = PSFOperator(camera, camera.lens.focus_distance, WAVE, pixels)
    truth = operator(grey_to_phase(camera.panel, grey, WAVE))
    assert torch.allclose(seen, truth, rtol=1e-3, atol=1e-3 * float(truth.max()))


def test_the_predicted_psf_of_a_video_is_the_mean_of_its_frames():
    camera = Camera(Panel(shape=(54, 96), pitch=160e-6))
    greys = torch.randint(0, 80, (4, 54, 96), generator=torch.Generator().manual_seed(0))
    greys = greys.to(torch.uint8)
    pixels = camera.sensor.window_plane((24, 24))
    whole = predicted_psf(camera, greys, WAVE, pixels)
    parts = predicted_psf(camera, greys, WAVE, pixels, moments=2)
    singles = torch.cat([predicted_psf(camera, grey[None], WAVE, pixels) for grey in greys])
    assert parts.shape == (2, 24, 24)
    assert torch.allclose(whole[0], singles.mean(0), rtol=1e-4)
    assert torch.allclose(parts, singles.reshape(2, 2, 24, 24).mean(1), rtol=1e-4)


def test_a_pattern_can_be_steered_and_its_psf_is_predicted_there(labapp, bench, tmp_path):
    code, *_ = labapp(
        "pattern", "blaze", "shift_um=[-30, 60]", "--size", "64", "--out", tmp_path / "b.h5", *bench
    )
    assert code == 0
    with h5py.File(tmp_path / "b.h5") as file:
        psf, y, x = (file[f"entry/psf/{name}"][()] for name in ("predicted", "y", "x"))
    row, column = np.unravel_index(psf[0].argmax(), psf[0].shape)
    assert psf.shape == (1, 64, 64)
    assert (y[row], x[column]) == pytest.approx((-30e-6, 60e-6), abs=3.5e-6)


@pytest.mark.parametrize("command", ["pattern", "retrieve"])
def test_the_list_names_every_kind_with_its_keys_and_defaults(labapp, command):
    code, out, _ = labapp(command, "list")
    assert code == 0
    listed = json.loads(labapp(command, "list", "--json")[1])
    for one in listed:
        assert f"{one['name']}: " in out
        assert one["what"]
        for key in one["keys"]:
            assert key["key"] in out
            assert key["what"], key["key"]
    known = {one["name"]: {key["key"]: key for key in one["keys"]} for one in listed}
    if command == "pattern":
        assert known["lens"]["focal_length_m"]["default"] == "needed"
        assert known["lens"]["wavelength_nm"]["default"] == "550"
        assert known["lens"]["focal_length_m"]["what"].startswith("m, ")
    else:
        assert known["dispersion"]["um_per_nm"]["what"].startswith("µm a nm")
        assert {"ring", "spiral", "dots", "heart", "infinity", "eye", "letters", "logo"} <= set(
            known
        )


def test_text_stays_text_and_tables_are_toml(labapp, bench, tmp_path):
    """2026 is no number here, and a sum's parts are tables."""
    asked = ("--iterations", "2", "--out", tmp_path / "t.h5", *bench)
    assert labapp("retrieve", "letters", "text=2026", "height_um=40", *asked)[0] == 0
    with h5py.File(tmp_path / "t.h5") as file:
        assert json.loads(file["entry/settings"][()])["pattern"]["target"]["text"] == "2026"
    parts = 'parts=[{kind="lens",focal_length_m=20},{kind="sine"}]'
    code, out, _ = labapp(
        "pattern", "sum", parts, "--wavelength-nm", "600", "--out", tmp_path / "s.png", *bench
    )
    assert code == 0
    assert "lens 20 m + sine" in out


WRONG = [
    (("pattern", "lenz"), "pattern 'lenz' is not known. Choose one of constant, grating, image"),
    (("retrieve", "cat"), "target 'cat' is not known. Choose one of ring, spiral"),
    (("pattern", "lens"), "pattern lens: key 'focal_length_m' is missing"),
    (("pattern", "lens", "f=1", "focal_length_m=1"), "pattern lens: key 'f' is unknown"),
    (("pattern", "lens", "20"), "'20' is no KEY=VALUE. The keys are"),
    (("pattern", "lens", "focal_length_m=far"), "key 'focal_length_m' is 'far': it is a text"),
    (("pattern", "lens", "focal_length_m=0.001"), "lens 0.001 m for 550 nm: focal_length changes"),
    (("pattern", "cubic", "--frames", "2"), "2 frames: its frames would all be alike"),
    (("retrieve", "ring", "width_um=-1"), "target ring: key 'width_um' is -1: input should be"),
    (("retrieve", "ring", "--method", "luck"), "target ring: key 'method' is 'luck'"),
    (("retrieve", "ring", "--budget", "0"), "target ring: key 'budget_s' is 0"),
    (("retrieve", "ring", "--budget", "1", "--iterations", "1"), "either budget_s or iterations"),
    (("retrieve", "shrinking-spiral"), "make a video of 2 frames or more"),
    (("retrieve", "ring", "radius_um=1e6"), "ring 1e+06/8 µm for 550 nm: the target reaches"),
    (("pattern", "cubic", "--wavelength-nm", "3000"), "wavelength 3000 nm is outside"),
]


@pytest.mark.parametrize(("words", "message"), WRONG, ids=lambda one: " ".join(one))
def test_what_cannot_be_made_is_one_clear_line(labapp, bench, tmp_path, words, message):
    code, out, err = labapp(*words, "--out", tmp_path / "x.png", *bench)
    assert code == 1
    assert message in err
    assert not out
    assert not list(tmp_path.glob("x*"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "there is no --out. Name a .png or .h5 file"),
        (("--out", "x.jpg"), "x.jpg: the ending must be one of .png, .h5"),
        (("--out", "nowhere/x.png"), "nowhere: is not a folder"),
    ],
)
def test_where_it_cannot_be_written_is_said_first(labapp, options, message):
    code, _, err = labapp("pattern", "cubic", *options)
    assert code == 1
    assert message in err


@pytest.mark.parametrize("name", ["a.png", "a_psf.png"])
def test_nothing_is_replaced_without_leave(labapp, bench, tmp_path, name):
    (tmp_path / name).write_bytes(b"mine")
    asked = ("pattern", "cubic", "strength_rad=20", "--out", tmp_path / "a.png", *bench)
    code, _, err = labapp(*asked)
    assert code == 1
    assert f"{name}: exists already" in err
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == [name]
    assert labapp(*asked, "--force")[0] == 0
    assert (tmp_path / name).read_bytes() != b"mine"


def test_the_same_seed_makes_the_same_pattern(labapp, bench, tmp_path):
    asked = ("retrieve", "heart", "radius_um=50", "--iterations", "3", "--frames", "2", *bench)
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert labapp(*asked, "--seed", seed, "--out", tmp_path / f"{name}.png")[0] == 0
    one, same, other = (picture(tmp_path / f"{name}_001.png") for name in "abc")
    assert (one == same).all()
    assert (one != other).any()


def test_the_figures_are_those_of_the_files(labapp, bench, tmp_path):
    """The light in the window is the sum of the predicted PSF; a ring is where it was asked."""
    code, out, _ = labapp(
        "retrieve", "ring", "radius_um=50", "--out", tmp_path / "r.h5", "--json", *bench
    )
    assert code == 0
    data = json.loads(out)
    with h5py.File(tmp_path / "r.h5") as file:
        psf = file["entry/psf/predicted"][0]
        y, x = (file["entry/psf"][axis][()] for axis in "yx")
    assert psf.sum() == pytest.approx(data["light_in_window"][0])
    assert psf.max() == pytest.approx(data["brightest_pixel"][0])
    on_ring = np.abs(np.hypot(y[:, None], x[None, :]) - 50e-6) < 3 * 8e-6
    # 90 % fill factor, 5 % unmodulated, and what the ring's own efficiency leaves.
    assert psf[on_ring].sum() > 0.7
    reach = ring.reach(50e-6, 8e-6)
    assert math.isclose(-y[0], x[-1] + 3.45e-6, rel_tol=1e-6)
    assert x[-1] > reach
