"""The guide's page for those who change labapp: what its commands name is there."""

from __future__ import annotations

import ast
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from test_readme import ROOT, code_blocks

TEXT = (ROOT / "labapp/docs/work-on-labapp.md").read_text()
LINES = [line for block in code_blocks(TEXT, "console") for line in block.splitlines()]


def lines_with(word: str) -> list[str]:
    """Lines with a command, of which there is at least one."""
    found = [line for line in LINES if re.search(rf"(^|\s){word}\s", line)]
    assert found
    return found


@pytest.mark.parametrize("line", lines_with("pytest"))
def test_its_tests_are_there(line):
    words = shlex.split(line.partition("pytest ")[2].partition(";")[0])
    paths = [word for word in words if word.startswith("tests")]
    assert paths
    sources = "".join(file.read_text() for path in paths for file in files_of(ROOT / path))
    assert "def test_" in sources
    if "-k" in words:
        assert re.search(rf"def test_\w*{words[words.index('-k') + 1]}", sources)
    if "-m" in words:
        assert f"pytest.mark.{words[words.index('-m') + 1]}" in sources


def files_of(path: Path) -> list[Path]:
    return sorted(path.rglob("test_*.py")) if path.is_dir() else [path]


@pytest.mark.parametrize("line", lines_with("make"))
def test_its_targets_are_there(line):
    target = shlex.split(line)[1]
    assert re.search(
        rf"^[\w -]*\b{target}\b[\w -]*:", (ROOT / "Makefile").read_text(), re.MULTILINE
    )


def test_the_files_that_it_names_are_there():
    named = set(re.findall(r"`((?:labapp|optics|drivers|simulator|tests)/[\w/.-]+)[:`]", TEXT))
    assert len(named) >= 5
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_its_breakpoint_is_a_line_of_python():
    found = [line for block in code_blocks(TEXT, "text") for line in block.splitlines()]
    (line,) = (one for one in found if "pdb" in one)
    assert ast.parse(line).body


@pytest.mark.sweep
def test_a_profile_is_made_and_read(tmp_path):
    for line in lines_with("python"):
        words = shlex.split(line)
        if "pdb" not in words:
            command = [sys.executable, *words[1:]]
            asked = "stats 5\nquit\n"
            done = subprocess.run(
                command, cwd=tmp_path, input=asked, capture_output=True, text=True, check=True
            )
    assert "function calls" in done.stdout
