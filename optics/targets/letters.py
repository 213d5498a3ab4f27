"""Draw text as a target."""

from __future__ import annotations

import numpy as np

from optics.targets.font import HEIGHT, strokes_of
from optics.targets.stroke import draw_strokes
from optics.targets.target import Drawing, Target, format_micrometres
from optics.validation import require_positive


@Target
def letters(text: str, height: float, width: float) -> Drawing:
    """Draw a line of text, centred on the axis, as a target: letters, digits and blanks.

    Parameters
    ----------
    text : str
        Signs of the font; small letters become capitals.
    height : float
        Height of a capital, metres.
    width : float
        Standard deviation of the Gaussian across a stroke, metres.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.

    Raises
    ------
    ValueError
        If the text has no sign, or one that isn't in the font.
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
