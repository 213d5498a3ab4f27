"""How many threads the libraries that multiply may use."""

from __future__ import annotations

import os


def use_one_thread() -> None:
    """Compute on one: libraries read this once, when they are loaded, so call it before."""
    for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
