"""All colours of each pixel, from a sensor whose pixels see one each."""

from optics.demosaicing.demosaic import METHODS, Method, demosaic

__all__ = ["METHODS", "Method", "demosaic"]
