"""Text as a target."""

from __future__ import annotations

import numpy as np

from optics.targets.font import HEIGHT, strokes_of
from optics.targets.stroke import draw_strokes
from optics.targets.target import Drawing, Target, format_micrometres
from optics.validation import require_positive


@Target
def letters(text: str, height: float, width: float) -> Drawing:
    """A line of text around the axis: letters, digits and blanks.

    height: of capitals, metres. width: of a stroke's Gaussian. Raises ValueError for text
    without a sign, or with one that isn't in the font.
    """
    require_positive("height", height, "m")
    strokes = [stroke * (height / HEIGHT) for stroke in strokes_of(text)]
    points = np.concatenate(strokes)
    middle = (points.min(0) + points.max(0)) / 2
    long = float(np.ptp(points[:, 1]))
    return draw_strokes(
        [stroke - middle for stroke in strokes],
        width,
        f"text of {format_micrometres(long)} with height {format_micrometres(height)} and width "
        f"{format_micrometres(width)}",
        "choose a smaller height",
    )
