"""Measure a camera's noise from frames of even light and of darkness, after EMVA 1288.

The files are in the order of the work: frames in pairs, the noise of a pair, maps of pixels and
their defects, groups of pixels, darkness, saturation, the photon transfer curve, linearity and
non-uniformity, and all of it together.
"""

from optics.camera_noise.characteristics import CameraNoise, characterise_camera
from optics.camera_noise.defects import Defects
from optics.camera_noise.measured import Measured
from optics.camera_noise.paired_frames import PairedFrames

__all__ = [
    "CameraNoise",
    "Defects",
    "Measured",
    "PairedFrames",
    "characterise_camera",
]
