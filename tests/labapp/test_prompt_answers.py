"""Lists, and what is wrong with a question, are told before anything is loaded or computed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

_ASK = """
import contextlib, io, json, sys
from labapp import cli

HEAVY = ("torch", "scipy", "h5py", "matplotlib", "cv2", "simulator", "labapp.bench.opening")
answers = []
for words in json.loads(sys.stdin.read()):
    loaded, out, err = set(sys.modules), io.StringIO(), io.StringIO()
    sys.argv = ["labapp", *words]
    from labapp.common import console
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            cli.main()
            code = 0
        except SystemExit as end:
            code = end.code
    heavy = sorted((set(sys.modules) - loaded) & set(HEAVY))
    answers.append({"code": code, "heavy": heavy, "said": out.getvalue() + err.getvalue()})
print(json.dumps(answers))
"""

LISTS = {
    "pattern list": "zernike: ",
    "retrieve list": "spiral: ",
    "plan list": "coded-snapshot",
    "study list": "near_m",
    "accuracy list": "retrieval: ",
    "help": "first-session",
    "help walks": "labapp/window/session.py",
    "--help": "reconstruct",
    "pattern --help": "KEY=VALUE",
    "study --help": "psf-stability",
    "accuracy chain --help": "--separation-mm",
}

REFUSED = {
    "help walk": "Did you mean 'walks'?",
    "pattern waves": "'waves' is not known",
    "pattern lens focal=3 --out new.png": "key 'focal' is unknown",
    "pattern lens focal_length_m=3": "there is no --out",
    "pattern lens focal_length_m=3 --out old.png": "exists already",
    "pattern lens focal_length_m=3 --out new.gif": "the ending must be one of",
    "pattern lens focal_length_m=3 --frames 2 --out new.png": "would all be alike",
    "retrieve waves": "'waves' is not known",
    "retrieve ring --out none/new.png": "is not a folder",
    "plan show none": "choose a ready plan",
    "plan check old.png": "is not a text file",
    "run none --out new.h5": "choose a ready plan",
    "run slm-response --out old.h5": "exists already",
    "run slm-response --out new.h5 --bench none.toml": "none.toml: cannot be read",
    "run slm-response --out new.h5 --scene none": "choose a ready scene",
    "demo --out .": "exists already",
    "resume none.h5": "no such file",
    "show none.h5": "no such file",
    "verify none.h5": "no such file",
    "report old.h5 --out .": "exists already",
    "study waves --out new": "'waves' is not known",
    "study refocus --out new near=3": "'near' is unknown",
    "study refocus --out .": "exists already",
    "psf --out old.png": "exists already",
    "psf --out new.gif": "the ending must be one of",
    "psf --out new.npy --field 1": "--field 1: give 2 numbers",
    "psf --out new.npy --zernike 4,0": "--zernike 4,0: give 3 numbers",
    "psf --out new.npy --centre near": "--centre near: give 2 numbers",
    "psf --out new.npy --camera none.toml": "none.toml: cannot be read",
    "beam --out new.gif": "the ending must be .png",
    "accuracy psf --plot old.png": "exists already",
    "accuracy chain --panel 12x8": "--panel 12x8: give rows",
    "accuracy chain --panel 0x8x8": "--panel 0x8x8: give rows",
    "accuracy chain --pattern waves": "--pattern waves: choose random",
    "accuracy chain --field 1": "--field 1: give 2 numbers",
    "accuracy chain --plot old.png": "exists already",
    "accuracy propagate --light red": "--light red: choose smooth",
    "accuracy propagate --distance 0": "--distance 0: it must be finite",
    "accuracy propagate --target-pitch-um -1": "--target-pitch-um -1: it must be positive",
    "accuracy propagate --centre near": "--centre near: give 2 numbers",
    "accuracy retrieval waves": "'waves' is not known",
    "accuracy deconvolve --blur fog": "--blur fog: is unknown",
    "accuracy deconvolve --border sharp": "--border sharp: is no such one",
    "accuracy multispectral --psf triangle": "--psf triangle: is unknown",
    "accuracy deconvolve none.png": "none.png: cannot be read",
    "simulate --out old.h5": "exists already",
    "simulate --out new.png --frames 2": "a .png holds one frame",
    "explain none": "choose a ready scene",
    "reconstruct none.png": "none.png: cannot be read: there is no such file",
    "reconstruct old.png --out old.png": "is a file that is read",
    "reconstruct old.h5 --bands 0.45,0.7": "--bands 0.45,0.7: in micrometres?",
    "reconstruct old.h5 --bands all --out new.png": "the ending says the kind of a cube",
    "reconstruct old.h5 --light A": "--light: means something with --bands only",
    "train denoiser . --out new.npy": "weights are written as .npz",
    "refine old.h5": "there is no --out",
    "calibrate": "--out is missing",
    "devices --bench none.toml": "none.toml: cannot be read",
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """One fresh process is asked everything: it stays light to the end, or the test that made it
    heavy fails."""
    folder = tmp_path_factory.mktemp("questions")
    for name in ("old.h5", "run.h5", "report.png", "study.png"):
        (folder / name).write_bytes(b"")
    cv2.imwrite(str(folder / "old.png"), np.zeros((4, 4), np.uint8))
    questions = [*LISTS, *REFUSED]
    asked = json.dumps([question.split() for question in questions])
    done = subprocess.run(
        [sys.executable, "-c", _ASK],
        input=asked, capture_output=True, text=True, check=True, cwd=folder,
        env={"PYTHONPATH": str(Path(__file__).parents[2]), "COLUMNS": "200", "TERM": "dumb"},
    )  # fmt: skip
    assert {one.name for one in folder.iterdir()} == {
        "old.h5", "old.png", "run.h5", "report.png", "study.png",
    }  # fmt: skip
    return dict(zip(questions, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("question", LISTS)
def test_a_list_is_printed_without_what_computes(answers, question):
    answer = answers[question]
    assert answer["heavy"] == []
    assert (answer["code"], LISTS[question] in answer["said"]) == (0, True)


@pytest.mark.parametrize("question", REFUSED)
def test_a_bad_question_is_refused_without_what_computes(answers, question):
    answer = answers[question]
    assert answer["heavy"] == []
    assert answer["code"] == 1
    assert REFUSED[question] in answer["said"]


@pytest.fixture
def never(monkeypatch):
    """Functions by their names, which fail the test if they are called."""

    def forbid(*names: str) -> None:
        for name in names:
            monkeypatch.setattr(name, lambda *_, name=name, **__: pytest.fail(f"{name} was called"))

    return forbid


def test_a_chain_that_takes_too_long_is_refused_before_anything_is_planned(labapp, never):
    never(
        "optics.psf.PSFOperator.__init__",
        "labapp.accuracy.chain.machine_speed",
        "labapp.accuracy.references.psf_problem.chain_density",
    )
    wide = ["--panel", "1080x1920x8", "--f-number", "2", "--separation-mm", "20"]
    code, _, said = labapp("accuracy", "chain", *wide)
    assert (code, "takes too long" in said) == (1, True)


def test_a_pattern_of_another_panel_is_refused_before_a_psf_is_planned(labapp, never, tmp_path):
    never(
        "labapp.prediction.psf_prediction.machine_speed",
        "labapp.prediction.psf_prediction.PSFOperator",
    )
    pattern = tmp_path / "pattern.png"
    cv2.imwrite(str(pattern), np.zeros((8, 8), np.uint8))
    code, _, said = labapp("psf", "--pattern", pattern, "--out", tmp_path / "psf.npy")
    assert (code, "1080" in said) == (1, True)
    code, _, said = labapp("psf", "--sphere", "--out", tmp_path / "psf.npy")
    assert (code, "--sphere: a lens alone" in said) == (1, True)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--target", "moon"], "--target moon: the scene has"),
        (["--exposure-ms", "-1"], "--exposure-ms -1: give a positive time"),
        (["--tol", "2"], "--tol 2: give a number between"),
        (["--set", "read noise"], "give an effect and its level"),
    ],
)
def test_a_bad_picture_is_refused_before_a_bench_is_opened(
    labapp, never, tmp_path, words, complaint
):
    never("labapp.prediction.simulating.picture_request.open_bench")
    for command in (["explain"], ["simulate", "--out", tmp_path / "new.png"]):
        code, _, said = labapp(*command, *words)
        assert (code, complaint in said) == (1, True)


def test_a_truth_of_another_shape_is_refused_before_a_blur_is_looked_for(labapp, never, tmp_path):
    never("optics.inverse.blind.find_kernel")
    seen, truth = tmp_path / "seen.npy", tmp_path / "truth.npy"
    np.save(seen, np.random.default_rng(0).uniform(size=(40, 40)))
    np.save(truth, np.ones((40, 41)))
    code, _, said = labapp("reconstruct", seen, "--blind", "5", "--truth", truth)
    assert (code, "it must be 1 x 40 x 40" in said) == (1, True)


def test_a_calibration_with_no_place_is_refused_before_a_bench_is_opened(labapp, never, tmp_path):
    never("labapp.calibration.command.open_bench")
    (tmp_path / "calibration.json").write_text("{}")
    for words in ([], ["--regions", "2"]):
        code, _, said = labapp("calibrate", "--out", tmp_path, *words)
        assert (code, ("exists already" if not words else "--regions 2") in said) == (1, True)
