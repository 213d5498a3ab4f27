"""The bundled bench with few pixels: everything can be computed on it, slowly or at once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from labapp.bench.opening import BenchFiles, BenchSetup, read_scene
from labapp.files.bench_file import BenchFile
from labapp.files.reading import read_file

_SMALL_BENCH = {
    "panel": {"width": 48, "height": 36, "pitch_um": 40.0},
    "lens": {"f_number": 50.0},
    # The same field of view.
    "sensor": {"width": 64, "height": 43, "pitch_um": 41.4},
}


def small_bench_setup(scene: Path | None) -> BenchSetup:
    """With few and large pixels, of sensor and panel, before a scene; the bundled photograph if
    None. UserError if it can't be read."""
    return modified_bench_setup(scene, _SMALL_BENCH)


def modified_bench_setup(
    scene: Path | None, changes: Mapping[str, Mapping[str, float]]
) -> BenchSetup:
    """The bundled bench with other entries in its tables, before a scene; arguments as above."""
    files = BenchFiles.with_defaults(None, scene)
    data = read_file(files.bench, BenchFile).model_dump(mode="json")
    for table, entries in changes.items():
        data[table] |= entries
    small = BenchFile.model_validate(data)
    return BenchSetup(small, read_scene(files), "the small bench", str(files.scene))
