"""The guide's walks: every place that they name is in the code."""

import ast
import re
from pathlib import Path

import pytest

HOUSE = Path(__file__).parents[2]
WALKS = (HOUSE / "labapp/docs/walks.md").read_text()
STEPS = re.findall(r"^\| `([\w/]+\.py)` `([\w.]+)` \|", WALKS, re.MULTILINE)


def names_in(body: list[ast.stmt], before: str = "") -> set[str]:
    """What a module or a class defines, members after a dot."""
    found = set()
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(before + node.name)
        if isinstance(node, ast.ClassDef):
            found |= names_in(node.body, f"{node.name}.")
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        found |= {before + one.id for one in targets if isinstance(one, ast.Name)}
    return found


@pytest.mark.parametrize(("path", "name"), STEPS)
def test_a_walk_passes_places_that_there_are(path, name):
    assert name in names_in(ast.parse((HOUSE / path).read_text()).body)


def test_there_are_seven():
    rows = [line for line in WALKS.splitlines() if line.startswith("| `")]
    assert len(rows) == len(STEPS)
    assert len(re.findall(r"^## \d\. ", WALKS, re.MULTILINE)) == 7
