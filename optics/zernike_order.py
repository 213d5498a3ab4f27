"""Which Zernike polynomials there are; importing it loads nothing."""

from __future__ import annotations


def require_zernike_indices(n: int, m: int) -> None:
    """Raise ValueError for a degree and a cycle count that don't go together."""
    if n < 0 or abs(m) > n or (n - m) % 2:
        raise ValueError(f"Zernike ({n}, {m}) doesn't exist; m goes from -n to n in steps of two")
