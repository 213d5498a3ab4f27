"""The bundled bench with few pixels, on which everything can be computed."""

from __future__ import annotations

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


def quick_setup(scene: Path | None) -> BenchSetup:
    """Before a scene, the bundled photograph if None; UserError if it can't be read."""
    files = BenchFiles.default(None, scene)
    data = read_file(files.bench, BenchFile).model_dump(mode="json")
    for table, changes in _CHANGES.items():
        data[table] |= changes
    small = BenchFile.model_validate(data)
    return BenchSetup(small, read_scene(files), "the small bench", str(files.scene))


def scene_files() -> list[Path]:
    """Of all scenes that are bundled."""
    first = bundled("scene.toml")
    return [first, *sorted((first.parent / "scenes").glob("*.toml"))]
