"""Which line of code is under way, for errors that no traceback leads to."""

from __future__ import annotations

import traceback
from pathlib import Path


def innermost_call(*left_out: str) -> str:
    """The innermost line and its place, of files whose names aren't left out."""
    left_out = (Path(__file__).name, *left_out)
    calls = reversed(traceback.extract_stack())
    call = next(call for call in calls if Path(call.filename).name not in left_out)
    return f"{call.line} ({Path(call.filename).name}:{call.lineno})"
