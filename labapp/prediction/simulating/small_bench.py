"""The bundled virtual bench with few pixels, for comparisons with slow reference methods."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from labapp.bench.opening import BenchFiles, BenchSetup, read_scene
from labapp.files.bench_file import BenchFile
from labapp.files.reading import read_file

_SMALL_BENCH = {
    "panel": {"width": 48, "height": 36, "pitch_um": 40.0},
    "lens": {"f_number": 50.0},
    # Fewer and larger pixels keep the field of view.
    "sensor": {"width": 64, "height": 43, "pitch_um": 41.4},
}


def small_bench_setup(scene: Path | None) -> BenchSetup:
    """Return the bundled bench with fewer, larger pixels of sensor and panel.

    scene: None stands for the bundled one.
    Raises UserError if the scene can't be read.
    """
    return modified_bench_setup(scene, _SMALL_BENCH)


def modified_bench_setup(
    scene: Path | None, changes: Mapping[str, Mapping[str, float]]
) -> BenchSetup:
    """Return the bundled bench with changed keys in its tables.

    scene: None stands for the bundled one.
    Raises UserError if the scene can't be read.
    """
    files = BenchFiles.with_defaults(None, scene)
    data = read_file(files.bench, BenchFile).model_dump(mode="json")
    for table, entries in changes.items():
        data[table] |= entries
    small = BenchFile.model_validate(data)
    return BenchSetup(small, read_scene(files), "the small bench", str(files.scene))
