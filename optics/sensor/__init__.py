"""Model the image sensor, from light on its pixels to digital numbers, in terms of EMVA 1288."""

from optics.sensor.frame_sampling import expose, sample_frame
from optics.sensor.moments import moments
from optics.sensor.pixel_integration import (
    PIXEL_OVERSAMPLING,
    PixelIntegration,
    integrate_pixels,
    pixel_margin,
    pixel_transfer,
    sample_pixels,
)
from optics.sensor.readout import row_starts, sensor_as_read
from optics.sensor.sensor import Mosaic
from optics.sensor.stages import FixedPattern, ShotNoise, Stages, fixed_pattern, has_fixed_pattern

__all__ = [
    "PIXEL_OVERSAMPLING",
    "FixedPattern",
    "Mosaic",
    "PixelIntegration",
    "ShotNoise",
    "Stages",
    "expose",
    "fixed_pattern",
    "has_fixed_pattern",
    "integrate_pixels",
    "moments",
    "pixel_margin",
    "pixel_transfer",
    "row_starts",
    "sample_frame",
    "sample_pixels",
    "sensor_as_read",
]
