"""Finding a plan: a file, or a ready plan by its name."""

from __future__ import annotations

from pathlib import Path

from labapp.errors import UserError
from labapp.files.reading import bundled


def ready_plans() -> dict[str, Path]:
    """The plans that come with the application, by name."""
    return {path.stem: path for path in sorted(bundled("plans").glob("*.toml"))}


def find_plan(name: Path | str) -> Path:
    """The plan file of a path, or of a ready plan's name; UserError lists the names."""
    path = Path(name)
    # A folder of that name is the place of somebody's records, and no plan.
    if path.is_file():
        return path
    ready = ready_plans()
    if str(name) in ready:
        return ready[str(name)]
    raise UserError(
        f"{name}: there is no such file. Check the path, or choose a ready plan: "
        f"{', '.join(ready)}."
    )
