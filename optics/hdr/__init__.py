"""Merge exposure brackets into high-dynamic-range radiance with variance and state.

The files are in the order of the work: what a merged picture is, the bracket with its noise, the
estimate where an exposure may be clipped, the merge itself, how accurate it is, and exposures that
differ from what they were said to be.
"""

from optics.hdr.bracket import Bracket
from optics.hdr.expected_accuracy import (
    ExpectedAccuracy,
    cramer_rao_variance,
    expected_accuracy,
)
from optics.hdr.exposure_factors import ExposureFactors, measure_exposure_factors
from optics.hdr.merging import METHODS, Method, merge, merge_bracket
from optics.hdr.radiance import (
    CLIPPED,
    DARK,
    DEFECTIVE,
    MAY_CLIP,
    MOVED,
    VALID,
    PixelState,
    RadianceEstimate,
)

__all__ = [
    "CLIPPED",
    "DARK",
    "DEFECTIVE",
    "MAY_CLIP",
    "METHODS",
    "MOVED",
    "VALID",
    "Bracket",
    "ExpectedAccuracy",
    "ExposureFactors",
    "Method",
    "PixelState",
    "RadianceEstimate",
    "cramer_rao_variance",
    "expected_accuracy",
    "measure_exposure_factors",
    "merge",
    "merge_bracket",
]
