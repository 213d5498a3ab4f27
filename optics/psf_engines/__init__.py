"""Define requests for a PSF and the engines that compute it, with one engine for a panel in a lens.

A PSFRequest holds a lens, a point, a wavelength and the samples at the sensor. A PSFEngine computes
the light on these samples. The packages `optics.psf` and, for a panel apart from its lens,
`optics.chain` build on both.
"""
