"""Demosaicing, which estimates all colours of each pixel of a sensor with colour filters.

`build_mosaic_observation` states the problem of demosaicing and deconvolution together, which
`optics.deconvolution.restore` solves.
"""

from optics.demosaicing.demosaic import demosaic, demosaicing_weight
from optics.demosaicing.mosaic_builder import build_mosaic_observation

__all__ = ["build_mosaic_observation", "demosaic", "demosaicing_weight"]
