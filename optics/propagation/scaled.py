"""The angular spectrum between any two windows."""

from __future__ import annotations

from optics.fourier import Geometry
from optics.fourier.transform import PlaneTransform
from optics.propagation.band import Band, reaching_band
from optics.propagation.spectral import SpectralPropagator, any_transform

_MOST_PARTS = 64
"""Of a pitch, among which a common multiple of two is looked for."""


class ScaledAngularSpectrum(SpectralPropagator):
    """The frequencies whose rays reach the target, to any pitch, window and centre.

    The spectrum is taken where it is wanted, and summed where the target is, by the cheapest
    transforms that there are for that (chirp-Z, matrices, gridding, FFTs).

    Raises ToleranceError where rays graze.
    """

    name = "scaled angular spectrum"

    def _made_band(self) -> Band:
        return reaching_band(self.span, self._epsilon())

    def _pitches(self) -> list[tuple[float, float]]:
        source, target = self._declared.source.pitch, self._declared.target.pitch
        common = tuple(common_multiple(p, q) for p, q in zip(source, target, strict=True))
        pitches = [source, target, (common[0] or source[0], common[1] or source[1])]
        return list(dict.fromkeys(pitches))

    def _transform(self, geometry: Geometry) -> PlaneTransform:
        return any_transform(geometry, self.dtype, self.span)


def common_multiple(first: float, second: float) -> float:
    """The least length that is a whole number of either, 0 if none is near."""
    for parts in range(1, _MOST_PARTS + 1):
        ratio = parts * first / second
        if abs(ratio - round(ratio)) < 1e-12 * ratio and round(ratio):
            return parts * first
    return 0.0
