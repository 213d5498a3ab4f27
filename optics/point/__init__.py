"""The light of one point: what is asked of it, what answers, and a panel in the lens.

A Question is a lens, a point, a wavelength and samples at the sensor; an Engine is a way to answer
it. PSFs (optics.psf) and the chain behind a panel that stands apart (optics.chain) rest on both.
"""
