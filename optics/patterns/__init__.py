"""What a user shows: phases in radians over the panel, (rows, columns), float64.

Phases aren't wrapped, so that a panel can use all the orders that it has; optics.slm wraps
them. A pattern steeper than half a wave a pixel can't be told from its alias, and is refused
with the limit. y is down the rows and x along the columns, from the panel's centre; angles go
from x towards y. A phase that grows along an axis sends light to that side of the sensor.
"""

from __future__ import annotations

from optics.patterns.aberrations import aberrated as aberrated
from optics.patterns.constant import constant as constant
from optics.patterns.depth import annular as annular
from optics.patterns.depth import cubic as cubic
from optics.patterns.gratings import binary_grating as binary_grating
from optics.patterns.gratings import blazed_grating as blazed_grating
from optics.patterns.gratings import sine as sine
from optics.patterns.gratings import steered as steered
from optics.patterns.lenses import axicon as axicon
from optics.patterns.lenses import fresnel_lens as fresnel_lens
from optics.patterns.patches import random_patches as random_patches
from optics.patterns.slope import superposed as superposed
