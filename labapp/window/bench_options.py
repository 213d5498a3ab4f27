"""What the window's engine opens a bench with."""

from __future__ import annotations

from pathlib import Path
from typing import TypedDict


class BenchOptions(TypedDict, total=False):
    """Files of the bench that the window opens, and the memory for its simulated pictures.

    `bench`, `scene`, `image` and `faults` are files; `memory` is in bytes. Each may be None, for
    what is usual.
    """

    bench: Path | None
    scene: Path | None
    image: Path | None
    faults: Path | None
    memory: int | None
