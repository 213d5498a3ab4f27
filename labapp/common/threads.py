"""Limit the number of threads of the numerical libraries."""

from __future__ import annotations

import os


def use_one_thread() -> None:
    """Limit the process to one OpenMP and BLAS thread, as all of labapp does in common.

    Call this before the libraries are loaded and read it.
    """
    for library in ("OMP", "OPENBLAS", "MKL", "NUMEXPR"):
        os.environ[f"{library}_NUM_THREADS"] = "1"
