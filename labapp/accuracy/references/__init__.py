"""Exact answers that `labapp accuracy` holds every method against.

Each is a slow, direct integral of the declared model (thesis Eq. 3.1, 5.1 to 5.7). It takes
descriptions from optics (lens, stop, panel, plane) and no computation: phases, coverage of pixels
and quadrature are its own, so that an engine's mistake isn't repeated by what judges it.
"""
