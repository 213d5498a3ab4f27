"""A camera as data, and what its optics alone determines.

`camera` holds panel, lens and sensor; `stop` the shapes of stops; `stop_areas`, `stop_rows` and
`stop_nodes` what of them is open, and quadrature over it; `pupil` the wave in the stop; and
`system_mtf` the sharpness and light that the optics predicts.
"""

from optics.camera.camera import Camera, Lens
from optics.camera.ghost import Ghost
from optics.sensor.sensor import Sensor
from optics.slm.panel import Panel

__all__ = ["Camera", "Ghost", "Lens", "Panel", "Sensor"]
