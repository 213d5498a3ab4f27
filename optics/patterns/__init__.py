"""What a user shows: phases in radians over the panel, (rows, columns), float64.

Phases aren't wrapped, so that a panel can use all the orders that it has; optics.slm wraps
them. A pattern steeper than half a wave a pixel can't be told from its alias, and is refused
with the limit. y is down the rows and x along the columns, from the panel's centre; angles go
from x towards y. A phase that grows along an axis sends light to that side of the sensor.

Each module says in its `__all__` what of it is public.
"""

from __future__ import annotations

from optics.patterns.aberrations import *
from optics.patterns.constant import *
from optics.patterns.extended_depth import *
from optics.patterns.gratings import *
from optics.patterns.lenses import *
from optics.patterns.patches import *
from optics.patterns.slope import *
