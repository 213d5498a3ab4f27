"""Print the simulator's effect plans, which a record holds, as tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from labapp.common.console import out, print_table


def show_effects(effect_plan: dict[str, Any]) -> None:
    """Print each simulated effect's levels and largest error."""
    if "plans" in effect_plan:
        _show_plans(effect_plan["plans"])
    else:
        _print_legacy_plans(effect_plan)


def _show_plans(plans: Sequence[dict[str, Any]]) -> None:
    count, tolerances = len(plans), sorted({plan["tol"] for plan in plans})
    pictures = f"{count} different pictures" if count > 1 else "its picture"
    names = dict.fromkeys(one["effect"] for plan in plans for one in plan["decisions"])
    tolerance = " and ".join(f"{tol:g}" for tol in tolerances)
    # Records from before there were estimates don't say what decided.
    estimated = any(plan.get("decided_by") == "estimate" for plan in plans)
    print_table(
        f"What the simulator did for {pictures}, tolerance {tolerance}",
        ["effect", "level", "likely " if estimated else "at most ", "why"],
        [_row(name, plans) for name in names],
    )
    worst = max(plans, key=lambda plan: _size(plan["error"]))
    out.print(
        f"All are within {format_share(worst['error'])} of everything on"
        f"{', as estimated' if estimated else ''}; the farthest is "
        f"{worst['target']}, {worst['pattern']}, {worst['wavelength_nm']:g} nm, "
        f"{worst['exposure_ms']:g} ms."
    )
    out.print()


def _row(name: str, plans: Sequence[dict[str, Any]]) -> list[str]:
    """Return an effect's row: levels, largest error bound, and reason."""
    found = [one for plan in plans for one in plan["decisions"] if one["effect"] == name]
    levels = list(dict.fromkeys(one["level"] for one in found))
    level = " or ".join(levels)
    if any(one["forced"] for one in found):
        level += ", forced"
    # Among equal bounds, take the plan with the largest estimated change of the picture.
    most = max(found, key=lambda one: (_size(one["relative"]), one["estimate"]))
    return [name, level, format_share(most["relative"]), most["why"]]


def format_share(value: float | None) -> str:
    """Format a picture's relative error; None means that it has no bound."""
    return "∞" if value is None else f"{value:.1e}" if value else "0"


def _size(value: float | None) -> float:
    return math.inf if value is None else value


def _print_legacy_plans(plans: dict[str, Any]) -> None:
    """Print the plans of an old record, which has only an estimate of each effect."""
    for name, plan in plans.items():
        rows = [
            [
                one["effect"],
                "on" if one["on"] else "off",
                f"{one['estimate']:.2g}",
                one["measure"],
                one["why"],
            ]
            for one in plan["decisions"]
        ]
        heading = f"What the simulator did for {name}, tolerance {plan['tol']:g}"
        print_table(heading, ["effect", "", "estimate ", "of", "why"], rows)
