"""The command `labapp explain`: which effects a simulated picture needs, and why."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import torch
from rich.text import Text

from labapp.common.console import out, print_json, print_table, styled_line, terminal_progress
from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from labapp.prediction.simulating.all_effects import deviation_in_the_middle
from labapp.prediction.simulating.picture_request import PictureRequest, prepare_scene
from labapp.prediction.simulating.picture_time import seconds_per_operation
from simulator.effects.electron_bounds import without_clipping
from simulator.effects.registry import EFFECTS
from simulator.planning import EffectPlan
from simulator.planning.auditing import AuditResult, audit
from simulator.recipe import Recipe
from simulator.situation import Situation
from simulator.world import World


def explain_effects(
    request: PictureRequest,
    *,
    with_audit: bool,
    pairs: int,
    as_json: bool,
    with_check: bool = False,
) -> bool:
    """Print a picture's effect plan, with an audit and a check if asked; return whether it holds.

    pairs: how many pairs of effects the audit puts back, besides each one that was left out.
    with_check: whether the picture's middle is compared with everything on.
    Raises UserError if `pairs` is negative.
    """
    if pairs < 0:
        raise UserError(f"--pairs {pairs}: give 0 or more.")
    with terminal_progress() as progress, prepare_scene(request, progress.part(0.0, 0.5)) as staged:
        world, situation = staged.world, staged.situation
        progress.report(0.5, "deciding")
        plan = world.imaging.plan(situation)
        progress.report(0.6, "putting back what was left out" if with_audit else "deciding")
        found = _audit_effects(world, situation, plan, pairs) if with_audit else ()
        if with_check:
            progress.report(0.8, "rendering the middle with everything on")
            check = progress.raise_if_cancelled
            middle = deviation_in_the_middle(situation, plan, check=check)
        each = seconds_per_operation(machine_speed())
        data = {
            **describe_plan(situation, plan),
            # Processor time of planning, as spent, and of pictures, as predicted.
            "planning_cpu_s": plan.planning_cpu,
            "picture_cpu_s": plan.work * each,
            "finest_picture_cpu_s": plan.most_work * each,
            "audit": [_as_data(one) for one in found],
            "middle": asdict(middle) if with_check else None,
        }
    if as_json:
        print_json(data)
    else:
        _print_plan(data)
        if with_audit:
            _print_audit(found)
        if with_check:
            out.print(
                f"The picture's middle is {_share(middle.worst)} from everything on, in its mean "
                "or its noise, as rendered."
            )
    is_within = not with_check or middle.worst <= max(plan.tol, plan.relative_error)
    return is_within and not any(one.is_broken for one in found)


def describe_plan(s: Situation, plan: EffectPlan) -> dict[str, Any]:
    """Return an effect plan and its situation as plain data.

    "without" has the relative error of the picture without each effect, estimated.
    """
    taken = {one.effect for one in plan.decisions}
    return {
        "target": s.target.name,
        "wavelength_nm": s.wavelength * 1e9,
        "exposure_ms": s.exposure * 1e3,
        **plan.as_data(),
        "without": {one.name: one.estimated_error(s, 0) for one in EFFECTS if one.name in taken},
    }


def _print_plan(data: dict[str, Any]) -> None:
    """Print an effect plan as a table, and its error and work as text."""
    rows = [
        [
            one["effect"],
            _level(one),
            _share(one["relative"]),
            _share(data["without"][one["effect"]]),
            _cost(one, data["work"]),
            one["why"],
        ]
        for one in data["decisions"]
    ]
    heading = (
        f"{data['target'] or 'The picture'} at {data['wavelength_nm']:g} nm, "
        f"{data['exposure_ms']:.3g} ms, tolerance {data['tol']:g}"
    )
    print_table(heading, ["effect", "level", "left ", "if off ", "work ", "why"], rows)
    share = data["work"] / data["most_work"] if data["most_work"] else 1.0
    known = {"bound": "at most", "estimate": "as estimated"}[data["decided_by"]]
    out.print(
        f"left: relative error of picture or noise that a level leaves, {known}. if off: what the "
        "effect is worth, about. work: its part of the picture's, and what its finest level would "
        "add.",
        style="dim",
    )
    out.print(
        f"The picture is within {_share(data['error'])} of everything on, {known}, for {share:.1%} "
        "of its work."
    )
    out.print(
        f"Deciding took {data['planning_cpu_s']:.2g} s of processor time; the picture takes "
        f"about {data['picture_cpu_s']:.2g} s, and everything on "
        f"{data['finest_picture_cpu_s']:.2g} s."
    )


def _cost(one: dict[str, Any], whole: float) -> str:
    """Format an effect's work relative to the whole picture's: 12%, +340%."""
    more = one["finest_work"] - one["work"]
    parts = [(one["work"], ""), (more if more > 1e-3 * whole else 0.0, "+")]
    return " ".join(sign + _percent(work / whole) for work, sign in parts if work and whole) or "0"


def _percent(share: float) -> str:
    return f"{100 * share:.0f}%" if share >= 0.1 else f"{100 * share:.2g}%"


def _level(one: dict[str, Any]) -> Text:
    level = one["level"]
    if one["kind"] == "axis" and one["on"] and len(one["levels"]) > 1:
        level = f"{level} of {one['levels'][-1]}"
    colour = "yellow" if one["forced"] else "green" if one["on"] else "dim"
    return styled_line((f"{level}{', forced' if one['forced'] else ''}", colour))


def _share(value: float | None) -> str:
    if value is None or math.isinf(value):
        return "∞"
    return f"{value:.1e}" if value else "0"


def _audit_effects(
    world: World, s: Situation, plan: EffectPlan, pairs: int
) -> tuple[AuditResult, ...]:
    """Put back each effect that was left out, then pairs of them, the largest first."""

    def render(recipe: Recipe) -> tuple[torch.Tensor, torch.Tensor]:
        picture = world.imaging.picture_moments(s, without_clipping(s, recipe))
        return picture.mean, picture.variance

    left_out = [one for one in plan.decisions if one.level != one.levels[-1]]
    largest = sorted(left_out, key=lambda one: -one.relative)
    every = itertools.combinations([one.effect for one in largest], 2)
    return audit(EFFECTS, s, plan, render, pairs=itertools.islice(every, pairs))


def _as_data(one: AuditResult) -> dict[str, Any]:
    share = one.measured_over_bound if math.isfinite(one.measured_over_bound) else None
    names = ("effects", "others", "mean", "variance", "sigma")
    return {**{name: getattr(one, name) for name in names}, "share": share, "broken": one.is_broken}


def _print_audit(found: Sequence[AuditResult]) -> None:
    rows = [
        [
            " + ".join(one.effects),
            one.others,
            f"{one.measured_over_bound:.1%}",
            styled_line(("broken", "red")) if one.is_broken else "held",
        ]
        for one in found
    ]
    print_table("What was left out, put back", ["effects", "others", "of the bound ", ""], rows)
