"""Look up bundled plans, scenes, panels and sensors by name, and a user's own files by path."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from labapp.common.errors import UserError
from labapp.files.guarded_reading import is_file, require_regular
from labapp.files.reading import bundled_path


def bundled_plans() -> dict[str, Path]:
    """Return the paths of the plans that come with the application, by name."""
    return _bundled_files("plans")


def bundled_scenes() -> dict[str, Path]:
    """Return the paths of the scenes that come with the application, by name."""
    return _bundled_files("scenes")


def find_plan(name: Path | str) -> Path:
    """Return the path of a plan, given its path or a bundled name; UserError lists these."""
    return _find_file(name, "plan", bundled_plans())


def find_scene(name: Path | str) -> Path:
    """Return the path of a scene, given its path or a bundled name; UserError lists these."""
    return _find_file(name, "scene", bundled_scenes())


def find_part_file(kind: str, file: str, folder: Path) -> Path:
    """Return the path of a "panel" or "sensor", given a bundled name or a path in `folder`.

    Raises UserError, which lists the bundled names.
    """
    ready = _bundled_files(f"{kind}s")
    path = ready.get(file, folder / file)
    if not is_file(path):
        raise UserError(
            f"{path}: there is no such {kind}. Give its file, or one of those that come with "
            f"labapp: {', '.join(ready)}."
        )
    return path


def split_part(data: dict[str, Any], kind: str, source: str) -> tuple[str, dict[str, Any]] | None:
    """Return the file that a bench's plain data names for a part, and the keys beside it, if any.

    kind: "panel" or "sensor".
    source: name of the bench file in the UserError for a name that is no text.
    """
    part = data.get(kind)
    if not isinstance(part, dict) or "file" not in part:
        return None
    file, own = part["file"], {key: value for key, value in part.items() if key != "file"}
    if not isinstance(file, str):
        raise UserError(f"{source}: key '{kind}.file' is {file!r}: it should be a string.")
    return file, own


def require_file(path: Path) -> None:
    """Raise UserError if there is no regular file at a path."""
    if not is_file(path):
        # This tells what the path leads to instead.
        require_regular(path)


def _bundled_files(folder: str) -> dict[str, Path]:
    return {path.stem: path for path in sorted(bundled_path(folder).glob("*.toml"))}


def _find_file(name: Path | str, kind: str, paths_by_name: dict[str, Path]) -> Path:
    path = Path(name)
    # A folder may have the name of a bundled plan, for instance if it holds the plan's records.
    if is_file(path):
        return path
    if str(name) in paths_by_name:
        return paths_by_name[str(name)]
    raise UserError(
        f"{name}: there is no such file. Check the path, or choose a ready {kind}: "
        f"{', '.join(paths_by_name)}."
    )
