"""Limit the number of threads of the numerical libraries."""

from __future__ import annotations

import os


def use_one_thread() -> None:
    """Limit OpenMP and BLAS to one thread, a helper common to all of labapp.

    Call this before the libraries are loaded and read it.
    """
    for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
