"""Forward operators of inverse problems: from what is looked for to what was measured."""

from optics.operators.blur import Blur, blur_of, blur_shape
from optics.operators.combined import Chain, Sum
from optics.operators.contract import Operator
from optics.operators.gram import Gram
from optics.operators.occluding import OccludingBlur
from optics.operators.pixels import Mask, Window
from optics.operators.spectral import SpectralMosaic, filter_weights
from optics.operators.varying import VaryingBlur, field_weights, layer_weights

__all__ = [
    "Blur",
    "Chain",
    "Gram",
    "Mask",
    "OccludingBlur",
    "Operator",
    "SpectralMosaic",
    "Sum",
    "VaryingBlur",
    "Window",
    "blur_of",
    "blur_shape",
    "field_weights",
    "filter_weights",
    "layer_weights",
]
