"""A small virtual bench with a colour sensor before a star, a white sheet and spectral patches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from labapp.bench.opening import BenchFiles, open_bench
from labapp.files.plan_file import PlanFile
from labapp.files.reading import bundled_path, read_file
from labapp.files.spectrum_file import read_spectra
from labapp.runs.acquisition.runner import run_plan

BANDS_NM = (460.0, 540.0, 620.0)
ROWS, COLUMNS = 80, 96
PITCH_UM = 7.4

_STAR_UM = (110.0, -190.0)
"""Where the star is, [y, x] from the axis, upright: 1 and 1.7 pixels from it in the picture."""

BENCH = """
version = 1
name = "Spectral bench"
transmission = 0.15
[panel]
model = "coarse"
width = 192
height = 108
pitch_um = 80.0
fill_factor = 0.9
unmodulated = 0.05
reflectivity = 0.6
settling_ms = 50.0
max_phase_pi = {{ 452 = 9.0, 532 = 6.7, 633 = 5.4 }}
[lens]
focal_length_mm = 125.0
f_number = 5.0
focus_distance_m = 2.0
[sensor]
{sensor}
width = {columns}
height = {rows}
[devices.slm]
driver = "simulated-slm"
[devices.filter]
driver = "simulated-filter"
options = {{ range_nm = [440.0, 700.0], bandwidth_nm = 10.0 }}
[devices.camera]
driver = "simulated-camera"
[devices.targets]
driver = "simulated-targets"
"""

COLOUR_SENSOR = 'file = "dvc-4000c-like"'
MONO_SENSOR = """file = "dvc-4000c-like"
quantum_efficiency = 0.6"""

SCENE = f"""
version = 2
title = "A star, a white sheet and patches under halogen"
tol = 0.5
effects = {{ "panel orders" = false }}
[lights.halogen]
kind = "halogen"
[targets.dark]
kind = "dark"
[targets.star]
kind = "star"
diameter_um = 70.0
distance_m = 2.0
offset_um = {list(_STAR_UM)}
radiance = 20.0
light = "halogen"
[targets.flat]
kind = "flat"
distance_m = 2.0
radiance = 0.1
light = "halogen"
[targets.photograph]
kind = "cube"
file = "patches.npz"
wavelengths_nm = [400.0, 700.0]
white = 1.0
distance_m = 2.0
radiance = 0.1
light = "halogen"
"""

_PLAN = """
version = 1
title = "Spectra"
seed = 5
[patterns.neutral]
kind = "constant"
[patterns.ring]
kind = "ring"
radius_um = 40.0
width_um = 8.0
wavelength_nm = 550
iterations = 10
[[acquire]]
targets = ["star"]
patterns = ["neutral"]
wavelengths_nm = {bands}
exposures_ms = [30]
interleave = [{{ role = "dark", frames = 2 }}]
[[acquire]]
targets = ["star"]
patterns = ["ring"]
wavelengths_nm = {bands}
exposures_ms = [240]
interleave = [{{ role = "dark", frames = 2 }}]
[[acquire]]
targets = ["photograph"]
patterns = ["neutral", "ring"]
wavelengths_nm = {bands}
exposures_ms = [200]
interleave = [{{ role = "dark", frames = 2 }}{flat}]
[reconstruct]
coded = "ring"
psf_window_px = 41
"""

_FLAT = ', { role = "flat", frames = 1 }'


def patches() -> np.ndarray:
    """Reflectances of a scene, (rows, columns, bands at 400:10:700 nm): 20 patches of a chart."""
    chart = read_spectra(bundled_path("spectra") / "colorchecker.csv")
    nm = np.arange(400, 701, 10)
    spectra = np.array([one.at(nm / 1e9) for one in chart.values()])[:20]
    cells = np.random.default_rng(1).permutation(20).reshape(4, 5)
    return spectra[np.kron(cells, np.ones((24, 24), dtype=int))].astype(np.float32)


def write_files(
    folder: Path, *, sensor: str = COLOUR_SENSOR, flat: bool = True, more: str = "", truth: str = ""
) -> BenchFiles:
    """Write bench, scene and plan; `more` is added to the bench, and `truth` to the scene."""
    bench = BENCH.format(sensor=sensor, columns=COLUMNS, rows=ROWS)
    (folder / "bench.toml").write_text(bench + more)
    (folder / "scene.toml").write_text(SCENE + truth)
    np.savez(folder / "patches.npz", reflectance=patches())
    plan = _PLAN.format(bands=list(BANDS_NM), flat=_FLAT if flat else "")
    (folder / "plan.toml").write_text(plan)
    return BenchFiles(folder / "bench.toml", folder / "scene.toml")


def take_record(folder: Path, **options: Any) -> Path:
    """Photograph star, sheet and patches in each band, neutral and through a ring."""
    files = write_files(folder, **options)
    with open_bench(files) as bench:
        return run_plan(bench, read_file(folder / "plan.toml", PlanFile), folder / "run.h5").path


def star_place() -> tuple[float, float]:
    """Row and column of the star's middle, by the thin lens' magnification, 0.125 / (2 - 0.125)."""
    y, x = (um * 0.125 / 1.875 / PITCH_UM for um in _STAR_UM)
    return ROWS // 2 + y, COLUMNS // 2 + x


def patch_reflectances() -> np.ndarray:
    """Reflectances of the scene's patches in the bands, (patches, bands)."""
    at = [round((one - 400) / 10) for one in BANDS_NM]
    return patches()[12::24, 12::24].reshape(20, -1)[:, at]


def patch_means(values: np.ndarray) -> np.ndarray:
    """Means of a cube (bands, rows, columns) over the middles of the scene's patches.

    The picture of 96 x 120 samples covers the frame and 5 % more: 0.875 pixels a sample.
    """
    middles = []
    for row in range(4):
        for column in range(5):
            y = ROWS / 2 + (24 * row + 12 - 48) * 0.875
            x = COLUMNS / 2 + (24 * column + 12 - 60) * 0.875
            rows, columns = (slice(max(round(at) - 5, 0), round(at) + 6) for at in (y, x))
            middles.append(values[:, rows, columns].mean((1, 2)))
    return np.array(middles)
