"""From light to digital numbers, in the quantities of EMVA 1288."""

from optics.sensor.chain import Shot, Stages
from optics.sensor.drawing import draw, expose
from optics.sensor.fixed_pattern import FixedPattern, fixed_pattern, uneven
from optics.sensor.moments import moments
from optics.sensor.mosaic import Mosaic
from optics.sensor.pixels import (
    PIXEL_INTEGRATION_ERROR,
    PIXEL_OVERSAMPLING,
    PixelIntegration,
    integrate_pixels,
    pixel_margin,
    pixel_transfer,
    sample_pixels,
)
from optics.sensor.shutter import row_starts

__all__ = [
    "PIXEL_INTEGRATION_ERROR",
    "PIXEL_OVERSAMPLING",
    "FixedPattern",
    "Mosaic",
    "PixelIntegration",
    "Shot",
    "Stages",
    "draw",
    "expose",
    "fixed_pattern",
    "integrate_pixels",
    "moments",
    "pixel_margin",
    "pixel_transfer",
    "row_starts",
    "sample_pixels",
    "uneven",
]
