"""The split of the blurred light from the picture, in a restoration by splitting."""

from __future__ import annotations

from collections.abc import Callable

import torch

from optics.deconvolution.observation import Observation
from optics.deconvolution.priors import RELAXATION

LEAST_COUPLING, MOST_COUPLING, COUPLED_ITERATIONS = 0.5, 3.0, 20.0
"""Coupling of the blurred light's split, over the square root of weight over scale: the last number
over that of iterations, within the first two. A strong coupling gets farthest in few iterations; a
weak one is needed for what lies beyond the frame. Measured: of 0.25 to 8, these are the best for 8,
12, 20 and 30 iterations."""

WIDE_COUPLING, NOISY_ITERATIONS = 100.0, 500.0
"""Largest coupling, times the squared radius of the PSF in pixels, where the scene goes on beyond
the frame; and the number of iterations, over the square root of weight over scale, below which it
is larger in proportion. Measured with seven PSFs, 6 to 60 iterations and two noises: of 0.1 to 3,
the best for a ring of 30 pixels is 0.1 to 0.2, for one of 12 it is 0.4 to 3."""

VARIED_COUPLING = 4.0
"""Factor on the coupling of the blurred light's split for photographs with a variance map, whose
dim pixels have weights far above 1. Measured on nine photographs of three scenes with three PSFs:
of 1, 4 and 16, the best for 30 iterations in the worst case; with 1, dim pixels aren't fitted yet.
"""

DataProx = Callable[[torch.Tensor, float], torch.Tensor]
"""The proximal step of a data term. For a light in the frame and a coupling, it returns the light
that minimises data term + coupling / 2 * its squared distance to the given light, pixel by pixel.
"""


class SplitLight:
    """The blurred light of a restoration, split off from the picture and pulled to the photograph.

    Attributes
    ----------
    target : torch.Tensor, (bands, rows, columns)
        The split less its dual variable, on the period: what the next picture's light should be.
    mean_squared_residual : float
        The last picture's mean squared residual, relative to the noise variance.
    """

    def __init__(
        self, observation: Observation, start: torch.Tensor, data_prox: DataProx | None = None
    ) -> None:
        self._observation, self._data_prox = observation, data_prox
        self.target, self.mean_squared_residual = start, 1.0
        self._split: torch.Tensor | None = None
        self._dual = torch.zeros_like(observation.crop_to_frame(start))

    def update(self, light: torch.Tensor, held: float) -> None:
        """Update the deconvolution's split for the last picture's blurred light, which it takes.

        `light` is (bands, rows, columns) on the period, and `held` is the coupling.
        """
        seen = self._observation
        self.target, self.mean_squared_residual = light, seen.mean_squared_residual(light)
        light = seen.crop_to_frame(light)
        if self._split is not None:
            light.mul_(RELAXATION).add_(self._split, alpha=1 - RELAXATION)
        light.add_(self._dual)
        taken = self._step_to_data(light, held)
        # The new split is light + taken, and the new dual variable is -taken.
        self._split = light + taken
        light.add_(taken, alpha=2)
        self._dual = taken.neg_()

    def _step_to_data(self, light: torch.Tensor, held: float) -> torch.Tensor:
        """Return what the proximal step of a deconvolution's data term adds to light."""
        seen = self._observation
        left = seen.normalised_image - seen.sum_bands(light)
        if self._data_prox is not None:
            step = self._data_prox(light, held) - light
        else:
            step = left.mul(self._gain(held))
        if seen.clipped is not None:
            # The light of a clipped pixel is at least the measured value.
            missing = left.clamp(min=0) / seen.filter_power
            step = torch.where(seen.clipped, missing, step)
        return seen.spread_to_bands(step)

    def _gain(self, held: float) -> float | torch.Tensor:
        """Return the share of the misfit that the proximal step of weighted squares takes back."""
        seen, trust = self._observation, self._observation.effective_weights
        if trust is None:
            return 1 / (held + seen.filter_power)
        return trust / (held + trust * seen.filter_power)


def relative_coupling(observation: Observation, iterations: int, weight: float) -> float:
    """Return the coupling of a deconvolution's blurred light, relative to the weight's root."""
    coupling = min(max(COUPLED_ITERATIONS / iterations, LEAST_COUPLING), MOST_COUPLING)
    varied = 1.0 if observation.variance is None else VARIED_COUPLING
    if observation.border == "periodic":
        return varied * coupling
    noisy = NOISY_ITERATIONS * (weight / observation.scale) ** 0.5 / iterations
    wide = max(noisy, 1.0) * WIDE_COUPLING / max(observation.psf_radius, 1.0) ** 2
    return varied * min(coupling, wide)
