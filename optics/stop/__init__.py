"""Describe aperture stops: their shapes, the share of each grid cell that is open, and quadrature.

`aperture` defines the shapes and their boundaries, `coverage` computes open shares of cells,
`quadrature` gives nodes and weights of integrals over the open area, and `arcs` the open parts of
circles, which the quadrature needs.
"""
