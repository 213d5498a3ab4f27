"""The PSF shapes that a user asks for: intensities on a plane, sum one, float64.

Each is a Target: `spiral(plane, radius, width)` draws it, and `spiral.reach(radius, width)` says
how far from the axis it has light, from which a window follows. Lengths are metres on the
sensor; y is down and x to the right, angles go from x towards y. `width` is the standard
deviation of a Gaussian across a stroke, or of a dot.
"""

from __future__ import annotations

from optics.targets.curves import eye as eye
from optics.targets.curves import heart as heart
from optics.targets.curves import infinity as infinity
from optics.targets.curves import spiral as spiral
from optics.targets.dispersion import dispersed_positions as dispersed_positions
from optics.targets.dispersion import linear_dispersion as linear_dispersion
from optics.targets.dots import dots as dots
from optics.targets.dots import grid_positions as grid_positions
from optics.targets.dots import ring_positions as ring_positions
from optics.targets.letters import letters as letters
from optics.targets.logo import logo as logo
from optics.targets.moving import shrinking_spiral as shrinking_spiral
from optics.targets.ring import ring as ring
from optics.targets.target import Target as Target
