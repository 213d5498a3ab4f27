"""The small bench as files: a bench file of some size, a scene, a plan of 16 frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from labapp.bench.opening import BenchFiles


@dataclass(frozen=True)
class Size:
    """What a picture's cost follows from. panel, sensor: (rows, columns)."""

    panel: tuple[int, int] = (108, 192)
    panel_pitch_um: float = 80.0
    f_number: float = 5.0
    sensor: tuple[int, int] = (64, 96)
    sensor_pitch_um: float = 3.45


SMALL = Size()
"""As large as the virtual bench's panel and stop, of a tenth of the pixels a side."""

TINY = Size((48, 64), 40.0, 40.0, (40, 45), 14.0)
"""A slow lens before large pixels: even what computes everything is done in milliseconds."""

FULL_WELL = 10500.0


def bench_text(size: Size = SMALL, *, filter_options: str = "", camera_options: str = "") -> str:
    """A bench file. The options are what stands in a device's table of them."""
    return f"""
version = 1
name = "Small bench"
transmission = 0.6

[panel]
model = "small"
width = {size.panel[1]}
height = {size.panel[0]}
pitch_um = {size.panel_pitch_um}
fill_factor = 0.9
unmodulated = 0.05
reflectivity = 0.6
settling_ms = 50.0
max_phase_pi = {{ 452 = 9.0, 532 = 6.7, 633 = 5.4 }}

[lens]
focal_length_mm = 125.0
f_number = {size.f_number}
focus_distance_m = 2.0

[sensor]
model = "small"
width = {size.sensor[1]}
height = {size.sensor[0]}
pitch_um = {size.sensor_pitch_um}
bits = 12
full_well_electrons = {FULL_WELL}
gain_electrons_per_dn = 2.6
read_noise_electrons = 2.4
dark_current_electrons_per_s = 1.0
black_level_dn = 64.0
quantum_efficiency = 0.62
shortest_exposure_us = 20.0
longest_exposure_s = 30.0

[devices.slm]
driver = "simulated-slm"
[devices.filter]
driver = "simulated-filter"
{_options(filter_options)}
[devices.camera]
driver = "simulated-camera"
{_options(camera_options)}
[devices.targets]
driver = "simulated-targets"
"""


def _options(entries: str) -> str:
    return f"options = {{ {entries} }}" if entries else ""


def scene_text(star: float = 5.0, settings: str = "") -> str:
    """A scene file. star: its radiance. settings: lines before the targets."""
    return f"""
version = 1
title = "Small scene"
{settings}
[targets.dark]
kind = "dark"
[targets.star]
kind = "star"
diameter_um = 70.0
distance_m = 2.0
radiance = {star}
[targets.photograph]
kind = "photograph"
file = "picture.png"
distance_m = 2.0
radiance = 0.05
"""


PLAN = """
version = 1
title = "Small plan"
seed = 3
[patterns.neutral]
kind = "constant"
[patterns.lens]
kind = "lens"
focal_length_m = 50.0
[[acquire]]
targets = ["dark", "star"]
patterns = ["neutral", "lens"]
wavelengths_nm = [540, 550]
exposures_ms = [1, 8]
"""


@dataclass(frozen=True)
class SmallFiles:
    """Paths of a small bench, its scene, a plan of 16 frames, and the folder they are in."""

    folder: Path

    @property
    def bench(self) -> Path:
        return self.folder / "bench.toml"

    @property
    def scene(self) -> Path:
        return self.folder / "scene.toml"

    @property
    def plan(self) -> Path:
        return self.folder / "plan.toml"

    @property
    def bench_files(self) -> BenchFiles:
        return BenchFiles(self.bench, self.scene)

    def arguments(self) -> list[str]:
        return ["--bench", str(self.bench), "--scene", str(self.scene)]


def write_small(folder: Path) -> SmallFiles:
    """The files of the small bench, in a folder that is made where there is none."""
    return _write(folder, SMALL, 5.0)


def write_tiny(folder: Path) -> SmallFiles:
    """The tiny bench before a star that is as bright through its slow lens."""
    return _write(folder, TINY, 5000.0)


def _write(folder: Path, size: Size, star: float) -> SmallFiles:
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(0)
    cv2.imwrite(str(folder / "picture.png"), rng.integers(0, 255, (64, 96, 3), dtype=np.uint8))
    files = SmallFiles(folder)
    files.bench.write_text(bench_text(size))
    files.scene.write_text(scene_text(star))
    files.plan.write_text(PLAN)
    return files
