"""Text as a target."""

from __future__ import annotations

import numpy as np

from optics.edge import require_positive
from optics.targets.drawing import Drawing, Target, micrometres
from optics.targets.font import HEIGHT, strokes_of
from optics.targets.stroke import drawn


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
    return drawn(
        [stroke - middle for stroke in strokes],
        width,
        f"text of {micrometres(long)} with height {micrometres(height)} and width "
        f"{micrometres(width)}",
        "choose a smaller height",
    )
