"""Patterns and targets as plan files write them, and what they come to on a panel."""

from __future__ import annotations

import math
import tomllib
from typing import Any, get_args

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from labapp.common.errors import UserError
from labapp.files.design_file import DesignContents, Grid, write_design
from labapp.files.pattern_table import PHASE_PATTERNS, Pattern, RetrievalMethod, pattern_data
from labapp.files.plan_file import PlanFile
from labapp.files.reading import validate
from labapp.files.table import tag_value
from labapp.patterns.grey_levels import (
    PatternContext,
    compute_pattern,
    compute_patterns,
    retrieve_psf,
)
from optics import patterns
from optics.camera import Camera, Lens, Panel, Sensor
from optics.plane import Plane
from optics.progress import Cancelled, Progress
from optics.retrieval import METHODS, design_plane
from optics.slm import grey_to_phase, phase_to_grey
from optics.targets import spiral

CAMERA = Camera(Panel(shape=(108, 192), pitch=80e-6), Lens(), Sensor((64, 96)))
PANEL = CAMERA.panel
WAVE = 550e-9
Z = CAMERA.lens.image_distance

_pattern: TypeAdapter[Pattern] = TypeAdapter(Pattern)


def read(table: dict[str, Any]) -> Pattern:
    return _pattern.validate_python(table)


def shown(table: dict[str, Any], folder: Any = None, seed: int = 3) -> np.ndarray:
    """Grey levels as a plan would compute them."""
    (grey,) = compute_patterns({"it": read(table)}, CAMERA, seed, Progress(), folder).values()
    return grey


FORMULAS = {
    "multi-focus": (
        {"vergences_dioptre": [0.7, 0.3, 0.5], "rings": 9, "order": "cyclic", "radius_mm": 8},
        lambda: patterns.multi_focus_rings(
            PANEL, (0.7, 0.3, 0.5), WAVE, 9, 0.5, 8e-3, order="cyclic"
        ),
    ),
    "focal-sweep": (
        {"near_dioptre": 0.7, "far_dioptre": 0.2, "sweeps": 3, "even_in": "area"},
        lambda: patterns.focal_sweep_axicon(PANEL, 0.7, 0.2, WAVE, 3, 0.5, even_in="area"),
    ),
    "lattice-focal": (
        {"near_dioptre": 0.7, "far_dioptre": 0.2, "columns": 3, "rows": 5},
        lambda: patterns.lattice_focal_lens(PANEL, 0.7, 0.2, WAVE, 3, 5, 0.5),
    ),
    "lens": (
        {"focal_length_m": 20, "centre_mm": [1, -2]},
        lambda: patterns.fresnel_lens(PANEL, 20, WAVE, (1e-3, -2e-3)),
    ),
    "axicon": ({"radius_um": 30}, lambda: patterns.axicon(PANEL, 30e-6, Z, WAVE)),
    "cubic": (
        {"strength_rad": 20, "radius_mm": 6},
        lambda: patterns.cubic_phase_mask(PANEL, 20.0, 6e-3),
    ),
    "logarithmic": (
        {"near_m": 1.8, "far_m": 2.3, "radius_mm": 5},
        lambda: patterns.logarithmic_asphere(PANEL, 1.8, 2.3, 2.0, WAVE, 5e-3),
    ),
    "annular": ({"rings": 5, "depth_rad": 4}, lambda: patterns.annular_phase_mask(PANEL, 5, 4.0)),
    "blaze": (
        {"shift_um": [-20, 30]},
        lambda: patterns.steering_grating(PANEL, (-20e-6, 30e-6), Z, WAVE),
    ),
    "binary": (
        {"period_px": 6, "step_rad": 2, "angle_deg": 90},
        lambda: patterns.binary_grating(PANEL, 6, 2.0, math.pi / 2),
    ),
    "sine": (
        {"period_px": 40, "amplitude_rad": 2, "angle_deg": 30},
        lambda: patterns.sine_grating(PANEL, 2.0, 40, math.pi / 6),
    ),
    "zernike": (
        {"terms": [[4, 0, 60], [3, -1, -40.5]], "radius_mm": 8},
        lambda: patterns.zernike_pattern(PANEL, [(4, 0, 60e-9), (3, -1, -40.5e-9)], 8e-3, WAVE),
    ),
}


@pytest.mark.parametrize("kind", FORMULAS)
def test_a_formula_in_a_plan_is_the_formula_in_metres(kind):
    keys, phase = FORMULAS[kind]
    truth = phase_to_grey(PANEL, phase(), WAVE).numpy()
    assert (shown({"kind": kind} | keys) == truth).all()
    assert len(np.unique(truth)) > 1


def test_a_blaze_by_its_period():
    grey = shown({"kind": "blaze", "period_px": 8, "angle_deg": 180})
    truth = phase_to_grey(PANEL, patterns.blazed_grating(PANEL, 8, math.pi), WAVE)
    assert (grey == truth.numpy()).all()


def test_even_foci_are_the_middles_of_equal_parts_of_the_range():
    table = {"kind": "multi-focus", "rings": 12}
    even = {"near_dioptre": 0.8, "far_dioptre": 0.2, "foci": 3}
    assert (shown(table | even) == shown(table | {"vergences_dioptre": [0.7, 0.5, 0.3]})).all()


def test_foci_in_random_order_follow_the_seed():
    table = {"kind": "multi-focus", "near_dioptre": 0.8, "order": "random"}
    assert (shown(table) == shown(table)).all()
    assert (shown(table) != shown(table, seed=4)).any()
    assert read(table).depends_on_seed


def test_aberrations_without_a_radius_are_those_of_the_light_that_passes():
    """The stop of 25 mm is wider than the panel's 17.6 mm from corner to corner."""
    table = {"kind": "zernike", "terms": [[4, 0, 60]]}
    corner = math.hypot(108, 192) * 80e-6 / 2
    assert (shown(table) == shown(table | {"radius_mm": corner * 1e3})).all()


@given(orders=st.integers(1, 3), step=st.floats(0, 15))
def test_a_pattern_uses_the_waves_that_it_is_told_to(orders, step):
    """The phase shown is right modulo all of them, to half a level."""
    table = {"kind": "binary", "period_px": 4, "step_rad": step, "orders": orders}
    phase = grey_to_phase(PANEL, torch.from_numpy(shown(table)), WAVE)
    wanted = patterns.binary_grating(PANEL, 4, step)
    wave = 2 * math.pi * orders
    left = (phase - wanted + wave / 2) % wave - wave / 2
    level = 6.7 * math.pi / 255
    assert left.abs().max() < 0.51 * level


def test_more_waves_than_the_panel_has_are_refused():
    with pytest.raises(UserError, match=r"pattern 'it': orders is 9; .* choose 1 to 3"):
        shown({"kind": "lens", "focal_length_m": 20, "orders": 9})


def test_patches_follow_the_seed():
    table = {"kind": "patches", "rows": 3, "columns": 4}
    assert (shown(table) == shown(table)).all()
    assert (shown(table) != shown(table, seed=4)).any()


def test_a_video_of_patches_has_other_patches_in_every_frame():
    patches = {"kind": "patches", "rows": 3, "columns": 4}
    video = shown({"kind": "video", "count": 3, "pattern": patches})
    assert video.shape == (3, 108, 192)
    for number, frame in enumerate(video):
        assert (frame == shown(patches, seed=3 + number)).all()


def test_a_sum_adds_phases():
    parts = [
        {"kind": "lens", "focal_length_m": 20},
        {"kind": "blaze", "shift_um": [0, 20]},
        {"kind": "binary", "period_px": 8},
    ]
    total = (
        patterns.fresnel_lens(PANEL, 20, WAVE)
        + patterns.steering_grating(PANEL, (0.0, 20e-6), Z, WAVE)
        + patterns.binary_grating(PANEL, 8, math.pi)
    )
    truth = phase_to_grey(PANEL, total, WAVE).numpy()
    assert (shown({"kind": "sum", "parts": parts}) == truth).all()


def test_the_parts_of_a_sum_are_for_its_wavelength():
    parts = [{"kind": "lens", "focal_length_m": 20}, {"kind": "cubic"}]
    spec = read({"kind": "sum", "wavelength_nm": 600, "parts": parts})
    assert [part.wavelength_nm for part in spec.parts] == [600, 600]
    with pytest.raises(ValueError, match="a part is for 500 nm and the sum for 550 nm"):
        read({"kind": "sum", "parts": [parts[0] | {"wavelength_nm": 500}]})


def test_a_sum_of_two_random_parts_has_two_patterns():
    """Twice the same would be twice its phase."""
    patches = {"kind": "patches", "rows": 2, "columns": 2, "depth_rad": 3.0}
    twice = shown({"kind": "sum", "parts": [patches, patches]})
    phase = grey_to_phase(PANEL, torch.from_numpy(shown(patches)), WAVE)
    assert (twice != phase_to_grey(PANEL, 2 * phase, WAVE).numpy()).any()


def test_a_sum_that_is_too_steep_is_refused():
    blaze = {"kind": "blaze", "period_px": 3}
    with pytest.raises(UserError, match=r"pattern 'it': the sum changes .* 1\.33 pi"):
        shown({"kind": "sum", "parts": [blaze, blaze]})


PSF = {"kind": "psf", "iterations": 20, "target": {"shape": "spiral", "radius_um": 60}}


def light_of(greys: np.ndarray, plane: Plane) -> np.ndarray:
    """Mean intensity of frames on a design plane, by the discrete Fourier transform itself."""
    frames = greys if greys.ndim == 3 else greys[None]
    scale = WAVE * Z
    y, x = ((np.arange(n) - n // 2) * PANEL.pitch for n in PANEL.shape)
    v, u = (plane.coordinates(axis).numpy() for axis in (0, 1))
    rows, columns = (
        np.exp(-2j * np.pi * np.outer(image, panel) / scale) for image, panel in ((v, y), (u, x))
    )
    total = np.zeros(plane.shape)
    for frame in frames:
        field = np.exp(1j * grey_to_phase(PANEL, torch.from_numpy(frame), WAVE).numpy())
        total += np.abs(rows @ field @ columns.T) ** 2
    return total / total.sum()


def similarity(one: np.ndarray, other: np.ndarray) -> float:
    return float((one * other).sum() / np.linalg.norm(one) / np.linalg.norm(other))


def test_a_psf_pattern_has_the_psf_of_its_target():
    plane = design_plane(CAMERA, WAVE, (128, 128))
    target = spiral(plane, 60e-6, 8e-6).numpy()
    assert similarity(light_of(shown(PSF), plane), target) > 0.9


def test_the_frames_of_a_psf_video_know_of_each_other():
    """Their mean is much smoother than one frame, or than as many strangers."""
    plane = design_plane(CAMERA, WAVE, (128, 128))
    target = spiral(plane, 60e-6, 8e-6).numpy()
    bright = target > 0.5 * target.max()

    def speckle(greys: np.ndarray) -> float:
        ratio = light_of(greys, plane)[bright] / target[bright]
        return float(ratio.std() / ratio.mean())

    video = shown({"kind": "video", "count": 4, "pattern": PSF})
    strangers = shown({"kind": "video", "count": 4, "pattern": PSF | {"method": "independent"}})
    assert len({frame.tobytes() for frame in video}) == 4
    assert speckle(video) < 0.6 * speckle(strangers)


def test_a_target_that_moves_has_its_moments_in_turn():
    """Two frames for each of two moments: a large spiral, then one of half the size."""
    target = {
        "shape": "shrinking-spiral",
        "radius_um": 70,
        "width_um": 8,
        "smallest": 0.5,
        "moments": 2,
    }
    video = shown({"kind": "video", "count": 4, "pattern": PSF | {"target": target}})
    plane = design_plane(CAMERA, WAVE, (128, 128))
    large, small = (spiral(plane, radius, 8e-6).numpy() for radius in (70e-6, 35e-6))
    first, second = light_of(video[:2], plane), light_of(video[2:], plane)
    assert similarity(first, large) > 0.9 > similarity(first, small) + 0.2
    assert similarity(second, small) > 0.9 > similarity(second, large) + 0.2


def test_a_ring_in_a_plan_is_still_a_ring():
    plane = design_plane(CAMERA, WAVE, (128, 128))
    light = light_of(shown({"kind": "ring", "radius_um": 60, "width_um": 8}), plane)
    y, x = (axis.numpy() for axis in plane.mesh())
    assert light[np.abs(np.hypot(y, x) - 60e-6) < 20e-6].sum() > 0.8


def test_a_larger_budget_buys_a_better_pattern():
    work = PatternContext(CAMERA, 1, Progress(), None)
    found = [
        retrieve_psf(read(PSF | {"iterations": None, "budget_s": budget}), 1, work)[0].result
        for budget in (0.02, 0.4)
    ]
    assert found[0].quality.contrast > found[1].quality.contrast


def test_a_retrieval_can_be_cancelled():
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        compute_pattern(read(PSF), CAMERA, 1, progress, None)


def test_the_methods_of_the_table_are_those_that_there_are():
    assert set(get_args(RetrievalMethod)) == set(METHODS)


TARGETS = [
    {"shape": "ring"},
    {"shape": "spiral", "turns": 2, "hole": 0.1},
    {"shape": "heart"},
    {"shape": "infinity"},
    {"shape": "eye", "radius_um": 80, "width_um": 6},
    {"shape": "dots"},
    {"shape": "dots", "rows": 2, "columns": 3},
    {"shape": "dots", "positions_um": [[0, 30], [-20.5, 0]]},
    {"shape": "letters", "text": "EI", "height_um": 60},
    {"shape": "dispersion", "wavelengths_nm": [500, 550, 600]},
]


@pytest.mark.parametrize("table", TARGETS, ids=lambda table: "-".join(map(str, table.values())))
def test_every_target_can_be_designed(table):
    spec = read({"kind": "psf", "iterations": 1, "target": table})
    (moment,) = retrieve_psf(spec, 1, PatternContext(CAMERA, 1, Progress(), None))
    assert float(moment.target.sum()) == pytest.approx(1)
    assert table["shape"] in spec.label
    assert read(pattern_data(spec)) == spec


def test_dots_at_positions_are_there():
    """The centroid of two dots, in metres."""
    spec = read({"kind": "psf", "target": TARGETS[7]})
    drawing = spec.target.draw(None)
    plane = Plane((64, 64), (2e-6, 2e-6))
    light = drawing.render(plane)
    y, x = plane.mesh()
    assert float((light * y).sum()) == pytest.approx(-10.25e-6, abs=1e-9)
    assert float((light * x).sum()) == pytest.approx(15e-6, abs=1e-9)


def test_a_dispersion_is_a_row_of_dots():
    """A micrometre a nanometre from 550 nm: at -50, 0 and 50 µm."""
    spec = read({"kind": "psf", "target": TARGETS[9] | {"width_um": 3}})
    line = spec.target.draw(None).render(Plane((64, 64), (2e-6, 2e-6)))[32]
    peaks = [i for i in range(1, 63) if line[i] > line[i - 1] and line[i] > line[i + 1]]
    assert peaks == [7, 32, 57]


def test_a_logo_is_read_from_beside_the_plan(tmp_path):
    picture = np.zeros((20, 20), np.uint8)
    picture[:, :10] = 255
    cv2.imwrite(str(tmp_path / "logo.png"), picture)
    target = {"shape": "logo", "file": "logo.png", "size_um": 80}
    light = (
        read({"kind": "psf", "target": target})
        .target.draw(tmp_path)
        .render(Plane((64, 64), (2e-6, 2e-6)))
    )
    assert float(light[:, :32].sum()) > 0.95
    with pytest.raises(UserError, match=r"nothing\.png: cannot be read"):
        shown({"kind": "psf", "target": target | {"file": "nothing.png"}}, tmp_path)


def write_frames(path, greys: np.ndarray) -> None:
    grid = Grid(np.ones((1, 2, 2)), np.arange(2.0), np.arange(2.0))
    contents = DesignContents("Two", {}, {}, WAVE, greys, None, 1, 0.0, PANEL.pitch, grid, None, {})
    write_design(path, contents)


def test_an_image_may_be_a_frame_of_a_design_file(tmp_path):
    greys = np.random.default_rng(0).integers(0, 80, (2, *PANEL.shape), dtype=np.uint8)
    write_frames(tmp_path / "two.h5", greys)
    table = {"kind": "image", "file": "two.h5"}
    assert (shown(table, tmp_path) == greys[0]).all()
    assert (shown(table | {"frame": 1}, tmp_path) == greys[1]).all()
    with pytest.raises(UserError, match=r"two\.h5: has no frame 2\. Choose 0 to 1"):
        shown(table | {"frame": 2}, tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.h5", None, "there is no such file"),
        ("text.h5", b"text", "cannot be read as HDF5"),
        ("small.h5", (1, 5, 6), "the pattern is 6x5 pixels; the panel needs 192x108"),
    ],
)
def test_a_design_file_that_cannot_be_shown_is_refused(tmp_path, name, content, words):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content:
        write_frames(path, np.zeros(content, np.uint8))
    with pytest.raises(UserError, match=words):
        shown({"kind": "image", "file": name}, tmp_path)


def test_another_hdf5_file_is_no_design_file(tmp_path):
    import h5py

    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["entry/data"] = 1
    with pytest.raises(UserError, match="is no design file"):
        shown({"kind": "image", "file": "run.h5"}, tmp_path)


def test_a_picture_has_no_frames(tmp_path):
    cv2.imwrite(str(tmp_path / "one.png"), np.zeros(PANEL.shape, np.uint8))
    with pytest.raises(UserError, match=r"one\.png: is one picture"):
        shown({"kind": "image", "file": "one.png", "frame": 1}, tmp_path)


PLAN = """
version = 1
title = "New kinds"

[patterns.neutral]
kind = "constant"

[patterns.tilted]
kind = "sum"
parts = [{ kind = "lens", focal_length_m = 20 }, { kind = "psf", target = { shape = "ring" } }]

[patterns.film]
kind = "video"
count = 6
pattern = { kind = "psf", target = { shape = "shrinking-spiral", moments = 3 }, budget_s = 2 }

[[acquire]]
targets = ["star"]
patterns = ["neutral", "tilted", "film"]
wavelengths_nm = [550]
periods = [1]
"""


def test_a_plan_of_new_kinds_is_read_and_survives_being_written():
    plan = PlanFile.model_validate(tomllib.loads(PLAN))
    assert PlanFile.model_validate_json(plan.model_dump_json()) == plan
    assert plan.patterns["film"].length == 6
    assert plan.patterns["film"].label == "video of 6 x shrinking-spiral 100/8 µm for 550 nm"


def test_quick_patterns_are_the_same_with_less_work():
    plan = PlanFile.model_validate(tomllib.loads(PLAN))
    film, tilted = (plan.patterns[name].with_least_work() for name in ("film", "tilted"))
    assert (film.count, film.pattern.iterations, film.pattern.budget_s) == (2, 1, None)
    assert tilted.parts[1].iterations == 1
    assert tilted.parts[0] == plan.patterns["tilted"].parts[0]
    greys = compute_patterns({"film": film}, CAMERA, 1, Progress(), None)["film"]
    assert greys.shape == (2, *PANEL.shape)


def test_every_kind_has_a_label_and_says_whether_it_varies():
    examples = {
        "lens": {"focal_length_m": 2},
        "axicon": {"radius_um": 80},
        "logarithmic": {"near_m": 1, "far_m": 3},
        "blaze": {"period_px": 9},
        "zernike": {"terms": [[2, 0, 50]]},
        "ring": {"radius_um": 50, "width_um": 5},
        "psf": {"target": {"shape": "heart"}},
        "sum": {"parts": [{"kind": "patches"}]},
    }
    random = {"psf", "sum", "patches"}
    for model in PHASE_PATTERNS:
        kind = tag_value(model, "kind")
        spec = read({"kind": kind} | examples.get(kind, {}))
        assert spec.label.endswith(" for 550 nm")
        assert spec.depends_on_seed == (kind in random)
        assert read(pattern_data(spec)) == spec


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"kind": "blaze"}, "a blaze has either shift_um or period_px"),
        ({"kind": "blaze", "period_px": 3, "shift_um": [0, 1]}, "either shift_um or period_px"),
        ({"kind": "binary", "period_px": 1}, "greater than or equal to 2"),
        ({"kind": "sine", "period_px": 3}, "greater than or equal to 4"),
        ({"kind": "annular", "rings": 0}, "greater than or equal to 1"),
        ({"kind": "multi-focus", "vergences_dioptre": []}, "at least 1 item"),
        ({"kind": "multi-focus", "order": "golden"}, "'interleaved'"),
        ({"kind": "focal-sweep", "sweeps": 0}, "greater than or equal to 1"),
        ({"kind": "focal-sweep", "even_in": "light"}, "'radius'"),
        ({"kind": "lattice-focal", "near_dioptre": math.inf}, "finite"),
        ({"kind": "zernike", "terms": []}, "at least 1 item"),
        ({"kind": "zernike", "terms": [[3, 2, 5]]}, r"zernike \(3, 2\) doesn't exist"),
        ({"kind": "zernike", "terms": 5}, "valid tuple"),
        ({"kind": "sum", "parts": []}, "at least 1 item"),
        ({"kind": "sum", "parts": 3, "wavelength_nm": 500}, "valid tuple"),
        ({"kind": "sum", "parts": [{"kind": "constant"}]}, "'constant'"),
        (PSF | {"budget_s": 2}, "either budget_s or iterations"),
        (PSF | {"method": "luck"}, "'published'"),
        ({"kind": "psf", "target": {"shape": "cat"}}, "'shape'"),
        ({"kind": "psf", "target": {"shape": "dots", "rows": 2}}, "rows and columns; give both"),
        (
            {
                "kind": "psf",
                "target": {"shape": "dots", "rows": 2, "columns": 1, "positions_um": [[0, 0]]},
            },
            "either rows and columns, or positions_um",
        ),
        ({"kind": "psf", "target": {"shape": "letters", "text": ""}}, "at least 1 character"),
        ({"kind": "video", "count": 2, "pattern": {"kind": "cubic"}}, "would all be alike"),
        (
            {
                "kind": "video",
                "count": 5,
                "pattern": {"kind": "psf", "target": {"shape": "shrinking-spiral", "moments": 2}},
            },
            "2 moments don't share 5 frames evenly",
        ),
    ],
)
def test_a_table_that_cannot_be_is_told_why(table, message):
    plan = {
        "version": 1,
        "title": "Wrong",
        "patterns": {"it": table},
        "acquire": [
            {"targets": ["a"], "patterns": ["it"], "wavelengths_nm": [5], "exposures_ms": [1]}
        ],
    }
    with pytest.raises(UserError, match=message):
        validate(plan, PlanFile, "plan.toml")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"kind": "lens", "focal_length_m": 0.01}, r"focal_length changes .* at least"),
        ({"kind": "cubic", "strength_rad": 1e4}, r"strength changes .* at most"),
        ({"kind": "multi-focus", "rings": 4}, "rings is 4; choose 10 or more"),
        ({"kind": "multi-focus"}, r"vergences has one that .* within 0.447 dioptres of focus, 0.5"),
        ({"kind": "focal-sweep", "far_dioptre": 3}, "near is 2 dioptres; it must be more than far"),
        ({"kind": "focal-sweep"}, r"near 2 or far 0 changes .* within 0.447 dioptres"),
        ({"kind": "lattice-focal", "rows": 200}, "rows is 200; choose 1 to 108"),
        (PSF | {"target": {"shape": "ring", "radius_um": 1e5}}, "the panel steers light to"),
        (PSF | {"target": {"shape": "shrinking-spiral"}}, "make a video of 2 frames or more"),
        (PSF | {"target": {"shape": "letters", "text": "§"}}, "text has '§'"),
        (PSF | {"wavelength_nm": 3000}, "wavelength"),
        (PSF | {"method": "descent", "iterations": None, "budget_s": 1e-9}, "allow more"),
    ],
)
def test_a_pattern_that_cannot_be_shown_is_named_with_the_limit(table, message):
    with pytest.raises(UserError, match=rf"pattern 'it': .*{message}"):
        shown(table)
