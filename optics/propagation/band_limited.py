"""The angular spectrum of the light that reaches the target, by FFTs."""

from __future__ import annotations

from optics.propagation.angular_spectrum import require_same_pitch
from optics.propagation.band import Band, reaching_band
from optics.propagation.spectral import SpectralPropagator


class BandLimitedAngularSpectrum(SpectralPropagator):
    """The frequencies whose rays reach the target, cut smoothly, between planes of one pitch.

    Matsushima and Shimobaba (2009, 10.1364/OE.17.019662) cut where the transfer function is
    sampled too coarsely; here the period follows from the cut, and the cut from the target,
    so that the error is bounded (optics.propagation.band). FFTs are padded to the period, and
    of their frequencies only those that reach are kept.

    Raises ValueError for planes of two pitches; ToleranceError where rays graze.
    """

    name = "band-limited angular spectrum"

    def _require_served(self) -> None:
        super()._require_served()
        require_same_pitch(self)

    def _made_band(self) -> Band:
        return reaching_band(self.span, self._epsilon())
