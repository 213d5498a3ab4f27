"""Pictures of toy bricks, which the thesis refocuses on (Fig. 3.6)."""

from __future__ import annotations

from optics.validation import require_positive
from simulator.scene.polygons import Polygons, rectangle


def brick(
    size: tuple[float, float], studs: int = 4, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[Polygons, Polygons]:
    """Draw the front of a scene's toy brick with studs, and return its picture and its cover.

    The cover is 1 where the brick hides what lies behind it. size: (height, width) of the brick's
    body, metres, whose middle is at `offset`. Raises ValueError for fewer than one stud.
    """
    require_positive("height", size[0], "m")
    require_positive("width", size[1], "m")
    if studs < 1:
        raise ValueError(f"studs is {studs}; a brick has 1 or more")
    # A stud is 1.8 mm high on a body of 9.6 mm, and 4.8 mm wide in a cell of 8 mm.
    stud_height, stud_width = 0.19, 0.6
    # The foot is a darker strip; its height is a share of the body's height.
    foot_share, foot_tone, stud_tone = 0.08, 0.85, 0.75
    (height, width), (y, x) = size, offset
    body = rectangle(offset, size)
    foot = rectangle((y + height * (1 - foot_share) / 2, x), (height * foot_share, width))
    cell = width / studs
    tops = tuple(
        rectangle(
            (y - height * (1 + stud_height) / 2, x + (k - (studs - 1) / 2) * cell),
            (height * stud_height, cell * stud_width),
        )
        for k in range(studs)
    )
    tones = (1.0, foot_tone - 1, *[stud_tone] * studs)
    return Polygons((body, foot, *tops), tones), Polygons((body, *tops), (1.0,) * (1 + studs))
