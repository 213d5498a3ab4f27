"""The command `labapp plan list`: list the plans that come with the application."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from labapp.common.list_output import ListEntry, print_list
from labapp.files.file_lookup import bundled_plans
from labapp.files.plan_file import PlanFile
from labapp.files.reading import read_file


def list_plans(*, as_json: bool) -> None:
    """Print the bundled plans, and what each needs of a bench."""
    listed = []
    for name, path in bundled_plans().items():
        facts = _describe(path)
        what = f"{facts['title']}. {facts['comment']}"
        needs = f"needs {_describe_requirements(facts)}"
        listed.append(ListEntry(name, what, lines=[needs], facts=facts))
    example = "labapp run coded-snapshot --out run.h5\nWhat one takes: labapp plan check NAME"
    print_list(listed, as_json=as_json, example=example)


def _describe(path: Path) -> dict[str, Any]:
    """Describe a plan as plain data, with the comment in its file's first line."""
    plan = read_file(path, PlanFile)
    targets: list[str] = []
    for block in plan.acquire:
        between = (one.target or one.role for one in block.interleave if one.role != "neutral")
        targets += [*block.targets, *between]
    known = [plan.targets[target] for target in dict.fromkeys(targets) if target in plan.targets]
    places = {target: plan.targets[target].place for target in plan.targets}
    return {
        "path": str(path),
        "title": plan.title,
        "comment": path.read_text(encoding="utf-8").splitlines()[0].removeprefix("# "),
        "targets": list(dict.fromkeys(places.get(target) or target for target in targets)),
        "wavelengths_nm": sorted({nm for b in plan.acquire for nm in b.wavelengths_nm or ()}),
        "exposures_ms": sorted({ms for b in plan.acquire for ms in b.exposures_ms or ()}),
        "periods": sorted({n for block in plan.acquire for n in block.periods or ()}),
        "prompts": sum(bool(one.prompt) for one in known),
    }


def _describe_requirements(facts: dict[str, Any]) -> str:
    """Say in words what a bench must have for a plan."""
    nm, ms = facts["wavelengths_nm"], facts["exposures_ms"]
    needs = [abbreviate_list(facts["targets"]), f"{format_range(nm)} nm"]
    needs += [f"{format_range(ms)} ms"] if ms else []
    needs += ["a panel that plays videos"] if facts["periods"] else []
    needs += ["a person"] if facts["prompts"] else []
    return "; ".join(needs)


def format_range(values: Sequence[float]) -> str:
    """Format sorted values as "smallest to largest"."""
    return f"{values[0]:g}" if len(values) == 1 else f"{values[0]:g} to {values[-1]:g}"


def abbreviate_list(words: Iterable[str]) -> str:
    """Join words with commas; of more than 6, name the first two and the last, and count all."""
    listed = list(words)
    if len(listed) <= 6:
        return ", ".join(listed)
    return f"{listed[0]}, {listed[1]} ... {listed[-1]} ({len(listed)})"
