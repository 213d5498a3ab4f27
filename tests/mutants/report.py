"""What became of the mutants, for people and for programs."""

from __future__ import annotations

import json
from pathlib import Path

from mutants.running import Verdict

WIDTH = 60
"""Characters of a change that are shown."""


def line(one: Verdict) -> str:
    changed = f"{_short(one.mutant.before)} → {_short(one.mutant.after)}"
    if one.killed_by:
        fate, why = "killed", one.killed_by.rpartition("/")[2]
    else:
        fate, why = "SURVIVED", f"{one.tests} files of tests" if one.tests else "no test"
    return f"{one.mutant.line:>5}  {one.mutant.kind:<21} {fate:<9} {changed:<{WIDTH}}  {why}"


def _short(text: str) -> str:
    most = WIDTH // 2 - 1
    return text if len(text) <= most else text[: most - 1] + "…"


def summary(found: list[Verdict]) -> str:
    killed = sum(one.killed_by is not None for one in found)
    share = f" ({killed / len(found):.0%})" if found else ""
    return f"{killed} of {len(found)} killed{share}\n"


def as_json(root: Path, found: list[tuple[Path, Verdict]]) -> str:
    rows = [
        {
            "module": str(module.relative_to(root)),
            "line": one.mutant.line,
            "kind": one.mutant.kind,
            "before": one.mutant.before,
            "after": one.mutant.after,
            "killed_by": one.killed_by,
            "files_of_tests": one.tests,
        }
        for module, one in found
    ]
    return json.dumps(rows, indent=1, ensure_ascii=False) + "\n"
