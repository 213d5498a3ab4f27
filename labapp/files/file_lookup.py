"""Files that come with the application, by name; and a user's own, by their paths."""

from __future__ import annotations

from pathlib import Path

from labapp.common.errors import UserError
from labapp.files.reading import bundled_path


def bundled_plans() -> dict[str, Path]:
    """The plans that come with the application, by name."""
    return _bundled_files("plans")


def bundled_scenes() -> dict[str, Path]:
    """The scenes that come with the application, by name."""
    return _bundled_files("scenes")


def find_plan(name: Path | str) -> Path:
    """The plan file of a path, or of a ready plan's name; UserError lists the names."""
    return _find_file(name, "plan", bundled_plans())


def find_scene(name: Path | str) -> Path:
    """The scene file of a path, or of a ready scene's name; UserError lists the names."""
    return _find_file(name, "scene", bundled_scenes())


def find_part_file(kind: str, file: str, folder: Path) -> Path:
    """The file of a bench's part, which is a "panel" or a "sensor": of one that is bundled by its
    name, or else looked for in `folder`. UserError lists the names."""
    ready = _bundled_files(f"{kind}s")
    path = ready.get(file, folder / file)
    if not path.exists():
        raise UserError(
            f"{path}: there is no such {kind}. Give its file, or one of those that come with "
            f"labapp: {', '.join(ready)}."
        )
    return path


def bundled_parts(kind: str) -> list[str]:
    """The names of the panels or sensors that come with the application."""
    return list(_bundled_files(f"{kind}s"))


def require_file(path: Path) -> None:
    """UserError where there is no file of that name."""
    if not path.is_file():
        raise UserError(f"{path}: there is no such file. Check the path.")


def require_readable(path: Path) -> None:
    """UserError for a file that can't be opened."""
    if not path.exists():
        raise UserError(f"{path}: cannot be read: there is no such file. Check the path.")
    try:
        path.open("rb").close()
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}. Check the path.") from error


def _bundled_files(folder: str) -> dict[str, Path]:
    return {path.stem: path for path in sorted(bundled_path(folder).glob("*.toml"))}


def _find_file(name: Path | str, kind: str, paths_by_name: dict[str, Path]) -> Path:
    path = Path(name)
    # A folder of that name is the place of somebody's records, and no plan.
    if path.is_file():
        return path
    if str(name) in paths_by_name:
        return paths_by_name[str(name)]
    raise UserError(
        f"{name}: there is no such file. Check the path, or choose a ready {kind}: "
        f"{', '.join(paths_by_name)}."
    )
