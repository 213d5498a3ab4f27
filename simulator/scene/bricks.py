"""Toy bricks: what the thesis refocuses on (Fig. 3.6)."""

from __future__ import annotations

from optics.validation import require_positive
from simulator.scene.polygons import Polygons, rectangle

_STUD_HEIGHT, _STUD_WIDTH = 0.19, 0.6
"""Of a stud over the brick's height, and over its share of the brick's width: 1.8 of 9.6 mm and
4.8 of 8 mm."""

_STUD_TONE, _FOOT_TONE, _FOOT = 0.75, 0.85, 0.08
"""How much darker studs and the foot are, and the foot's height over the brick's."""


def brick(
    size: tuple[float, float], studs: int = 4, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[Polygons, Polygons]:
    """The front of a brick with studs on it: its picture, and what it hides.

    size: (height, width) of its body, metres, whose middle is at `offset`. Raises ValueError
    for fewer than one stud.
    """
    require_positive("height", size[0], "m")
    require_positive("width", size[1], "m")
    if studs < 1:
        raise ValueError(f"studs is {studs}; a brick has 1 or more")
    (height, width), (y, x) = size, offset
    body = rectangle(offset, size)
    foot = rectangle((y + height * (1 - _FOOT) / 2, x), (height * _FOOT, width))
    room = width / studs
    tops = tuple(
        rectangle(
            (y - height * (1 + _STUD_HEIGHT) / 2, x + (k - (studs - 1) / 2) * room),
            (height * _STUD_HEIGHT, room * _STUD_WIDTH),
        )
        for k in range(studs)
    )
    tones = (1.0, _FOOT_TONE - 1, *[_STUD_TONE] * studs)
    return Polygons((body, foot, *tops), tones), Polygons((body, *tops), (1.0,) * (1 + studs))
