"""What the gain of a restoration depends on: noise, PSF, border and picture, and how much."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

from optics.deconvolution.observation import Observation


@dataclass(frozen=True)
class RestorationCase:
    """Features of a photograph to be restored; each is about 0 for an ordinary one.

    Attributes
    ----------
    noise : float
        Decades of the noise over the picture's standard deviation, above 1/60; in half decades.
    size : float
        Octaves of the PSF's rms radius, above 6 pixels.
    explained : float
        Decades of the share of the data that the best linear filter explains, above a quarter.
    transmission : float
        Decades of the mean squared MTF, above a sixteenth; in 0.4 decades.
    border : float
        1 if the scene goes on beyond the frame, 0 if not.
    """

    noise: float
    size: float
    explained: float
    transmission: float
    border: float

    @classmethod
    def of(cls, observation: Observation) -> RestorationCase:
        """Compute the features of a photograph, on which its deconvolution's gain depends."""
        observation = observation.in_own_unit
        explained = max(observation.wiener_prediction.explained_share, 1e-3)
        ratio = max(observation.disturbance / observation.scale, 1e-6)
        mean = max(float(observation.squared_mtf.detach().mean()), 1e-6)
        return cls(
            (math.log10(ratio) + 1.8) / 0.5,
            math.log2(max(observation.psf_radius, 0.5) / 6),
            (math.log10(explained) + 0.6) / 0.4,
            (math.log10(mean) + 1.2) / 0.4,
            float(observation.border == "unknown"),
        )


@dataclass(frozen=True)
class Gain:
    """The gain in PSNR of a restoration in dB, which is linear in the features of its case.

    `usual` is the gain where all features are 0, and the others are its change for 1 of a feature:
    see RestorationCase.
    """

    usual: float
    by_noise: float
    by_size: float
    by_explained: float
    by_transmission: float
    by_border: float

    def predict(self, case: RestorationCase) -> float:
        """Predict the gain in PSNR over the blurred photograph by its deconvolution, in dB."""
        first, *slopes = astuple(self)
        return float(first + sum(a * b for a, b in zip(slopes, astuple(case), strict=True)))


def predicted_gain(gain: float | Gain, case: RestorationCase) -> float:
    """Predict a deconvolution's gain in dB from a number or from a Gain."""
    return gain.predict(case) if isinstance(gain, Gain) else gain
