"""The angular spectrum by FFTs of the whole band."""

from __future__ import annotations

from optics.plane import Plane
from optics.propagation.band import Band, whole_band
from optics.propagation.spectral import SpectralPropagator, same_pitch


class AngularSpectrum(SpectralPropagator):
    """Every frequency that a smooth field's samples resolve, and no taper (Goodman 3.10).

    FFTs to and fro, padded until light that wraps around misses the target: the way of the
    steepest light is what they grow with. For planes of one pitch that lie close together.

    Raises ValueError for cells, whose edges send light to all sides, and for planes of two
    pitches; ToleranceError where light of the field's band grazes.
    """

    name = "angular spectrum"

    def _require_served(self) -> None:
        super()._require_served()
        if self.span.cells is not None:
            raise ValueError(f"{self.name} serves smooth fields; cells have sharp edges")
        require_same_pitch(self)

    def _made_band(self) -> Band:
        return whole_band(self.span)

    def _count(self, steps: float) -> int:
        """All frequencies of the FFT: the band's ends are one and the same."""
        return max(round(steps), 1)


def require_same_pitch(method: SpectralPropagator) -> None:
    """Raise ValueError for planes of two pitches."""
    source: Plane = method.span.source
    if not same_pitch(method.span):
        raise ValueError(
            f"{method.name} serves planes of one pitch, and they are {source.pitch} and "
            f"{method.span.target.pitch} m; use the scaled angular spectrum"
        )
