"""Mutated files of a tiny bench, and what reads them: their loaders, then the check commands."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from small_bench.files import PLAN, write_tiny

from hostile.mutated_texts import mutate

_COLOURS = """
[lights.lamp]
kind = "halogen"
flicker = { frequency_hz = 100.0, depth = 0.2 }
[lights.table]
kind = "table"
file = "spectra.csv"
[targets.lit]
kind = "flat"
distance_m = 2.0
radiance = 0.05
light = "table"
motion = { velocity_mm_s = [0.1, 0.0] }
[targets.edge]
kind = "slanted-edge"
size_mm = 60.0
angle_deg = 5.0
distance_m = 2.0
radiance = 0.2
light = "lamp"
[targets.hole]
kind = "pinhole"
distance_m = 1.9
radiance = 900.0
[truth.panel]
coupling_um = 1.0
flatness = [[2, 0, 30.0]]
illumination = { radius_mm = 5.0 }
[truth.mount]
rotation_deg = 0.5
shift_mm = [0.01, 0.0]
"""

_PATTERNS = """
[patterns.ramp]
kind = "blaze"
period_px = 8.0
[patterns.cubic]
kind = "cubic"
strength_rad = 3.0
[patterns.both]
kind = "video"
frames = ["neutral", "ramp"]
[retry]
attempts = 2
wait_s = 0.1
[metadata]
sample = 1
"""

_BENCH, _SCENE = ("--bench", "{folder}/bench.toml"), ("--scene", "{folder}/scene.toml")
_CHECK = ("bench", "check", "{folder}/bench.toml", *_SCENE)
_PLAN = ("plan", "check", "{folder}/plan.toml", *_BENCH, *_SCENE)
_SHOW = ("plan", "show", "{folder}/plan.toml", *_BENCH, *_SCENE)
_EXPLAIN = ("explain", "{folder}/scene.toml", *_BENCH)
_PSF = ("psf", "--camera", "{folder}/bench.toml", "--size", "16", "--out", "{folder}/psf.npy",
        "--force")  # fmt: skip

Command = Sequence[str]


@dataclass(frozen=True)
class MutatedFile:
    """A file that is mutated, how it is loaded, and the commands that check it when it loads."""

    name: str
    kind: str
    load: Callable[[Path], object]
    commands: Sequence[Command]


def write_whole_files(folder: Path) -> dict[str, str]:
    """The files of a bench that names a file of each kind, with their texts by name."""
    small = write_tiny(folder)
    bench = small.bench.read_text()
    head, _, rest = bench.partition("[panel]")
    panel, _, rest = rest.partition("[lens]")
    lens, _, rest = rest.partition("[sensor]")
    sensor, _, devices = rest.partition("[devices.slm]")
    curve = 'quantum_efficiency = { file = "spectra.csv" }'
    texts = {
        "bench.toml": f'{head}calibration = "calibration.json"\npanel = {{ file = "panel.toml" }}\n'
        f'sensor = {{ file = "sensor.toml" }}\n[lens]{lens}[devices.slm]{devices}',
        "panel.toml": "version = 1" + panel,
        "sensor.toml": "version = 1" + sensor.replace("quantum_efficiency = 0.62", curve),
        "scene.toml": small.scene.read_text().replace("version = 1", "version = 2") + _COLOURS,
        "plan.toml": PLAN + _PATTERNS,
        "calibration.json": json.dumps(_calibration(), indent=1),
        "spectra.csv": "nm,share\n"
        + "".join(f"{nm}, {nm / 1000}\n" for nm in range(300, 1000, 50)),
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    return texts


def _calibration() -> dict[str, object]:
    """A calibration of the tiny panel by hand, with two regions at one wavelength."""
    levels = 256
    curve = {
        "phase_rad": [round(k * 6.7 * np.pi / (levels - 1), 6) for k in range(levels)],
        "sigma_rad": [0.01] * levels, "residual": 0.01, "chi2": 1.0, "blur_px": 0.0, "ripple": 0.0,
        "frames": 40, "outliers": 0,
    }  # fmt: skip
    wavefront = {
        "wavelength_nm": 540.0, "terms": [[2, 0], [2, 2]], "path_nm": [20.0, 5.0],
        "covariance_nm2": [[1.0, 0.0], [0.0, 1.0]], "radius_mm": 1.6, "rms_nm": 20.0,
        "sigma_nm": 1.0, "focus_dioptres": 0.01, "focus_sigma_dioptres": 0.001, "residual": 0.01,
        "chi2": 1.0,
    }  # fmt: skip
    return {
        "version": 1, "date": "2026-01-31T12:00:00Z", "bench": "tiny", "record": "run.h5",
        "frames": 80, "software": "labapp", "devices": {}, "panel": {}, "lens": {}, "sensor": {},
        "responses": [{"wavelength_nm": 540.0, "regions": [1, 2], "curves": [curve, curve]}],
        "wavefront": wavefront,
        "zeroth": [{"wavelength_nm": 540.0, "share": 0.05, "sigma": 0.01, "frames": 4}],
    }  # fmt: skip


def mutated_files() -> Mapping[str, MutatedFile]:
    """What is mutated, by name."""
    from labapp.files.bench_file import read_bench
    from labapp.files.plan_file import read_plan
    from labapp.files.reading import read_file
    from labapp.files.scene_file import SceneFile
    from labapp.files.spectrum_file import read_spectra

    def camera(path: Path) -> object:
        return read_bench(path.with_name("bench.toml")).build_camera()

    found = (
        MutatedFile("bench.toml", "toml", camera, (_CHECK, _SHOW, _PSF, _EXPLAIN)),
        MutatedFile("panel.toml", "toml", camera, (_CHECK, _PSF)),
        MutatedFile("sensor.toml", "toml", camera, (_CHECK, _EXPLAIN)),
        MutatedFile("calibration.json", "json", camera, (_CHECK, _PSF)),
        MutatedFile(
            "scene.toml", "toml", lambda path: read_file(path, SceneFile), (_EXPLAIN, _PLAN)
        ),
        MutatedFile("plan.toml", "toml", read_plan, (_PLAN, _SHOW)),
        MutatedFile("spectra.csv", "csv", read_spectra, (_CHECK, _EXPLAIN)),
    )
    return {one.name: one for one in found}


def mutations(texts: Mapping[str, str], seed: int, count: int) -> Iterator[tuple[str, bytes]]:
    """Names and contents of mutated files, each kind as often as the others."""
    rng, kinds = random.Random(seed), mutated_files()
    for number in range(count):
        one = list(kinds.values())[number % len(kinds)]
        yield one.name, mutate(texts[one.name], one.kind, rng)
