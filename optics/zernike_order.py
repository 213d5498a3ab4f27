"""Check the indices of Zernike polynomials; importing this module loads nothing else."""

from __future__ import annotations


def require_zernike_indices(n: int, m: int) -> None:
    """Raise ValueError for a degree n and a cycle count m of no Zernike polynomial."""
    if n < 0 or abs(m) > n or (n - m) % 2:
        raise ValueError(f"Zernike ({n}, {m}) doesn't exist; m goes from -n to n in steps of two")
