"""`make test` fails if tests or types do, and ends what it has begun, and nothing else."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def stub(path: Path, script: str) -> None:
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


@pytest.mark.parametrize(
    ("tests", "types", "ended"), [(0, 0, 0), (1, 0, 2), (0, 1, 2), (1, 1, 2), (5, 0, 2)]
)
def test_make_ends_well_only_where_tests_and_types_do(tmp_path, tests, types, ended):
    """In a session of its own: whoever kills the whole group kills make, too."""
    stub(tmp_path / "python", f"exit {tests}")
    stub(tmp_path / "mypy", f"echo what mypy says; exit {types}")
    done_before = ("system", "style", f"{tmp_path}/dev")
    known = [word for name in done_before for word in ("-o", name)]
    command = ["make", "test", f"BIN={tmp_path}", f"VENV={tmp_path}", *known]
    made = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, start_new_session=True, timeout=60
    )
    assert made.returncode == ended, made.stderr
    assert "what mypy says" in made.stdout
