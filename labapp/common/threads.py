"""The number of threads of the numerical libraries."""

from __future__ import annotations

import os


def use_one_thread() -> None:
    """Limit OpenMP and BLAS to one thread.

    Call this before these libraries are loaded, because they read the limit then.
    """
    for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
