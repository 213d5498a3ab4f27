"""Undo what a camera did to the light: `restore` a photograph with a known PSF, and all around it.

Operators map the unknown to what was measured; an observation is a photograph with its PSF, noise
and pixel weights; one iteration by splitting serves all methods, one file each. `blind` finds an
unknown blur kernel, and `mosaics` all colours of each pixel.

The exported names are loaded when they are first used. The command line and the window need only
the names of the methods; these are in `method_names`, which doesn't load torch.
"""

from typing import TYPE_CHECKING

from optics.late_names import late_names

if TYPE_CHECKING:
    from optics.inverse.blur import (
        Blur,
        OccludingBlur,
        VaryingBlur,
        blur_operator,
        blur_shape,
        field_weights,
        layer_weights,
    )
    from optics.inverse.bounded import restore_within_bounds
    from optics.inverse.choice import restore
    from optics.inverse.layered import build_layered_observation
    from optics.inverse.mosaics import build_mosaic_observation, demosaic, demosaicing_weight
    from optics.inverse.observation import Observation
    from optics.inverse.observation_builder import build_observation
    from optics.inverse.operator import GramOperator, Operator, OperatorProduct, OperatorSum
    from optics.inverse.pixel_operators import CentredCrop, Mask, SpectralMosaic, filter_weights
    from optics.inverse.restored_image import RestoredImage
    from optics.inverse.verdict import find_psf_scale, judge_restoration

__all__ = [
    "Blur",
    "CentredCrop",
    "GramOperator",
    "Mask",
    "Observation",
    "OccludingBlur",
    "Operator",
    "OperatorProduct",
    "OperatorSum",
    "RestoredImage",
    "SpectralMosaic",
    "VaryingBlur",
    "blur_operator",
    "blur_shape",
    "build_layered_observation",
    "build_mosaic_observation",
    "build_observation",
    "demosaic",
    "demosaicing_weight",
    "field_weights",
    "filter_weights",
    "find_psf_scale",
    "judge_restoration",
    "layer_weights",
    "restore",
    "restore_within_bounds",
]

_MODULES = {
    "blur": "Blur OccludingBlur VaryingBlur blur_operator blur_shape field_weights layer_weights",
    "bounded": "restore_within_bounds",
    "choice": "restore",
    "layered": "build_layered_observation",
    "mosaics": "build_mosaic_observation demosaic demosaicing_weight",
    "observation": "Observation",
    "observation_builder": "build_observation",
    "operator": "GramOperator Operator OperatorProduct OperatorSum",
    "pixel_operators": "CentredCrop Mask SpectralMosaic filter_weights",
    "restored_image": "RestoredImage",
    "verdict": "find_psf_scale judge_restoration",
}
__getattr__ = late_names(
    __name__, {name: module for module, names in _MODULES.items() for name in names.split()}
)


def __dir__() -> list[str]:
    return sorted(__all__)
