"""How well a calibration finds out what a bench hides."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from figures import Figure
from labapp.bench.opening import BenchSetup, open_bench
from labapp.calibration.calibrating import CalibrationResult, calibrate
from labapp.calibration.request import CalibrationRequest
from labapp.files.bench_file import read_bench
from labapp.files.reading import bundled_path
from labapp.files.scene_file import SceneFile
from optics.camera import Camera

_PHASE_GOAL, _PIXEL_GOAL, _FRAMES_GOAL = 0.02, 0.2, 60

_NM = 532.0
_RANGE, _GAMMA, _WIGGLE = 1.1, 1.15, 0.015
_TURN_DEG, _UNMODULATED = 3.7, 0.035
_OFFSET_UM = (180.0, -260.0)
_FOCAL_MM = 126.4

_TOL = 1e-3
"""Of the simulation: finer than what shall be found."""


def calibration_figures(folder: Path) -> list[Figure]:
    """The bundled bench, with a truth that its file doesn't tell, calibrated and judged by it.

    The response is distorted and ends a tenth off the data sheet, the panel is mirrored and
    turned, the lens longer, the star off the axis; shot and read noise, 12 bits.
    """
    setup = _hidden()
    with open_bench(setup) as bench:
        found = calibrate(bench, CalibrationRequest(wavelengths_nm=(_NM,)), folder / "calibration")
    described = setup.bench.build_camera()
    errors = _errors(found)
    overall, worst = _rms(errors), max(_rms(region) for region in errors)
    pixels, frames = _pixel_error(found, described), found.file.frames
    return [
        Figure(
            "unknown distorted response after calibration, all levels, four regions",
            f"≤ {_PHASE_GOAL:g} rad rms",
            f"{overall:.4f} rad rms, worst region {worst:.4f}, any level {abs(errors).max():.3f}",
            worst <= _PHASE_GOAL,
        ),
        Figure(
            "unknown registration after calibration, largest error in the frame",
            f"≤ {_PIXEL_GOAL:g} camera pixels",
            f"{pixels:.3f} pixels",
            pixels <= _PIXEL_GOAL,
        ),
        Figure(
            "frames that the calibration took in all, trials and darks included",
            f"≤ {_FRAMES_GOAL}",
            f"{frames}",
            frames <= _FRAMES_GOAL,
        ),
    ]


def _hidden() -> BenchSetup:
    """The bundled bench before a star, and what it really is."""
    truth = {
        "panel": {
            "unmodulated": _UNMODULATED,
            "response": {"range": _RANGE, "gamma": _GAMMA, "wiggle": _WIGGLE},
        },
        "lens": {"focal_length_mm": _FOCAL_MM},
        "mount": {"rotation_deg": _TURN_DEG, "flip_x": True},
    }
    star = {"kind": "star", "diameter_um": 70.0, "distance_m": 2.0, "radiance": 20.0}
    scene = {
        "version": 1,
        "title": "A star before a bench that isn't as described",
        "tol": _TOL,
        "targets": {"dark": {"kind": "dark"}, "star": star | {"offset_um": _OFFSET_UM}},
        "truth": truth,
    }
    bench = read_bench(bundled_path("bench.toml"))
    return BenchSetup(bench, SceneFile.model_validate(scene), "bench.toml", "hidden scene")


def _errors(found: CalibrationResult) -> NDArray[np.float64]:
    """Phase less the truth, radians, (regions, levels)."""
    (response,) = found.file.responses
    x = np.linspace(0, 1, len(response.curves[0].phase_rad))
    # The data sheet's 6.7 pi at 532 nm.
    truth = 6.7 * math.pi * _RANGE * (x**_GAMMA + _WIGGLE * np.sin(2 * math.pi * x))
    return np.array([curve.phase_rad for curve in response.curves]) - truth


def _rms(errors: NDArray[np.float64]) -> float:
    return float(np.sqrt((errors**2).mean()))


def _pixel_error(found: CalibrationResult, described: Camera) -> float:
    """The largest distance between where gratings send light and where the registration has it,
    over the sensor's corners, edges and middle."""
    sensor, panel = described.sensor, described.panel
    distance = 1 / (1 / (_FOCAL_MM * 1e-3) - 1 / described.lens.focus_distance)
    scale = _NM * 1e-9 * distance / (panel.pitch * sensor.pitch)
    cos, sin = math.cos(math.radians(_TURN_DEG)), math.sin(math.radians(_TURN_DEG))
    # (y, x) of both: the mirror first, then the turn from x towards y.
    matrix = scale * np.array([[cos, sin], [-sin, cos]]) @ np.diag([1.0, -1.0])
    # The star stands on a picture that is upright: larger y is larger y.
    star = np.array(_OFFSET_UM) * 1e-6 * distance / 2.0 / sensor.pitch
    centre = np.array([n // 2 for n in sensor.shape]) + star
    places = np.array([(y, x) for y in (0, 0.5, 1) for x in (0, 0.5, 1)])
    pixels = places * (np.array(sensor.shape) - 1)
    vectors = (pixels - centre) @ np.linalg.inv(matrix).T
    registration = found.file.registrations[0].build()
    return float(np.hypot(*(registration.to_pixels(vectors) - pixels).T).max())


MEASUREMENTS = {"calibration": calibration_figures}
