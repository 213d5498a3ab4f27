"""Targets with the artificial star and without light, for calibration and refinement."""

from __future__ import annotations

from labapp.bench.opening import Bench
from labapp.common.errors import UserError
from labapp.files.scene_file import StarTable


def require_star_target(bench: Bench, star: str, dark: str) -> StarTable | None:
    """Return the artificial star's table in the scene, or None if the scene has none.

    Raises UserError if the bench lacks the target `star` or the target `dark`. An empty `dark`
    means that no dark frames are taken.
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
