"""The angular spectrum: between any two windows, or by FFTs between planes of one pitch."""

from __future__ import annotations

from optics.fourier import CommensurateTransform, FourierGeometry
from optics.fourier.transform import PlaneTransform
from optics.propagation.band import FrequencyBand, resolved_band
from optics.propagation.spectral_propagator import SpectralPropagator

_MOST_PARTS = 64
"""Of a pitch, among which a common multiple of two is looked for."""


class ScaledAngularSpectrum(SpectralPropagator):
    """The frequencies whose rays reach the target, to any pitch, window and centre.

    The spectrum is taken where it is wanted, and summed where the target is, by the cheapest
    transforms that there are for that (chirp-Z, matrices, gridding, FFTs).

    Raises ToleranceError where rays graze.
    """

    name = "scaled angular spectrum"

    def _candidate_pitches(self) -> list[tuple[float, float]]:
        source, target = self._numeric_span.source.pitch, self._numeric_span.target.pitch
        common = tuple(common_multiple(p, q) for p, q in zip(source, target, strict=True))
        pitches = [source, target, (common[0] or source[0], common[1] or source[1])]
        return list(dict.fromkeys(pitches))


class BandLimitedAngularSpectrum(SpectralPropagator):
    """The frequencies whose rays reach the target, cut smoothly, between planes of one pitch.

    Matsushima and Shimobaba (2009, 10.1364/OE.17.019662) cut where the transfer function is
    sampled too coarsely; here the period follows from the cut, and the cut from the target,
    so that the error is bounded (optics.propagation.band). FFTs are padded to the period, and
    of their frequencies only those that reach are kept.

    Raises ValueError for planes of two pitches; ToleranceError where rays graze.
    """

    name = "band-limited angular spectrum"

    def _require_applicable(self) -> None:
        super()._require_applicable()
        pitches = self.span.source.pitch, self.span.target.pitch
        if not all(abs(p - q) <= 1e-12 * p for p, q in zip(*pitches, strict=True)):
            raise ValueError(
                f"{self.name} serves planes of one pitch, and they are {pitches[0]} and "
                f"{pitches[1]} m; use the scaled angular spectrum"
            )

    def _transform(self, geometry: FourierGeometry) -> PlaneTransform:
        return CommensurateTransform(geometry, self.dtype)


class AngularSpectrum(BandLimitedAngularSpectrum):
    """Every frequency that a smooth field's samples resolve, and no taper (Goodman 3.10).

    FFTs to and fro, padded until light that wraps around misses the target: the way of the
    steepest light is what they grow with. For planes of one pitch that lie close together.

    Raises ValueError for cells, whose edges send light to all sides, and for planes of two
    pitches; ToleranceError where light of the field's band grazes.
    """

    name = "angular spectrum"

    def _require_applicable(self) -> None:
        if self.span.cells is not None:
            raise ValueError(f"{self.name} serves smooth fields; cells have sharp edges")
        super()._require_applicable()

    def _build_band(self) -> FrequencyBand:
        return resolved_band(self.span)

    def _count(self, steps: float) -> int:
        """All frequencies of the FFT: the band's ends are one and the same."""
        return max(round(steps), 1)


def common_multiple(first: float, second: float) -> float:
    """The least length that is a whole number of either, 0 if none is near."""
    for parts in range(1, _MOST_PARTS + 1):
        ratio = parts * first / second
        if abs(ratio - round(ratio)) < 1e-12 * ratio and round(ratio):
            return parts * first
    return 0.0
