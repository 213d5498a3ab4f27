"""Finding a scene: a file, or a ready scene by its name."""

from __future__ import annotations

from pathlib import Path

from labapp.errors import UserError
from labapp.files.reading import bundled


def ready_scenes() -> dict[str, Path]:
    """The scenes that come with the application, by name."""
    return {path.stem: path for path in sorted(bundled("scenes").glob("*.toml"))}


def find_scene(name: Path | str) -> Path:
    """The scene file of a path, or of a ready scene's name; UserError lists the names."""
    path = Path(name)
    if path.is_file():
        return path
    ready = ready_scenes()
    if str(name) in ready:
        return ready[str(name)]
    raise UserError(
        f"{name}: there is no such file. Check the path, or choose a ready scene: "
        f"{', '.join(ready)}."
    )
