"""Linear forward operators of inverse problems, which map an unknown scene to what is measured."""

from optics.operators.base import Operator
from optics.operators.blur import Blur, blur_operator, blur_shape
from optics.operators.combined import OperatorProduct, OperatorSum
from optics.operators.crop_and_mask import CentredCrop, Mask
from optics.operators.gram import GramOperator
from optics.operators.occluding import OccludingBlur
from optics.operators.spectral_mosaic import SpectralMosaic, filter_weights
from optics.operators.varying import VaryingBlur, field_weights, layer_weights

__all__ = [
    "Blur",
    "CentredCrop",
    "GramOperator",
    "Mask",
    "OccludingBlur",
    "Operator",
    "OperatorProduct",
    "OperatorSum",
    "SpectralMosaic",
    "VaryingBlur",
    "blur_operator",
    "blur_shape",
    "field_weights",
    "filter_weights",
    "layer_weights",
]
