"""Demosaicing, which estimates all colours of each pixel of a sensor with colour filters."""

from optics.demosaicing.demosaic import METHODS, Method, demosaic

__all__ = ["METHODS", "Method", "demosaic"]
