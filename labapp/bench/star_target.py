"""The star that a calibration or a refinement looks at, and the dark target beside it."""

from __future__ import annotations

from labapp.bench.opening import Bench
from labapp.common.errors import UserError
from labapp.files.scene_file import StarTable


def require_star_target(bench: Bench, star: str, dark: str) -> StarTable | None:
    """What the scene knows of the star, if anything; UserError if the bench lacks a target.

    dark: empty where nobody asks for dark frames.
    """
    names = bench.targets.names
    for option, name in (("star", star), ("dark", dark)):
        if name not in names and (name or option == "star"):
            without = ", or give --dark '' to go without dark frames" if option == "dark" else ""
            raise UserError(
                f"--{option} {name}: this bench has no such target. Choose among "
                f"{', '.join(names)}{without}."
            )
    table = bench.scene_file.targets.get(star) if bench.scene_file else None
    return table if isinstance(table, StarTable) else None
