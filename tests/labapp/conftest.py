"""A small virtual bench in files, and one run of the demo that several tests look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from labapp.analysis import Analysis
from labapp.bench import BenchFiles
from labapp.demo import first_light
from labapp.speed import keep
from optics.accuracy import MachineSpeed

BENCH = """
version = 1
name = "Small bench"
transmission = 0.5

[panel]
model = "small"
width = 192
height = 108
pitch_um = 80.0
fill_factor = 0.9
unmodulated = 0.05
reflectivity = 0.6
settling_ms = 50.0
max_phase_pi = { 452 = 9.0, 532 = 6.7, 633 = 5.4 }

[lens]
focal_length_mm = 125.0
f_number = 5.0
focus_distance_m = 2.0

[sensor]
model = "small"
width = 96
height = 64
pitch_um = 3.45
bits = 12
full_well_electrons = 10500.0
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
[devices.camera]
driver = "simulated-camera"
[devices.targets]
driver = "simulated-targets"
"""

SCENE = """
version = 1
title = "Small scene"
[targets.dark]
kind = "dark"
[targets.star]
kind = "star"
diameter_um = 70.0
distance_m = 2.0
radiance = 5.0
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
    bench: Path
    scene: Path
    plan: Path

    @property
    def bench_files(self) -> BenchFiles:
        return BenchFiles(self.bench, self.scene)

    def arguments(self) -> list[str]:
        return ["--bench", str(self.bench), "--scene", str(self.scene)]


@pytest.fixture(scope="session", autouse=True)
def kept_speed(tmp_path_factory):
    """A machine of the usual speed: nothing is measured, and nobody's cache is written."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        keep(MachineSpeed())
        yield


@pytest.fixture
def small(tmp_path: Path) -> SmallFiles:
    folder = tmp_path / "files"
    folder.mkdir()
    rng = np.random.default_rng(0)
    cv2.imwrite(str(folder / "picture.png"), rng.integers(0, 255, (64, 96, 3), dtype=np.uint8))
    paths = {"bench": BENCH, "scene": SCENE, "plan": PLAN}
    for name, text in paths.items():
        (folder / f"{name}.toml").write_text(text)
    return SmallFiles(folder, *(folder / f"{name}.toml" for name in paths))


@dataclass(frozen=True)
class Demo:
    folder: Path
    analysis: Analysis

    @property
    def record(self) -> Path:
        return self.folder / "run.h5"


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    """The demo as a user gets it, run once for all tests that look at it."""
    folder = tmp_path_factory.mktemp("demo")
    return Demo(folder, first_light(folder))


@pytest.fixture
def labapp(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Run the command line in this process: its exit code, standard output and error."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        from labapp.cli import main

        monkeypatch.setattr("sys.argv", ["labapp", *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run
