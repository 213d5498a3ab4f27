"""Compute patterns to show on the panel: phases in radians, (rows, columns), float64.

Phases aren't wrapped here, so that a panel can use its whole range; optics.slm wraps them. A
pattern steeper than half a wave per pixel looks the same as its alias, and is refused with an
error that names the limit. y points down the rows and x along the columns, from the panel's
centre; angles go from x towards y. A phase that grows along an axis sends light to that side of
the sensor.
"""

from __future__ import annotations

from optics.patterns import (
    extended_depth,
    focal_sweep,
    gratings,
    lenses,
    multi_focus,
    patches,
    slope,
)
from optics.patterns.extended_depth import *
from optics.patterns.focal_sweep import *
from optics.patterns.gratings import *
from optics.patterns.lenses import *
from optics.patterns.multi_focus import *
from optics.patterns.patches import *
from optics.patterns.slope import *

# Each module says what of it is public, so that a pattern is added in one place.
__all__: list[str] = []
__all__ += extended_depth.__all__
__all__ += focal_sweep.__all__
__all__ += gratings.__all__
__all__ += lenses.__all__
__all__ += multi_focus.__all__
__all__ += patches.__all__
__all__ += slope.__all__
