"""Draw letters as strokes, six units high, with y down from the top and x from the left edge."""

from __future__ import annotations

import numpy as np

from optics.targets.stroke import Points

_Pen = tuple[float, ...]
"""A point (x, y), or an arc (x, y, half width, half height, from, to).

The arc's angles are in degrees, from x towards y.
"""

_O: list[_Pen] = [(2.1, 3, 2.1, 3, 0, 360)]
_P: list[_Pen] = [(0, 6), (0, 0), (2.4, 0), (2.4, 1.6, 1.5, 1.6, -90, 90), (0, 3.2)]
_SIX: list[_Pen] = [(3.3, 4.2, 3.3, 4.2, -90, -180), (2, 4.2, 2, 1.8, 180, 540)]

_LETTERS: dict[str, list[list[_Pen]]] = {
    "A": [[(0, 6), (2.2, 0), (4.4, 6)], [(0.75, 4), (3.65, 4)]],
    "B": [
        [(0, 3), (0, 0), (2.3, 0), (2.3, 1.5, 1.5, 1.5, -90, 90), (0, 3)],
        [(0, 3), (0, 6), (2.5, 6), (2.5, 4.5, 1.5, 1.5, 90, -90), (2.3, 3)],
    ],
    "C": [[(2.2, 3, 2.2, 3, -48, -312)]],
    "D": [[(0, 0), (1.5, 0), (1.5, 3, 2.6, 3, -90, 90), (0, 6), (0, 0)]],
    "E": [[(3.6, 0), (0, 0), (0, 6), (3.6, 6)], [(0, 3), (3, 3)]],
    "F": [[(3.6, 0), (0, 0), (0, 6)], [(0, 3), (3, 3)]],
    "G": [[(2.2, 3, 2.2, 3, -48, -360), (2.5, 3)]],
    "H": [[(0, 0), (0, 6)], [(4.2, 0), (4.2, 6)], [(0, 3), (4.2, 3)]],
    "I": [[(0, 0), (0, 6)]],
    "J": [[(2.8, 0), (2.8, 4.4), (1.4, 4.4, 1.4, 1.6, 0, 165)]],
    "K": [[(0, 0), (0, 6)], [(3.8, 0), (0, 3.9)], [(1.4, 2.46), (4, 6)]],
    "L": [[(0, 0), (0, 6), (3.4, 6)]],
    "M": [[(0, 6), (0, 0), (2.5, 4), (5, 0), (5, 6)]],
    "N": [[(0, 6), (0, 0), (4.2, 6), (4.2, 0)]],
    "O": [_O],
    "P": [_P],
    "Q": [_O, [(2.5, 4.2), (4.4, 6.3)]],
    "R": [_P, [(2, 3.2), (4, 6)]],
    "S": [[(2, 1.55, 1.8, 1.55, -25, -270), (2, 4.55, 2, 1.45, -90, 155)]],
    "T": [[(0, 0), (4.2, 0)], [(2.1, 0), (2.1, 6)]],
    "U": [[(0, 0), (0, 3.9), (2.1, 3.9, 2.1, 2.1, 180, 0), (4.2, 0)]],
    "V": [[(0, 0), (2.1, 6), (4.2, 0)]],
    "W": [[(0, 0), (1.5, 6), (3, 1), (4.5, 6), (6, 0)]],
    "X": [[(0, 0), (4, 6)], [(4, 0), (0, 6)]],
    "Y": [[(0, 0), (2.1, 3.1), (4.2, 0)], [(2.1, 3.1), (2.1, 6)]],
    "Z": [[(0, 0), (4, 0), (0, 6), (4, 6)]],
    "0": [[(1.8, 3, 1.8, 3, 0, 360)]],
    "1": [[(0, 1.4), (1.5, 0), (1.5, 6)]],
    "2": [[(1.9, 1.8, 1.8, 1.8, -165, 38), (0, 6), (3.9, 6)]],
    "3": [[(1.8, 1.55, 1.7, 1.55, -155, 90), (1.8, 4.55, 1.9, 1.45, -90, 155)]],
    "4": [[(3, 6), (3, 0), (0, 4.2), (4.1, 4.2)]],
    "5": [[(3.5, 0), (0.5, 0), (0.24, 2.78), (1.8, 4.1, 2, 1.9, -140, 155)]],
    "6": [_SIX],
    "7": [[(0, 0), (3.9, 0), (1.4, 6)]],
    "8": [[(2, 1.5, 1.6, 1.5, 0, 360)], [(2, 4.5, 2, 1.5, 0, 360)]],
    "+": [[(0, 3), (3, 3)], [(1.5, 1.5), (1.5, 4.5)]],
    "-": [[(0, 3), (2.6, 3)]],
    ".": [[(0, 6)]],
    "!": [[(0, 0), (0, 4.2)], [(0, 6)]],
    "?": [[(1.7, 1.7, 1.7, 1.7, -170, 60), (1.7, 4.3)], [(1.7, 6)]],
    "/": [[(0, 6), (2.8, 0)]],
}

HEIGHT = 6.0
"""Height of a capital letter in the font's units."""

AVAILABLE_SIGNS = "".join([*_LETTERS, "9"])
"""The signs of the font, without the blank."""


def strokes_of(text: str) -> list[Points]:
    """Return the strokes of the letters of a text target, in the font's units.

    The origin is the upper left corner of the line of text. Small letters become capitals. Raises
    ValueError for text without a letter, digit or other sign, or with one that isn't in the font.
    """
    strokes, left = list[Points](), 0.0
    for sign in text.upper():
        if sign == " ":
            left += 2.4  # A blank is 2.4 units wide.
            continue
        made = _sign(sign)
        strokes += [stroke + np.array([0.0, left]) for stroke in made]
        # The gap between letters is 1.6 units wide.
        left += max(float(stroke[:, 1].max()) for stroke in made) + 1.6
    if not strokes:
        raise ValueError(f"text is {text!r}; give one sign at least")
    return strokes


def _sign(sign: str) -> list[Points]:
    """Return the strokes of one letter or other sign of a text target."""
    if sign == "9":
        return [[HEIGHT, 4.0] - stroke for stroke in _sign("6")]
    if sign not in _LETTERS:
        raise ValueError(f"text has {sign!r}; there are {AVAILABLE_SIGNS} and blanks")
    return [_stroke_points(pens) for pens in _LETTERS[sign]]


def _stroke_points(pens: list[_Pen]) -> Points:
    """Return the (y, x) of the points along one stroke of a text target's letter, (n, 2)."""
    parts = [_arc(*pen) if len(pen) == 6 else np.array([[pen[1], pen[0]]]) for pen in pens]
    path = np.concatenate(parts)
    if np.allclose(path[0], path[-1]):
        path[-1] = path[0]
    return path


def _arc(x: float, y: float, width: float, height: float, first: float, last: float) -> Points:
    step = 6.0  # The points are 6 degrees apart.
    angle = np.deg2rad(np.linspace(first, last, 2 + round(abs(last - first) / step)))
    return np.stack([y + height * np.sin(angle), x + width * np.cos(angle)], 1)
