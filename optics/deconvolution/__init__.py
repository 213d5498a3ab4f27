"""Deconvolution, the restoration of a photograph with a known PSF: see `restore`.

The exported names are loaded when they are first used. The command line and the window need only
the names of the methods; these are in `method_names`, which doesn't load torch.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from optics.deconvolution.bounded import restore_within_bounds
    from optics.deconvolution.layered_observation import build_layered_observation
    from optics.deconvolution.observation import Observation
    from optics.deconvolution.observation_builder import build_observation
    from optics.deconvolution.psf_scale import find_psf_scale
    from optics.deconvolution.restoration_choice import restore
    from optics.deconvolution.restored_image import RestoredImage
    from optics.deconvolution.verdict import judge_restoration

__all__ = [
    "Observation",
    "RestoredImage",
    "build_layered_observation",
    "build_observation",
    "find_psf_scale",
    "judge_restoration",
    "restore",
    "restore_within_bounds",
]

_MODULES = {
    "Observation": "observation",
    "RestoredImage": "restored_image",
    "build_layered_observation": "layered_observation",
    "build_observation": "observation_builder",
    "find_psf_scale": "psf_scale",
    "judge_restoration": "verdict",
    "restore": "restoration_choice",
    "restore_within_bounds": "bounded",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    """Names that a person completes with the tab key, loaded or not."""
    return sorted(__all__)
