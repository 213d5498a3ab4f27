"""One record, one restored picture: of the report, of the command, and of the window."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys

import numpy as np
import pytest
from small_bench.files import write_small

from labapp.bench.opening import open_bench
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file
from labapp.pictures.analysis.brackets import merge_all
from labapp.pictures.report.record_analysis import analyse_record
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.window.commands import ReconstructRun
from labapp.window.engine.reconstruction import reconstruct_record
from optics.inverse import choice as restoration_choice
from optics.inverse.method_names import METHOD_CHOICES, RESTORATIONS, RestorationEntry
from optics.progress import Progress

pytestmark = pytest.mark.usefixtures("white_sheets")

REPORTED = [name for name, one in RESTORATIONS.items() if one.reported]


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """Star and photograph, neutral and through a lens on the panel."""
    small = write_small(tmp_path_factory.mktemp("small") / "files")
    block = {"patterns": ["neutral", "lens"], "wavelengths_nm": [550], "exposures_ms": [1, 8]}
    changes = {
        "acquire": [
            {"targets": ["dark"], **block, "patterns": ["neutral"]},
            {"targets": ["star", "photograph"], **block},
        ],
        "reconstruct": {"coded": "lens", "psf_window_px": 31, "iterations": 7},
    }
    plan = PlanFile.model_validate(read_file(small.plan, PlanFile).model_dump() | changes)
    with open_bench(small.bench_files) as bench:
        return run_plan(bench, plan, small.folder / "run.h5").path


def test_report_command_and_window_restore_a_record_alike_bit_for_bit(labapp, record, tmp_path):
    analysis = analyse_record(record)
    assert list(analysis.restored_pictures) == REPORTED
    code, printed, errors = labapp("report", record, "--json")
    assert code == 0, errors
    report = json.loads(printed)["scores"]
    for name in REPORTED:
        out, shown = tmp_path / f"{name}.npy", tmp_path / f"{name}-window.npy"
        code, printed, errors = labapp(
            "reconstruct", record, "--method", name, "--out", out, "--force", "--json"
        )
        assert code == 0, errors
        told = json.loads(printed)["score"]
        assert np.array_equal(np.load(out), analysis.restored_pictures[name].light[0])
        for figure in ("psnr_db", "ssim"):
            assert told[figure] == [report["coded"][figure], report[name][figure]]
        window = reconstruct_record(ReconstructRun(record, name, None), Progress())
        window.save(shown)
        assert np.array_equal(np.load(shown), np.load(out))
        assert window.result_message.scores[1] == (told["psnr_db"][1], told["ssim"][1])
    # What the plan says of its iterations holds in each of them.
    assert analysis.restored_pictures["richardson-lucy"].bands[0].iterations <= 7


def test_the_noise_of_a_record_is_at_least_that_of_its_photons(record):
    window = reconstruct_record(ReconstructRun(record, "tv", None), Progress())
    with Record(record) as opened:
        merged = merge_all(opened, Progress(), {"photograph"})
    (coded,) = [one for one in merged if one.pattern == "lens"]
    photons = np.sqrt(coded.variance[np.isfinite(coded.variance)].mean())
    assert window.outcome.bands[0].noise >= 0.999 * photons


def test_every_restoration_is_offered_and_asking_loads_no_engine(labapp):
    code, printed, _ = labapp("reconstruct", "--help")
    assert code == 0
    assert all(name in printed for name in METHOD_CHOICES)
    loaded = "import sys, labapp.cli.reconstruct; print('torch' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", loaded], capture_output=True, check=True)
    assert said.stdout.strip() == b"False"


def test_a_restoration_that_is_named_is_all_that_it_takes(monkeypatch):
    """Its module's METHOD and a line in the list: then it can be chosen, measured, asked for."""
    named = {**RESTORATIONS, "mine": RestorationEntry("mine", "optics.inverse.poisson")}
    monkeypatch.setattr("optics.inverse.method_names.RESTORATIONS", named)
    try:
        assert importlib.reload(restoration_choice).METHODS["mine"].default_count == 30
    finally:
        monkeypatch.undo()
        importlib.reload(restoration_choice)
