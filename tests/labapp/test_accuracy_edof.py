"""What designs for depth of field and PSFs with gradients cost, against truths of their own."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from labapp.accuracy import edof_design, edof_psf
from labapp.accuracy.edof_case import edof_case_from_options, panel_camera
from labapp.accuracy.edof_design import measure_designs
from labapp.accuracy.edof_psf import TOLERANCES, measure_gradients
from labapp.accuracy.work_precision import CUT, Deadline
from labapp.common.errors import UserError
from optics.accuracy import Budget
from optics.edof.depth_bound import known_depth_bound, rms_transfer_limit
from optics.edof.picture_spectrum import NATURAL_SPECTRUM, FrequencyGrid
from optics.progress import Progress

PANEL, SIZE, NOISE, DEPTHS, REACH = "54x96x16", 32, 0.008, 6, 150
CASE = edof_case_from_options(None, PANEL, noise=NOISE, size=SIZE, window=24)


@pytest.fixture(autouse=True)
def few_rows(monkeypatch):
    """Rings of forty zones need larger panels."""
    monkeypatch.setattr(edof_psf, "_SHORT_S", 0.0)
    monkeypatch.setattr("labapp.edof.design_problem.WINDOW_REACH", REACH)
    monkeypatch.setattr("labapp.accuracy.edof_design.RATED_DEPTHS", DEPTHS)
    monkeypatch.setattr("optics.edof.pattern_search.RATED_DEPTHS", DEPTHS)
    monkeypatch.setattr(edof_design, "_VARIANTS", (("quarter", "sweep", 2), ("free", "sweep", 2)))


def level_of(phase: np.ndarray) -> float:
    """Blind level at the depths of the rows, by direct sums in numpy over the whole panel.

    The light is sampled at pixels' centres in the window of a design.
    """
    camera, side = CASE.camera, 2 * REACH + 1
    scale = 520e-9 * 0.1
    y, x = ((np.arange(n) - (n - 1) / 2) * 16e-6 for n in camera.panel.shape)
    u = (np.arange(side) - side // 2) * camera.sensor.pitch
    down, across = (np.exp(-2j * np.pi / scale * np.outer(u, one)) for one in (y, x))
    norm = 16e-6**2 * 3.45e-6**2 / scale**2 / phase.size
    f = np.fft.fftfreq(SIZE)
    tones = np.exp(-2j * np.pi * np.outer(f, np.arange(side) - side // 2))
    chance = torch.Generator().manual_seed(2)
    depths = 2 * torch.rand(DEPTHS, generator=chance, dtype=torch.float64)
    transfers = []
    for depth in depths.numpy():
        bent = np.pi / 520e-9 * depth * (y[:, None] ** 2 + x**2)
        light = norm * np.abs(down @ np.exp(1j * (phase + bent)) @ across.T) ** 2
        transfers.append(tones @ light @ tones.T)
    h = np.array(transfers)
    half = NATURAL_SPECTRUM.on_grid(FrequencyGrid(SIZE)).numpy()
    spectrum = np.hstack([half, half[(-np.arange(SIZE)) % SIZE, SIZE // 2 - 1 : 0 : -1]])
    captured = spectrum * (np.abs(h) ** 2).mean(0) + NOISE**2
    error = spectrum * (1 - spectrum * np.abs(h.mean(0)) ** 2 / captured)
    return float(-10 * np.log10(error.mean()))


def whole(phase: torch.Tensor) -> np.ndarray:
    """The whole panel's phase, from a quarter or as it is."""
    values = phase.numpy()
    if values.shape == CASE.camera.panel.shape:
        return values
    rows = np.concatenate([values[::-1], values])
    return np.concatenate([rows[:, ::-1], rows], axis=1)


def test_errors_of_designs_are_measured_from_the_pattern_itself(monkeypatch):
    """Whatever a search says of itself, a row holds what its pattern gives."""
    found = []

    def boast(*args, **settings):
        result = search(*args, **settings)
        found.append(whole(result.phase))
        lie = replace(result.rating, blind=60.0, known_depth=60.0)
        return replace(result, rating=lie, history=((3, 60.0),))

    search = edof_design.design_pattern
    monkeypatch.setattr(edof_design, "design_pattern", boast)
    rows = measure_designs(CASE, 3, Progress())
    assert [row.iterations for row in rows] == [3, 3]
    grid = FrequencyGrid(SIZE, quarter=True)
    limit = rms_transfer_limit(CASE.camera, 520e-9, grid, rule="midpoint", nodes=150)
    bound = known_depth_bound(limit, NATURAL_SPECTRUM.on_grid(grid), grid.shares(), NOISE)
    # The first pattern is that of the warming up.
    for row, phase in zip(rows, found[1:], strict=True):
        assert row.level_db == pytest.approx(level_of(phase), abs=0.02)
        assert row.error_achieved == pytest.approx(bound - level_of(phase), abs=0.05)
        assert row.error_achieved > 0
        assert row.cpu_s > 0


def test_more_steps_are_other_rows_and_slow_designs_have_fewer(monkeypatch):
    monkeypatch.setattr(edof_design, "STEPS", (1, 2, 6))
    rows = measure_designs(CASE, 6, Progress())
    assert [(row.method.partition(",")[0], row.iterations) for row in rows] == [
        ("quarter", 1), ("quarter", 2), ("free", 2), ("quarter", 6),
    ]  # fmt: skip
    assert any(row.on_front for row in rows)


def test_errors_of_psfs_keep_the_tolerance():
    rows = measure_gradients(CASE, Budget(), Progress())
    assert len(rows) == 5 * len(TOLERANCES)
    assert {row.failure for row in rows} == {""}
    for row in rows:
        assert row.error_achieved <= row.tol
        assert row.gradient_error <= row.tol
        assert row.forward_s > 0
        assert row.cpu_s > 0
    assert any(row.on_front for row in rows)
    for tol in TOLERANCES:
        assert sum(bool(row.chosen_for) for row in rows if row.tol == tol) <= 1
    assert any(row.chosen_for for row in rows)


def test_errors_of_psfs_are_those_against_a_sum_of_its_own(monkeypatch):
    """An operator whose light is one per cent too bright is one per cent off."""

    class TooBright(edof_psf.PSFOperator):
        def __call__(self, phase):
            return 1.01 * super().__call__(phase)

    monkeypatch.setattr(edof_psf, "PSFOperator", TooBright)
    for row in measure_gradients(CASE, Budget(), Progress()):
        assert row.error_achieved == pytest.approx(0.01, abs=1e-3)
        assert row.gradient_error == pytest.approx(0.01, abs=1e-3)


def test_what_is_left_at_the_deadline_is_named():
    over = Deadline(0.0)
    assert {row.failure for row in measure_designs(CASE, 3, Progress(), over)} == {CUT}
    assert {row.failure for row in measure_gradients(CASE, Budget(), Progress(), over)} == {CUT}


def test_the_command_prints_both_tables_or_one(labapp, tmp_path):
    asked = ["accuracy", "edof", "--panel", PANEL, "--size", SIZE, "--window", 8, "--steps", 1]
    plot = tmp_path / "front.svg"
    code, printed, errors = labapp(*asked, "--json", "--plot", plot)
    assert code == 0, errors
    rows = json.loads(printed)["rows"]
    assert {row["operation"] for row in rows} == {"edof-design", "edof-psf"}
    assert "<svg" in plot.read_text()
    code, printed, _ = labapp(*asked, "--part", "psf")
    assert code == 0
    assert "quarter" in printed
    assert "Design" not in printed


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--part", "pattern"], "--part pattern: choose all, design, psf"),
        (["--panel", "54x96"], "--panel 54x96: give rows, columns and micrometres"),
        (["--panel", PANEL, "--camera", "CAMERA"], "leave one of them out"),
        (["--size", 33], "--size 33: give an even number of pixels"),
        (["--noise", 0], "--noise 0: give the standard deviation"),
        (["--plot", "nowhere/front.png"], "nowhere"),
    ],
)
def test_what_can_not_be_asked(labapp, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bench.toml").write_text("")
    words = ["bench.toml" if one == "CAMERA" else one for one in words]
    monkeypatch.setattr("labapp.files.bench_file.read_camera", lambda _: CASE.camera)
    code, _, errors = labapp("accuracy", "edof", *words)
    assert code != 0
    assert said in " ".join(errors.split())


def test_a_lens_with_aberrations_is_refused_by_name():
    camera = panel_camera(PANEL)
    camera = replace(camera, lens=replace(camera.lens, aberrations=((2, 2, 1e-7),)))
    case = edof_case_from_options(camera, None, noise=NOISE, size=SIZE, window=8)
    with pytest.raises(UserError, match="aberrations"):
        measure_designs(case, 1, Progress())
    with pytest.raises(UserError, match="PSFs aren't measured for this camera"):
        measure_gradients(case, Budget(), Progress())
    assert math.isinf(camera.lens.focus_distance)
