"""Measure a picture for focusing and aligning, on the sensor's own digital numbers.

The files are in the order of the work: pictures without hot pixels, a region and its statistics,
its sharpness, the width of a star in it, the numbers along a line, the exposure that brings the
brightest pixel to a wanted level, and how a hand-held picture moved against another.
"""

from optics.alignment.exposure_level import PeakLevel, exposure_for_level, peak_level
from optics.alignment.focus_score import focus_score
from optics.alignment.line_profile import LineProfile, line_profile
from optics.alignment.region import Region, RegionStatistics, region_statistics
from optics.alignment.registration import Registration, register_pictures
from optics.alignment.resampling import resample_moved
from optics.alignment.rigid_motion import RigidMotion
from optics.alignment.star_shape import StarShape, star_shape

__all__ = [
    "LineProfile",
    "PeakLevel",
    "Region",
    "RegionStatistics",
    "Registration",
    "RigidMotion",
    "StarShape",
    "exposure_for_level",
    "focus_score",
    "line_profile",
    "peak_level",
    "region_statistics",
    "register_pictures",
    "resample_moved",
    "star_shape",
]
