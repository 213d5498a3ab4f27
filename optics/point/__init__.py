"""The light of one point: what is requested of it, what answers, and a panel in the lens.

A PSFRequest is a lens, a point, a wavelength and samples at the sensor; a PSFEngine is a way to
answer it. PSFs (optics.psf) and the chain behind a panel that stands apart (optics.chain) rest on
both.
"""
