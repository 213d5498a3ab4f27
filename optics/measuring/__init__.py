"""Measure a bench by its own pictures: panel, camera, lens, and how they stand to each other.

The files are in the order of the work. For aligning: the numbers of a region and along a line,
sharpness and a star's width, and how a picture moved. For a camera's noise: frames in pairs, maps
of pixels and their defects, groups of pixels, the photon transfer curve, and darkness with all of
it together. For the panel: gratings to show, spots in a frame, registration, the phase response
from a sweep of levels, wavefront and focus from pictures of a star, and the zeroth order.
"""

from optics.measuring.camera_noise import CameraNoise, characterise_camera
from optics.measuring.focusing import (
    PeakLevel,
    StarShape,
    exposure_for_level,
    focus_score,
    peak_level,
    star_shape,
)
from optics.measuring.measured import Measured
from optics.measuring.paired_frames import PairedFrames
from optics.measuring.picture_motion import (
    Registration,
    RigidMotion,
    register_pictures,
    resample_moved,
)
from optics.measuring.pixel_maps import Defects
from optics.measuring.region import (
    LineProfile,
    Region,
    RegionStatistics,
    line_profile,
    region_statistics,
)

__all__ = [
    "CameraNoise",
    "Defects",
    "LineProfile",
    "Measured",
    "PairedFrames",
    "PeakLevel",
    "Region",
    "RegionStatistics",
    "Registration",
    "RigidMotion",
    "StarShape",
    "characterise_camera",
    "exposure_for_level",
    "focus_score",
    "line_profile",
    "peak_level",
    "region_statistics",
    "register_pictures",
    "resample_moved",
    "star_shape",
]
