"""What the small bench of a window's tests looks at: pictures that are computed in no time."""

from __future__ import annotations

from pathlib import Path

from small_bench.files import bench_text

from labapp.bench.opening import BenchFiles
from labapp.files.reading import bundled_path

_SCENE = """
version = 1
title = "Small scene"
tol = 0.01

[effects] # what takes longest is left out, whatever it changes
"panel orders" = false
"PSF reach" = false

[targets.dark]
kind = "dark"

[targets.flat]
kind = "flat"
distance_m = 2.0
radiance = 0.5

[targets.star]
kind = "star"
diameter_um = 70.0
distance_m = 2.0
radiance = 20.0

[targets.photograph]
kind = "photograph"
file = "{photograph}"
distance_m = 2.0
radiance = 0.1
cover = 1.05
"""


def write_bench(folder: Path) -> BenchFiles:
    """The small bench, and a scene of four targets, two effects of it forced off."""
    files = BenchFiles(folder / "bench.toml", folder / "scene.toml")
    files.bench.write_text(bench_text())
    files.scene.write_text(_SCENE.format(photograph=bundled_path("photograph.jpg")))
    return files
