"""Walks through a window, which the tests' scripts take in a process of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from figures.where import PACKAGES, ROOT


def walk(script: str, folder: Path, limit: float) -> dict[str, Any] | str:
    """What a script of the window's tests found, or the last words of one that failed.

    folder: where it writes. limit: seconds after which it is given up.
    """
    folder.mkdir(exist_ok=True)
    done = subprocess.run(
        [sys.executable, str(ROOT / "tests" / "window" / script), str(folder)],
        capture_output=True,
        text=True,
        timeout=limit,
        env=os.environ | {"PYTHONPATH": PACKAGES},
    )
    if done.returncode:
        return "".join(done.stderr.strip().splitlines()[-1:])
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found
