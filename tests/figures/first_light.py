"""The demo's time and quality, and its PSF against an independent prediction."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from judges.star import Star, star_picture

from figures import Figure
from labapp.files.scene_file import StarTable
from labapp.pictures.report.record_analysis import analyse_record
from labapp.runs.record.reader import Record
from labapp.studies.demo import run_first_light

_SECONDS_GOAL, _GAIN_GOAL, _ERROR_GOAL = 60.0, 3.0, 0.05


def demo_figures(folder: Path) -> list[Figure]:
    """Wall time of `labapp demo` as a process, and what its reconstruction gained."""
    started = time.perf_counter()
    command = [sys.executable, "-m", "labapp", "demo", "--out", str(folder), "--json", "--force"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds = time.perf_counter() - started
    said = json.loads(done.stdout)
    before, after = said["scores"]["coded"], said["scores"][said["best"]]
    gain = after["psnr_db"] - before["psnr_db"]
    better = after["ssim"] > before["ssim"]
    return [
        Figure(
            "labapp demo", f"≤ {_SECONDS_GOAL:g} s", f"{seconds:.1f} s", seconds <= _SECONDS_GOAL
        ),
        Figure(
            "best reconstruction against the coded photograph, central 90 %",
            f"≥ {_GAIN_GOAL:g} dB PSNR, better SSIM",
            f"{gain:+.1f} dB, SSIM {before['ssim']:.3f} to {after['ssim']:.3f}",
            gain >= _GAIN_GOAL and better,
        ),
    ]


def prediction_figure(folder: Path) -> list[Figure]:
    """Relative L2 between the measured full PSF and a direct quadrature of the same star."""
    run_first_light(folder)
    error = prediction_error(folder / "run.h5")
    return [
        Figure(
            "measured full PSF against direct quadrature, star and pixel included",
            f"≤ {_ERROR_GOAL:.0%} L2",
            f"{error:.1%}",
            error <= _ERROR_GOAL,
        )
    ]


def prediction_error(path: Path) -> float:
    """|measured - predicted| / |predicted| in the measured window, without a fitted scale."""
    analysis = analyse_record(path)
    assert analysis.psf is not None
    measured = analysis.psf.measured
    with Record(path) as record:
        roles = record.plan.reconstruct
        assert roles is not None
        camera = record.bench.build_camera()
        band = record.bench.devices.filter.options["bandwidth_nm"] * 1e-9
        wavelength = float(record.column("wavelength")[record.select(target=roles.star)[0]])
        star = _star(record, roles.star)
        coded, neutral = (
            star_picture(camera, record.pattern(name), wavelength, band, star, measured.shape[0])
            for name in (roles.coded, roles.neutral)
        )
    predicted = coded / neutral.sum()
    return float(np.linalg.norm(measured - predicted) / np.linalg.norm(predicted))


def _star(record: Record, name: str) -> Star:
    assert record.scene is not None
    table = record.scene.targets[name]
    assert isinstance(table, StarTable)
    return Star(table.diameter_um * 1e-6, table.distance_m)


MEASUREMENTS = {"demo": demo_figures, "quadrature": prediction_figure}
