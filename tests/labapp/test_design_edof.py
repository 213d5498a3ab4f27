"""`labapp design edof`: files, what is told, going on after an interruption, and wrong options."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import h5py
import numpy as np
import pytest
import torch
from small_bench.files import write_small

import labapp.edof.command as command
from labapp.common.errors import UserError
from labapp.edof.design_problem import EdofProblem
from labapp.edof.design_request import EdofRequest
from labapp.edof.design_search import DesignStateFile, search_pattern
from labapp.files.bench_file import read_bench
from labapp.files.design_file import read_design
from labapp.files.state_file import StateFile
from optics.edof.pattern_rating import SearchState
from optics.progress import Cancelled, Progress
from optics.psf import PSFOperator
from optics.slm import grey_to_phase, max_phase, phase_to_grey

pytestmark = pytest.mark.usefixtures("white_sheets")

DEPTHS = ("--near-dioptre", "0.9", "--far-dioptre", "0.3")


@pytest.fixture
def options(small, tmp_path):
    """Options of a design that takes a second, on the small bench."""
    return [
        *("--bench", small.bench, "--size", "64", "--steps", "4", *DEPTHS),
        *("--out", tmp_path / "a.h5", "--json"),
    ]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A design of two wavelengths and its bench's files, made once."""
    folder = tmp_path_factory.mktemp("design")
    small = write_small(folder / "files")
    request = request_of(small, wavelengths=(520e-9, 620e-9))
    files = [folder / name for name in ("a.h5", "a.png", "a_design.png")]
    command.design_edof(request, files, steps=2, minutes=0.0, as_json=False)
    return small, files[0]


def request_of(small, **changes) -> EdofRequest:
    given = {
        "bench": small.bench,
        "wavelengths": (520e-9,),
        "near": 0.9,
        "far": 0.3,
        "noise": 0.008,
        "decoder": "blind",
        "pictures": None,
        "start": "rings",
        "parametrisation": "quarter",
        "size": 64,
        "orders": 1,
        "seed": 1,
    }
    return EdofRequest(**{**given, **changes})


def problem_of(small, **changes) -> EdofProblem:
    return EdofProblem(request_of(small, **changes), read_bench(small.bench).build_camera())


@pytest.mark.usefixtures("drawn")
def test_a_design_is_written_told_and_better_than_its_start(labapp, options, tmp_path):
    code, out, _ = labapp("design", "edof", *options)
    assert code == 0
    told = json.loads(out)
    psnr = told["expected_psnr"]
    assert psnr["blind"] <= psnr["known_depth"] <= psnr["bound"]
    assert all(one["known_depth"] <= psnr["bound"] for one in told["hand_made"].values())
    assert psnr["blind"] > psnr["start_blind"]
    assert 0 < told["light_in_window"] <= 1.002
    made = read_design(tmp_path / "a.h5")
    assert (cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED) == made.grey[0]).all()
    assert cv2.imread(str(tmp_path / "a_design.png")).shape[0] > 500
    assert made.quality["blind"] == psnr["blind"]
    assert made.settings["focus_dioptre"] > 0
    assert not (tmp_path / "a.design-state").exists()


def test_the_written_psfs_are_those_of_the_written_pattern(made):
    small, path = made
    found = read_design(path)
    assert found.phase is not None
    camera = read_bench(small.bench).build_camera()
    pixels = camera.sensor.window_plane(found.psf.images.shape[1:])
    depth = found.quality["shown_dioptre"][2]
    truth = PSFOperator(camera, 1 / depth, 520e-9, pixels, tol=1e-4)(
        torch.from_numpy(found.phase[0])
    ).numpy()
    error = np.linalg.norm(found.psf.images[2] - truth) / np.linalg.norm(truth)
    assert error <= 1e-2


def test_a_plan_shows_a_design(labapp, made, tmp_path):
    small, path = made
    plan = tmp_path / "plan.toml"
    plan.write_text(
        f"""version = 1
title = "EDoF"
[patterns.edof]
kind = "image"
file = "{path}"
[[acquire]]
targets = ["star"]
patterns = ["edof"]
wavelengths_nm = [520]
exposures_ms = [1]
"""
    )
    code, out, err = labapp("plan", "check", plan, "--bench", small.bench)
    assert code == 0, out + err


@pytest.mark.parametrize("decoder", ["blind", "known"])
def test_a_cancelled_design_goes_on_to_the_same_pattern(small, tmp_path, decoder):
    """Bit for bit, from the state that was kept when it was cancelled."""
    problem = problem_of(small, decoder=decoder)
    transfer = problem.transfer(520e-9)
    start = problem.parametrisation.fit(problem.start_phase())
    settings = {**problem.request.as_data(), "steps": 30}

    def search(state, kept, progress):
        return search_pattern(problem, transfer, start, 30, state, kept, progress)

    whole = search(
        SearchState(), DesignStateFile(StateFile(tmp_path / "a", "design"), settings), Progress()
    )
    progress = Progress(lambda fraction, _: progress.cancel() if fraction > 0.3 else None)
    kept = DesignStateFile(StateFile(tmp_path / "b", "design"), settings)
    with pytest.raises(Cancelled):
        search(SearchState(), kept, progress)
    assert StateFile(tmp_path / "b", "design").read_steps() == 30
    again = DesignStateFile(StateFile(tmp_path / "b", "design"), settings)
    state = again.read()
    assert state is not None
    assert 0 < state.step < 30
    assert torch.equal(search(state, again, Progress()).phase, whole.phase)


def test_the_state_of_another_design_is_refused(small, tmp_path):
    settings = {**request_of(small).as_data(), "steps": 20}
    file = StateFile(tmp_path / "a", "design")
    DesignStateFile(file, settings).write(SearchState(step=3))
    with pytest.raises(command.UserError, match=r"a design with noise 0.008 instead of 0.02"):
        DesignStateFile(file, {**settings, "noise": 0.02}).read()
    with pytest.raises(command.UserError, match=r"a design with steps 20 instead of 30"):
        DesignStateFile(file, {**settings, "steps": 30}).read()
    file.write(settings, {"nothing": 1})
    with pytest.raises(command.UserError, match="is damaged"):
        DesignStateFile(file, settings).read()
    (tmp_path / "a").write_bytes(b"nothing")
    with pytest.raises(command.UserError, match="is damaged"):
        file.read_steps()


def test_minutes_become_steps_once(small):
    problem = problem_of(small)
    transfer = problem.transfer(520e-9)
    start = problem.parametrisation.fit(problem.start_phase())
    few, many = (command._steps_in(one, problem, transfer, start) for one in (0.01, 10.0))
    assert few >= 1
    assert many > 50 * few


@pytest.mark.parametrize("name", ["rings", "sweep", "lattice", "cubic", "flat"])
def test_every_start_suits_the_panel(small, name):
    problem = problem_of(small)
    phase = problem.pattern(name, 520e-9)
    assert phase.shape == problem.camera.panel.shape
    assert bool(phase.isfinite().all())


def test_a_design_starts_from_another_one(made):
    small, path = made
    found = read_design(path)
    assert found.phase is not None
    start = problem_of(small, start=str(path)).start_phase()
    assert np.array_equal(start.numpy(), found.phase[0])


def test_the_spectrum_of_pictures_is_that_of_their_luminance(small, tmp_path):
    """White noise of variance v in linear light has the spectrum v at every frequency."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    rng = np.random.default_rng(0)
    grey = rng.integers(0, 2, (256, 256, 1)).repeat(3, 2) * 255
    cv2.imwrite(str(folder / "a.png"), grey.astype(np.uint8))
    problem = problem_of(small, pictures=folder)
    mean = float(problem.spectrum[:, 1:].mean())
    assert abs(mean - 0.25) < 0.02
    assert problem.spectrum_source == str(folder)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("--near-dioptre", "0.2"), "near must be more than far"),
        (("--noise", "0"), "--noise 0: give the standard deviation"),
        (("--decoder", "magic"), "choose blind or known"),
        (("--parameters", "hexagons"), "choose quarter, radial"),
        (("--start", "nowhere.h5"), "there is no such file"),
        (("--size", "65"), "give an even number"),
        (("--wavelength-nm", "0"), "is 0: give a wavelength in nanometres"),
        (("--minutes", "1"), "give one of them"),
    ],
)
def test_wrong_options_are_refused_with_what_would_be_right(labapp, options, wrong, message):
    code, _, err = labapp("design", "edof", *options, *wrong)
    assert code != 0
    assert message in " ".join(err.split())


def test_wrong_output_names_and_empty_folders_are_refused(labapp, small, tmp_path):
    code, _, err = labapp("design", "edof", "--out", tmp_path / "a.png")
    assert code != 0
    assert "a design is written as .h5" in " ".join(err.split())
    (tmp_path / "empty").mkdir()
    code, _, err = labapp(
        *("design", "edof", "--bench", small.bench, "--size", "64", "--steps", "1"),
        *("--pictures", tmp_path / "empty", "--out", tmp_path / "b.h5", *DEPTHS),
    )
    assert code != 0
    assert "there is no picture in it" in " ".join(err.split())


def test_a_further_wavelength_sees_the_grey_levels_of_the_first(made):
    """The phase for which it's designed is that which the panel's levels make there."""
    small, _ = made
    problem = problem_of(small, wavelengths=(520e-9, 620e-9), parametrisation="free")
    parameters = problem.parametrisation.fit(problem.start_phase())
    panel = problem.camera.panel
    grey = phase_to_grey(panel, problem.phase(parameters), 520e-9)
    truth = grey_to_phase(panel, grey, 620e-9)
    # The levels are whole numbers.
    step = max_phase(panel, 620e-9) / (panel.levels - 1)
    difference = (problem.phase_at(1)(parameters) - truth).abs()
    assert float((difference > 0.51 * step).double().mean()) < 0.02


def test_the_file_names_what_a_pattern_needs_to_be_shown(made):
    with h5py.File(made[1]) as file:
        settings = json.loads(file["entry/settings"][()])
        assert {"focus_dioptre", "orientation", "lut", "near", "far", "noise"} <= set(settings)
        assert file["entry/wavelength"].attrs["units"] == "m"
        assert {"steps", "cpu_seconds", "bound"} <= set(file["entry/quality"])


@pytest.mark.parametrize("orders", [pytest.param(1, marks=pytest.mark.sweep), 2])
def test_a_design_for_fringing_stays_within_the_panels_range(labapp, small, tmp_path, orders):
    """The phase isn't wrapped again when it is shown, and the file tells of the conditions."""
    code, _, err = labapp(
        *("design", "edof", "--bench", small.bench, "--size", "64", "--steps", "3", *DEPTHS),
        *("--orders", orders, "--fringing-um", "3", "--response-error", ".05"),
        *("--out", tmp_path / "a.h5"),
    )
    assert code == 0, err
    found = read_design(tmp_path / "a.h5")
    assert found.settings["fringing"] == pytest.approx(3e-6)
    assert found.settings["response_error"] == 0.05
    panel = read_bench(small.bench).build_camera().panel
    shown = grey_to_phase(panel, torch.from_numpy(found.grey[0]), 520e-9)
    step = max_phase(panel, 520e-9) / (panel.levels - 1)
    assert float((shown - torch.from_numpy(found.phase[0])).abs().max()) <= 0.51 * step
    assert found.phase.max() <= orders * 2 * np.pi - 0.99 * step


def test_the_conditions_of_a_design_share_the_wavelengths_filters(small):
    problem = problem_of(
        small, wavelengths=(520e-9, 620e-9), fringing=3e-6, response_error=0.1, start="flat"
    )
    bands = problem.further_bands()
    assert [one.filter_of for one in bands] == [None, 0, 1, 0, 1, 0, 1]
    assert [one.response for one in problem.conditions] == pytest.approx([1, 0.9, 1.1])
    assert {one.coupling for one in problem.conditions} == {3e-6}


def test_without_a_request_the_bench_says_how_its_pixels_couple(small):
    camera = read_bench(small.bench).build_camera()
    coupled = replace(camera, panel=replace(camera.panel, coupling=2e-6))
    assert EdofProblem(request_of(small), camera).conditions == ()
    (found,) = EdofProblem(request_of(small), coupled).conditions
    assert found.coupling == 2e-6
    radial = request_of(small, parametrisation="radial")
    assert EdofProblem(radial, coupled).conditions == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fringing": -1e-6}, "--fringing-um -1"),
        ({"response_error": 0.7}, "--response-error 0.7"),
        ({"fringing": 1e-6, "parametrisation": "radial"}, "choose quarter or free"),
    ],
)
def test_conditions_that_no_design_can_stand_are_refused(small, change, message):
    with pytest.raises(UserError, match=message):
        request_of(small, **change)
