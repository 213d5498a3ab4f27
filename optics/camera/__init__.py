"""Describe a camera: panel, lens with its stop, and sensor.

`camera` holds the description; `stop` the shapes of stops; `stop_areas`, `stop_rows` and
`stop_nodes` what of them is open, and quadrature over it; `pupil` the wave in the stop; and
`system_mtf` the sharpness and light that the optics predicts. The exported names are loaded when
they are first used: a stop's shape needs no torch.
"""

from typing import TYPE_CHECKING

from optics.late_names import late_names

if TYPE_CHECKING:
    from optics.camera.camera import Camera, Lens
    from optics.camera.field_aberrations import FieldAberrations
    from optics.camera.ghost import Ghost
    from optics.camera.stop import Circle, Stop
    from optics.sensor.sensor import Sensor
    from optics.slm.panel import Panel

__all__ = ["Camera", "Circle", "FieldAberrations", "Ghost", "Lens", "Panel", "Sensor", "Stop"]

_MODULES = dict.fromkeys(__all__, "camera") | {"Circle": "stop", "Stop": "stop"}

__getattr__ = late_names(__name__, _MODULES)


def __dir__() -> list[str]:
    return sorted(__all__)
