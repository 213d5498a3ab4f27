"""Check the indices of Zernike polynomials; importing this module loads nothing else."""

from __future__ import annotations

# Degree of a Zernike polynomial, whose recurrence takes as many steps: its finest ripple is that
# of a panel of 1000 pixels. Chosen.
_HIGHEST = 1000


def require_zernike_indices(n: int, m: int) -> None:
    """Raise ValueError for a degree n and a cycle count m of no Zernike polynomial."""
    if n < 0 or abs(m) > n or (n - m) % 2:
        raise ValueError(f"Zernike ({n}, {m}) doesn't exist; m goes from -n to n in steps of two")
    if n > _HIGHEST:
        raise ValueError(f"Zernike ({n}, {m}) is beyond degree {_HIGHEST}; give a lower one")
