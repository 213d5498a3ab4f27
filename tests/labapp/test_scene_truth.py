"""A virtual bench that isn't what its bench file says: [truth] in the scene file."""

import math

import h5py
import numpy as np
import pytest
import torch
from figures.durability import differing_arrays

from labapp.bench.opening import open_bench, read_scene
from labapp.common.errors import UserError
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled_path, read_file
from labapp.files.scene_file import SceneFile
from labapp.runs.acquisition.attendance import Attendance
from labapp.runs.acquisition.runner import resume_run, run_plan
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import bench_setup_of
from labapp.runs.state import State
from optics.camera import Ghost
from optics.progress import Progress
from optics.slm import max_phase
from simulator.mount import Mount

TRUTH = """
[truth]
vibration_um = 1.5
vibration_hz = 30
ghosts = [{ share = 0.02, magnification = -1.5, blur_mm = 2 }]
focus_drift_um = 15
focus_drift_s = 900

[truth.panel]
unmodulated = 0.08
coupling_um = 9.0
response_time_ms = 4.0
flicker = 0.01
jitter_rad = 0.1
gap_reflection = 0.2
front_reflection = 0.004
response = { gamma = 1.3, wiggle = 0.02, range = 0.92 }
flatness = [[2, 2, 80.0], [4, 0, -30.0]]
illumination = { radius_mm = 9.0, centre_mm = [0.5, -1.0] }

[truth.lens]
focal_length_mm = 124.0
focus_distance_m = 1.9
aberrations = [[3, 1, 50.0]]
relative_illumination = [[0, 1], [20, 0.5]]
distortion = [-0.2, 0.1]
axial_colour = [[450, 0.4], [550, 0]]
field_aberrations = { height_mm = 8, coma_nm = 0.9, curvature_nm = -0.3 }
lateral_colour = [[450, -0.0004], [550, 0]]

[truth.sensor]
crosstalk_percent = 3
dust = [[10, 20, 5]]
dust_distance_um = 900

[truth.filter]
effective_index = 1.9

[truth.mount]
rotation_deg = 1.7
flip_x = true
"""


@pytest.fixture
def plan(small) -> PlanFile:
    return read_file(small.plan, PlanFile)


def add(small, text: str) -> None:
    """To the scene file."""
    small.scene.write_text(small.scene.read_text() + text)


def replaced(small, old: str, new: str) -> None:
    text = small.scene.read_text()
    assert old in text
    small.scene.write_text(text.replace(old, new, 1))


def test_a_bench_is_what_the_truth_says_and_is_described_as_before(small):
    with open_bench(small.bench_files) as plain:
        described = plain.description
        assert plain.world.camera == described
    add(small, TRUTH)
    with open_bench(small.bench_files) as bench:
        assert bench.description == described
        panel, lens = bench.world.camera.panel, bench.world.camera.lens
        sensor, camera = bench.world.camera.sensor, bench.world.camera
        assert bench.world.situation().band.effective_index == 1.9
        assert not bench.world.band.shifts_with_angle
    assert (camera.vibration, camera.vibration_frequency) == (1.5e-6, 30)
    assert camera.ghosts == (Ghost(0.02, -1.5, 2e-3),)
    assert (camera.focus_drift, camera.focus_drift_time) == (pytest.approx(15e-6), 900)
    assert (sensor.crosstalk, sensor.dust_distance) == pytest.approx((0.03, 9e-4))
    assert sensor.dust == ((10 * 1e-6, 20 * 1e-6, 5 * 1e-6),)
    assert sensor.shape == described.sensor.shape
    assert (panel.unmodulated, panel.coupling, panel.response_time) == (0.08, 9e-6, 4e-3)
    assert (panel.flicker, panel.jitter) == (0.01, 0.1)
    assert (panel.gap_reflection, panel.front_reflection) == (0.2, 0.004)
    assert (panel.shape, panel.fill_factor) == (described.panel.shape, 0.9)
    share = 0.92 * ((100 / 255) ** 1.3 + 0.02 * math.sin(2 * math.pi * 100 / 255))
    assert float(panel.response.at(550e-9)[0, 0, 100]) == pytest.approx(share)
    assert max_phase(panel, 532e-9) == pytest.approx(6.7 * math.pi)
    # Z(2, 2) is sqrt(6) (x² - y²), Z(4, 0) is sqrt(5) (6 r⁴ - 6 r² + 1), on the circle around.
    reach = 40e-6 * math.hypot(108, 192)
    y, x = (p / reach for p in panel.plane.mesh())
    r2 = x**2 + y**2
    path = 80e-9 * math.sqrt(6) * (x**2 - y**2)
    path = path - 30e-9 * math.sqrt(5) * (6 * r2**2 - 6 * r2 + 1)
    assert torch.allclose(panel.flatness.at_pixels(panel), path, atol=1e-18)
    y, x = panel.plane.mesh()
    beam = torch.exp(-2 * ((y - 0.5e-3) ** 2 + (x + 1e-3) ** 2) / 9e-3**2)
    assert torch.allclose(panel.illumination.at_pixels(panel), beam)
    assert (lens.focal_length, lens.focus_distance) == pytest.approx((0.124, 1.9))
    assert (lens.f_number, lens.aberrations) == (5.0, ((3, 1, pytest.approx(50e-9)),))
    assert lens.relative_illumination == ((0, 1), (0.02, 0.5))
    assert lens.distortion == (-0.2, 0.1)
    assert lens.focus_shift(500e-9) == pytest.approx(0.2e-6)
    by = lens.field_aberrations
    assert (by.height, by.coma, by.curvature) == pytest.approx((8e-3, 0.9e-9, -0.3e-9))
    assert lens.image_scale(500e-9) == pytest.approx(0.999998, abs=1e-9)


def test_the_mount_is_in_degrees():
    table = SceneFile.model_validate(
        {
            "version": 1,
            "title": "",
            "targets": {"dark": {"kind": "dark"}},
            "truth": {"mount": {"rotation_deg": -90, "flip_y": True}},
        }
    ).truth
    mount = table.mount.build()
    assert math.isclose(math.sin(mount.rotation), -1)
    assert (mount.flip_x, mount.flip_y) == (False, True)
    assert SceneFile.model_validate(
        {"version": 1, "title": "", "targets": {"dark": {"kind": "dark"}}, "truth": {}}
    ).truth.mount.build() == (Mount())


def test_a_table_of_shares_is_a_response(small):
    shares = np.linspace(0, 0.8, 256) ** 1.1
    add(small, f"\n[truth.panel]\nresponse = {{ shares = {shares.tolist()} }}\n")
    with open_bench(small.bench_files) as bench:
        assert torch.allclose(
            bench.world.camera.panel.response.at(600e-9)[0, 0], torch.from_numpy(shares)
        )


def test_without_a_truth_there_is_none(small):
    assert read_scene(small.bench_files).truth is None


def test_a_star_may_stand_off_the_axis(small, plan, tmp_path):
    """On the sensor by the ratio of the distances: 125 mm focused at 2 m image at 133.3 mm."""
    replaced(small, "diameter_um = 70.0", "diameter_um = 70.0\noffset_um = [-310.5, 621.0]")
    with open_bench(small.bench_files) as bench:
        bench.targets.place("star")
        light = bench.world.electron_rates()[0].numpy()
    index = np.mgrid[: light.shape[0], : light.shape[1]]
    peak = np.unravel_index(light.argmax(), light.shape)
    near = tuple(slice(p - 4, p + 5) for p in peak)
    centroid = [float((i[near] * light[near]).sum() / light[near].sum()) for i in index]
    z = 1 / (1 / 0.125 - 1 / 2.0)
    expected = np.array([32, 48]) + np.array([-310.5, 621.0]) * z / 2.0 / 3.45
    assert np.allclose(centroid, expected, atol=0.1)


def test_the_truth_is_in_the_record_and_a_resumed_run_ends_in_the_same_arrays(small, tmp_path):
    small.plan.write_text(small.plan.read_text().replace("[540, 550]", "[550]"))
    plan = read_file(small.plan, PlanFile)
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, tmp_path / "described.h5")
    # What each key does to a picture is tested elsewhere; these are planned and rendered longest.
    dear = ("ghosts", "focus_drift", "axial_colour", "lateral_colour")
    add(small, "\n".join(one for one in TRUTH.splitlines() if not one.startswith(dear)))
    progress, path = Progress(), tmp_path / "run.h5"
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, tmp_path / "whole.h5")
        outcome = run_plan(
            bench,
            plan,
            path,
            Attendance(
                progress=progress,
                on_frame=lambda shot, frame: progress.cancel() if shot.index == 5 else None,
            ),
        )
    assert outcome.state is State.CANCELLED
    # Nothing but the record is needed.
    small.scene.unlink()
    with Record(path) as record:
        setup = bench_setup_of(record)
        assert setup.scene.truth.mount.flip_x
        assert setup.scene.truth.panel.response.gamma == 1.3
    with open_bench(setup) as bench:
        assert resume_run(bench, path).state is State.COMPLETE
    assert differing_arrays(tmp_path / "whole.h5", path) == []
    with h5py.File(path) as run, h5py.File(tmp_path / "described.h5") as described:
        ours, theirs = (file["entry/data/images"][-1].astype(float) for file in (run, described))
    assert np.abs(ours - theirs).max() > 20


def test_show_names_the_effects_that_there_are(small, plan, tmp_path, labapp):
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, tmp_path / "plain.h5")
    add(small, "\n[truth.panel]\ncoupling_um = 16.0\njitter_rad = 0.01\n")
    with open_bench(small.bench_files) as bench:
        run_plan(bench, plan, tmp_path / "run.h5")
    _, plain, _ = labapp("show", tmp_path / "plain.h5")
    _, out, _ = labapp("show", tmp_path / "run.h5")
    for name in ("illumination", "panel response", "gap light", "flatness", "flicker"):
        assert name not in plain
        assert name not in out
    assert "neighbour coupling" not in plain
    assert "neighbour coupling" in out
    assert "jitter" in out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[truth.panel]\ncoupling_mm = 1.0", ["'truth.panel.coupling_mm'", "unknown"]),
        ("[truth.sensor]\npitch_um = 1.0", ["'truth.sensor.pitch_um'", "unknown"]),
        ("[truth.panel]\nunmodulated = 1.5", ["'truth.panel.unmodulated' is 1.5", "less than"]),
        ("[truth.panel]\njitter_rad = -0.1", ["'truth.panel.jitter_rad' is -0.1", "greater"]),
        ("[truth.panel]\nresponse_time_ms = inf", ["'truth.panel.response_time_ms' is inf"]),
        ("[truth.panel]\ncoupling_um = 200.0", ["'truth.panel'", "coupling is 0.0002 m", "pitch"]),
        ("[truth.panel]\nfront_reflection = 0.7", ["'truth.panel'", "front_reflection is 0.7"]),
        (
            "[truth.panel]\nresponse = { wiggle = 0.5 }",
            ["'truth.panel.response'", "falls from level"],
        ),
        (
            "[truth.panel]\nresponse = { gamma = 1.1, shares = [0.0, 1.0] }",
            ["'truth.panel.response'", "either shares, or gamma, wiggle and range"],
        ),
        (
            "[truth.panel]\nresponse = { shares = [0.0, 0.5, 1.0] }",
            ["'truth.panel'", "response has 3 levels and the panel 256"],
        ),
        (
            "[truth.panel]\nflatness = [[2, 1, 50.0]]",
            ["'truth.panel.flatness.0'", "ernike (2, 1) doesn't exist"],
        ),
        ("[truth.lens]\naberrations = [[4, 0]]", ["'truth.lens.aberrations.0", "missing"]),
        ("[truth.lens]\nfocal_length_mm = 3000.0", ["'truth.lens'", "focus_distance is 2 m"]),
        ("[truth.mount]\nrotation_deg = nan", ["'truth.mount.rotation_deg' is nan", "finite"]),
        ("[truth.mount]\nflip_x = 'sometimes'", ["'truth.mount.flip_x'", "sometimes"]),
    ],
)
def test_a_truth_that_cannot_be_is_refused_by_table_and_key(small, text, words):
    add(small, f"\n{text}\n")
    with pytest.raises(UserError) as caught, open_bench(small.bench_files):
        pass
    for word in ("scene.toml", *words):
        assert word in str(caught.value)


def test_an_offset_that_is_none_is_refused_by_its_key(small):
    replaced(small, "diameter_um = 70.0", "diameter_um = 70.0\noffset_um = [0.0, inf]")
    with pytest.raises(UserError, match=r"targets.star.*offset_um.1' is inf"):
        read_scene(small.bench_files)


def test_the_misaligned_scene_that_comes_with_the_application(small):
    """Differs from the bundled bench file in all parts, and can be photographed."""
    scene = read_file(bundled_path("misaligned.toml"), SceneFile)
    assert scene.truth.mount.build() != Mount()
    with open_bench(type(small.bench_files)(small.bench, bundled_path("misaligned.toml"))) as bench:
        described, real = bench.description, bench.world.camera
        assert real.panel != described.panel
        assert real.lens != described.lens
        bench.targets.place("star")
        assert bench.world.electron_rates()[0].max() > 0
