"""The exact references that `labapp accuracy` compares every method with.

Each reference is a slow, direct integral of the declared model (thesis Eq. 3.1, 5.1 to 5.7). It
takes descriptions from optics (lens, stop, panel, plane) but no computation. It has its own code
for phases, coverage of pixels and quadrature, so that it doesn't repeat a mistake of an engine.
"""
