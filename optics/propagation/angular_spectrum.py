"""Propagate light by the angular spectrum, between any two windows or planes of one pitch."""

from __future__ import annotations

from optics.fourier import CommensurateTransform, FourierGeometry
from optics.fourier.transform import PlaneTransform
from optics.propagation.band import FrequencyBand, resolved_band
from optics.propagation.spectral_propagator import SpectralPropagator


class ScaledAngularSpectrum(SpectralPropagator):
    """Propagate by the angular spectrum to a plane of any pitch, window and centre.

    The spectrum is computed only at frequencies whose rays reach the target, and the field only
    at the target's samples. Both transforms are the cheapest available ones (chirp-Z, matrices,
    gridding, FFTs).

    Raises ToleranceError if some rays are grazing.
    """

    name = "scaled angular spectrum"

    def _candidate_pitches(self) -> list[tuple[float, float]]:
        source, target = self._numeric_span.source.pitch, self._numeric_span.target.pitch
        common = tuple(common_multiple(p, q) for p, q in zip(source, target, strict=True))
        pitches = [source, target, (common[0] or source[0], common[1] or source[1])]
        return list(dict.fromkeys(pitches))


class BandLimitedAngularSpectrum(SpectralPropagator):
    """Propagate by the band-limited angular spectrum between planes of one pitch.

    Matsushima and Shimobaba (2009, 10.1364/OE.17.019662) cut the spectrum where the transfer
    function is sampled too coarsely. Here the cut follows from the target, and the period from the
    cut, so that the error is bounded (optics.propagation.band). FFTs are padded to the period, and
    only frequencies whose rays reach the target are kept.

    Raises ValueError for planes of two pitches, and ToleranceError if some rays are grazing.
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
    """Propagate a smooth field by the plain angular spectrum (section 3.10 of Goodman).

    All frequencies that the samples resolve take part, without a taper. The FFTs are padded until
    light that wraps around misses the target, so their length grows with the lateral displacement
    of the steepest rays. The method suits planes of one pitch that are close together.

    Raises ValueError for cells, whose edges diffract light to all angles, and for planes of two
    pitches. Raises ToleranceError if some rays of the field's band are grazing.
    """

    name = "angular spectrum"

    def _require_applicable(self) -> None:
        if self.span.cells is not None:
            raise ValueError(f"{self.name} serves smooth fields; cells have sharp edges")
        super()._require_applicable()

    def _build_band(self) -> FrequencyBand:
        return resolved_band(self.span)

    def _count(self, steps: float) -> int:
        """Return the number of frequencies of the propagator's FFT.

        The two ends of the band are the same frequency, which counts once.
        """
        return max(round(steps), 1)


def common_multiple(first: float, second: float) -> float:
    """Return the least common multiple of two pitches of a propagation.

    Returns 0 if the multiple exceeds 64 times the first pitch.
    """
    for parts in range(1, 65):
        ratio = parts * first / second
        if abs(ratio - round(ratio)) < 1e-12 * ratio and round(ratio):
            return parts * first
    return 0.0
