"""Merge exposure brackets into high-dynamic-range radiance with variance and state.

The files are in the order of the work: the bracket with its noise and its defective pixels, the
samples of some pixels and their weighted mean, pixels that may be clipped, the merge itself and the
time that it takes, how accurate it is, exposures that differ from what they were said to be, the
noise that the frames themselves show, 8-bit pictures whose response curve isn't known, their
exposure times, and frames that moved. A bracket is chosen before it is taken: the scene is metered,
the exposures that a camera can take are searched for, and a scene that has changed since is told.
"""

from optics.hdr.bracket import Bracket, Defects, find_defects
from optics.hdr.bracket_choice import (
    LADDER_RATIOS,
    ChosenBracket,
    UnreachableSNR,
    WantedSNR,
    choose_bracket,
    choose_ladder,
)
from optics.hdr.bracket_noise import BracketNoise, estimate_bracket_noise
from optics.hdr.coded_times import CodedTimes, check_coded_times, is_nominal, shutter_time
from optics.hdr.expected_accuracy import (
    ExpectedAccuracy,
    cramer_rao_variance,
    expected_accuracy,
)
from optics.hdr.exposure_factors import (
    ExposureFactors,
    explain_disorder,
    find_disorder,
    measure_exposure_factors,
)
from optics.hdr.exposures import ExposureLimits, common_period
from optics.hdr.frame_motion import FrameMotions, find_motions
from optics.hdr.merging import (
    CLIPPED,
    DARK,
    DEFECTIVE,
    MAY_CLIP,
    MOVED,
    VALID,
    PixelState,
    RadianceEstimate,
    choose_method,
    merge,
    merge_seconds,
)
from optics.hdr.metering import Meter, MeteredRange
from optics.hdr.response_curve import HIGHEST, LOWEST, ResponseCurve, fit_response
from optics.hdr.response_merging import merge_by_response
from optics.hdr.scene_change import SceneChange, SceneLight, scene_change, scene_light
from optics.hdr.weighted_mean import METHODS, Method

__all__ = [
    "CLIPPED",
    "DARK",
    "DEFECTIVE",
    "HIGHEST",
    "LADDER_RATIOS",
    "LOWEST",
    "MAY_CLIP",
    "METHODS",
    "MOVED",
    "VALID",
    "Bracket",
    "BracketNoise",
    "ChosenBracket",
    "CodedTimes",
    "Defects",
    "ExpectedAccuracy",
    "ExposureFactors",
    "ExposureLimits",
    "FrameMotions",
    "Meter",
    "MeteredRange",
    "Method",
    "PixelState",
    "RadianceEstimate",
    "ResponseCurve",
    "SceneChange",
    "SceneLight",
    "UnreachableSNR",
    "WantedSNR",
    "check_coded_times",
    "choose_bracket",
    "choose_ladder",
    "choose_method",
    "common_period",
    "cramer_rao_variance",
    "estimate_bracket_noise",
    "expected_accuracy",
    "explain_disorder",
    "find_defects",
    "find_disorder",
    "find_motions",
    "fit_response",
    "is_nominal",
    "measure_exposure_factors",
    "merge",
    "merge_by_response",
    "merge_seconds",
    "scene_change",
    "scene_light",
    "shutter_time",
]
