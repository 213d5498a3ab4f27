"""The bundled bench with few pixels: everything can be computed on it, slowly or at once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from labapp.bench import BenchFiles, BenchSetup, read_scene
from labapp.files.bench_file import BenchFile
from labapp.files.reading import bundled, read_file

_CHANGES = {
    "panel": {"width": 48, "height": 36, "pitch_um": 40.0},
    "lens": {"f_number": 50.0},
    # The same field of view.
    "sensor": {"width": 64, "height": 43, "pitch_um": 41.4},
}

_PART = {"sensor": {"width": 256, "height": 256}}


def quick_setup(scene: Path | None) -> BenchSetup:
    """With few and large pixels, of sensor and panel, before a scene; the bundled photograph if
    None. UserError if it can't be read."""
    return _changed(scene, _CHANGES)


def part_setup(scene: Path | None) -> BenchSetup:
    """With a part of its sensor, 256 x 256 pixels."""
    return _changed(scene, _PART)


def _changed(scene: Path | None, changes: Mapping[str, Mapping[str, float]]) -> BenchSetup:
    files = BenchFiles.default(None, scene)
    data = read_file(files.bench, BenchFile).model_dump(mode="json")
    for table, entries in changes.items():
        data[table] |= entries
    small = BenchFile.model_validate(data)
    return BenchSetup(small, read_scene(files), "the small bench", str(files.scene))


def scene_files() -> list[Path]:
    """Of all scenes that are bundled."""
    first = bundled("scene.toml")
    return [first, *sorted((first.parent / "scenes").glob("*.toml"))]
