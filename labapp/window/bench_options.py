"""What the engine opens a bench with."""

from __future__ import annotations

from pathlib import Path
from typing import TypedDict


class BenchOptions(TypedDict, total=False):
    """Files of the bench to open, and the memory for its simulated pictures.

    Each may be None, for what is usual.
    bench, scene, image, faults: files.
    memory: bytes.
    """

    bench: Path | None
    scene: Path | None
    image: Path | None
    faults: Path | None
    memory: int | None
