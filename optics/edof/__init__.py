"""Design patterns for an extended depth of field, and compare what decoders get behind them.

Depths are in dioptres, one over metres from the panel; infinity is 0. The design needs no picture:
`design_pattern` lowers the error that linear restoration is expected to leave, computed from
transfer functions (`QuarterTransfer`, `FullTransfer`) and a power spectrum. `rms_transfer_limit`
and `known_depth_bound` are what no pattern can pass. `evaluate_patterns` compares patterns on
pictures, by a stated protocol.
"""

from optics.edof.decoders import (
    BlindDecoder,
    KnownDepthDecoder,
    blind_wiener,
    known_depth_wiener,
    measure_training_spectrum,
    no_decoder,
)
from optics.edof.depth_bound import known_depth_bound, rms_transfer_limit
from optics.edof.dioptres import (
    DEPTH_RANGE,
    PUBLISHED_DIOPTRES,
    dioptres_from_metres,
    metres_from_dioptres,
    midpoint_dioptres,
    random_dioptres,
)
from optics.edof.evaluation import evaluate_patterns
from optics.edof.panel_transfer import FullTransfer, QuarterTransfer
from optics.edof.parametrisation import PARAMETRISATIONS, make_parametrisation
from optics.edof.pattern_rating import (
    DesignResult,
    PatternRating,
    SearchSettings,
    SearchState,
    rate_pattern,
)
from optics.edof.pattern_search import DesignBand, design_pattern
from optics.edof.picture_spectrum import NATURAL_SPECTRUM, FrequencyGrid, measure_picture_spectrum
from optics.edof.protocol import AUTHORS, HIGH_NOISE, LOW_NOISE, STRICT, EdofProtocol
from optics.edof.protocol_psfs import STOP_DIAMETERS, PupilPattern, round_stop
from optics.edof.transfer_design import TransferDesign

__all__ = [
    "AUTHORS",
    "DEPTH_RANGE",
    "HIGH_NOISE",
    "LOW_NOISE",
    "NATURAL_SPECTRUM",
    "PARAMETRISATIONS",
    "PUBLISHED_DIOPTRES",
    "STOP_DIAMETERS",
    "STRICT",
    "BlindDecoder",
    "DesignBand",
    "DesignResult",
    "EdofProtocol",
    "FrequencyGrid",
    "FullTransfer",
    "KnownDepthDecoder",
    "PatternRating",
    "PupilPattern",
    "QuarterTransfer",
    "SearchSettings",
    "SearchState",
    "TransferDesign",
    "blind_wiener",
    "design_pattern",
    "dioptres_from_metres",
    "evaluate_patterns",
    "known_depth_bound",
    "known_depth_wiener",
    "make_parametrisation",
    "measure_picture_spectrum",
    "measure_training_spectrum",
    "metres_from_dioptres",
    "midpoint_dioptres",
    "no_decoder",
    "random_dioptres",
    "rate_pattern",
    "rms_transfer_limit",
    "round_stop",
]
