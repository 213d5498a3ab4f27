"""Restoration by the published objective, within bounds (thesis Eq. 4.3-4.6)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import Bounds, OptimizeResult, minimize

from optics.inverse.blur import Blur
from optics.inverse.bounded import Misfit, ValueAndGradient, differences, differences_adjoint
from optics.inverse.mosaics import MosaicObservation
from optics.inverse.operator import Operator
from optics.inverse.pixel_operators import CentredCrop, SpectralMosaic
from optics.inverse.restored_image import RestoredImage
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_count, require_positive


@dataclass(frozen=True, eq=False)
class PublishedObjective:
    """The objective of the thesis for all bands of a scene (Eq. 4.3, 4.4 and 4.6).

    It is ``|A x - y|² + sum_n (α |∇x_n|² + β |∇x_n|₁) + sum_{n≠i} σ |∇x_n x_i - ∇x_i x_n|₁``, where
    a gradient has two components, the differences to the next row and to the next column, and
    ``|t|₁`` sums √(t² + ε²) - ε over components and pixels. Each pair of bands counts twice, since
    the sum over n ≠ i is over ordered pairs.
    """

    misfit: Misfit  # half the data term
    smoothness: float  # α, of the squared gradients (Sobolev)
    variation: float  # β, of the absolute gradients (total variation), in the light's unit
    cross_channel: float  # σ, of differences between two bands' hues
    smoothing: float  # ε, in the light's unit for gradients, and in its square for hues
    periodic: bool  # whether opposite edges of the scene are neighbours

    def __call__(self, x: torch.Tensor) -> ValueAndGradient:
        half, slope = self.misfit(x)
        value, gradient = 2 * half, 2 * slope
        for term, weight in (
            (self._within_bands, max(self.smoothness, self.variation)),
            (self._between_bands, self.cross_channel),
        ):
            if weight > 0:
                more, steeper = term(x)
                value, gradient = value + more, gradient.add_(steeper)
        return value, gradient

    def _within_bands(self, x: torch.Tensor) -> ValueAndGradient:
        """Compute the prior on each band by itself, and its gradient (Eq. 4.4)."""
        value = x.new_zeros((), dtype=torch.float64)
        pulls = []
        for steps in differences(x, self.periodic):
            lengths = steps.square().add_(self.smoothing**2).sqrt_()
            value += self.smoothness * steps.square().sum(dtype=torch.float64)
            value += self.variation * _excess(lengths, self.smoothing)
            pulls.append(steps.mul(2 * self.smoothness).add_(self.variation * steps / lengths))
        return value, differences_adjoint(*pulls)

    def _between_bands(self, x: torch.Tensor) -> ValueAndGradient:
        """Compute the prior on each pair of bands, and its gradient (Eq. 4.6).

        With the neighbours x' of the pixels x, ∇x_n x_i - ∇x_i x_n is x'_n x_i - x'_i x_n. The
        gradient by x is collected in `own`, and that by x' in `others`.
        """
        value = x.new_zeros((), dtype=torch.float64)
        gradient = torch.zeros_like(x)
        for dim in (-2, -1):
            next_x = x.roll(-1, dim)
            if not self.periodic:
                # The last pixels have no other neighbour than themselves.
                last = x.shape[dim] - 1
                next_x.narrow(dim, last, 1).copy_(x.narrow(dim, last, 1))
            own, others = torch.zeros_like(x), torch.zeros_like(x)
            for n in range(len(x) - 1):
                later, next_later = x[n + 1 :], next_x[n + 1 :]
                hue = torch.addcmul(later * next_x[n], next_later, x[n], value=-1)
                lengths = hue.square().add_(self.smoothing**2).sqrt_()
                value += _excess(lengths, self.smoothing)
                pull = hue.div_(lengths)
                own[n + 1 :].addcmul_(pull, next_x[n])
                others[n + 1 :].addcmul_(pull, x[n], value=-1)
                own[n].sub_((pull * next_later).sum(0))
                others[n].add_((pull * later).sum(0))
            gradient.add_(own).add_(others.roll(1, dim))
        return 2 * self.cross_channel * value, gradient.mul_(2 * self.cross_channel)


def _excess(lengths: torch.Tensor, smoothing: float) -> torch.Tensor:
    """Sum the rounded absolute values √(t² + ε²), less ε each."""
    return lengths.sum(dtype=torch.float64) - smoothing * lengths.numel()


# Default weights and rounding, relative to white. Measured: of 25 settings, the best mean PSNR of
# three scenes of 11 and 24 bands after 300 iterations, with ring PSFs and without noise.
_VARIATION, _CROSS_CHANNEL, _SMOOTHING = 5e-5, 1e-4, 3e-3

_MEMORY = 10  # past steps from which L-BFGS-B estimates curvature; 25 were no better: 0.03 dB


@single_threaded
@torch.no_grad()
def restore_by_published_objective(
    observation: MosaicObservation,
    *,
    smoothness: float = 0.0,
    variation: float = _VARIATION,
    cross_channel: float = _CROSS_CHANNEL,
    smoothing: float = _SMOOTHING,
    white: float = 1.0,
    iterations: int = 300,
    tol: float = 1e-6,
    progress: Progress | None = None,
) -> RestoredImage:
    """Restore the bands of a scene by the objective that the thesis published.

    The objective is Eq. 4.3 with the priors of Eq. 4.4 and 4.6, whose absolute values are rounded
    at 0: see `PublishedObjective`. L-BFGS-B minimises it within 0 and `white`, from the
    interpolated mosaic. It serves for comparison with the publication: `restore_spectra` is faster
    and closer to the scene.

    Parameters
    ----------
    observation : MosaicObservation
        The raw picture with its filters and PSFs: see `build_mosaic_observation`.
    smoothness, variation : float, default 0.0, 5e-5
        Weights α of the squared and β of the absolute gradients, 0 or more, for light in units of
        `white`.
    cross_channel : float, default 1e-4
        Weight σ of differences between the hues of neighbouring pixels, 0 or more.
    smoothing, white : float, default 3e-3, 1.0
        Size ε at which absolute values are rounded, in units of `white`, above 0; and largest light
        of the scene, in the raw picture's unit.
    iterations, tol : int, float, default 300, 1e-6
        Largest number of iterations, and largest entry of the projected gradient, for light in
        units of `white`, at which the search ends.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    RestoredImage
        The bands, (bands, rows, columns), from 0 to `white`.

    Raises
    ------
    ValueError
        For a negative weight, another argument that isn't positive, or a scene of one band.

    References
    ----------
    Thesis Eq. 4.3-4.6; Heide et al. 2013, doi 10.1145/2516971.2516974; Byrd et al. 1995, doi
    10.1137/0916069.
    """
    weights = {"smoothness": smoothness, "variation": variation, "cross_channel": cross_channel}
    for name, weight in weights.items():
        if not (weight >= 0 and math.isfinite(weight)):
            raise ValueError(f"{name} is {weight:g}; give 0 or more")
    if observation.bands < 2:
        raise ValueError("the scene has one band; the published objective compares bands: give 2")
    for name, value in (("smoothing", smoothing), ("white", white), ("tol", tol)):
        require_positive(name, value, "")
    require_count("iterations", iterations)
    progress = progress or Progress()
    forward = _forward_operator(observation)
    misfit = Misfit(forward, observation.image / white, observation.weights, observation.clipped)
    objective = PublishedObjective(
        misfit, smoothness, variation, cross_channel, smoothing, observation.border == "periodic"
    )
    start = observation.extended_image
    inside = observation.border == "dark"
    start = (observation.crop_to_frame(start) if inside else start) / white
    found = _minimise(objective, start.clamp(0, 1), iterations, tol, progress)
    scene = torch.from_numpy(found.x).to(start).reshape(start.shape)
    squares = (forward(scene) * white - observation.image).square()
    trust = observation.effective_weights
    mean = squares.mean() if trust is None else (squares * trust).sum() / (trust > 0).sum()
    left, scene = math.sqrt(float(mean)), scene * white
    restored = RestoredImage(
        scene if inside else observation.crop_to_frame(scene),
        "L-BFGS-B, published objective",
        observation.noise,
        left / (observation.scene_noise * observation.psf_sum),
        cross_channel,
        int(found.nit),
        [],
        bool(found.success),
        scene,
    )
    return restored.to_numpy() if observation.is_numpy else restored


def _forward_operator(observation: MosaicObservation) -> Operator:
    """Return the operator from a scene's bands, of frame or period, to the picture (Eq. 4.1)."""
    period = observation.period_shape
    psfs = observation.psfs.expand(observation.bands, -1, -1)
    frame = CentredCrop(period, observation.image.shape, (observation.bands,))
    seen = SpectralMosaic(observation.filters) @ frame @ Blur(psfs, period)
    return seen @ frame.T if observation.border == "dark" else seen


def _minimise(
    objective: PublishedObjective,
    start: torch.Tensor,
    iterations: int,
    tol: float,
    progress: Progress,
) -> OptimizeResult:
    """Minimise an objective within 0 and 1 by L-BFGS-B, whose vectors are in double precision."""
    done = 0

    def evaluate(flat: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        progress.raise_if_cancelled()
        value, gradient = objective(torch.from_numpy(flat).to(start).reshape(start.shape))
        return float(value), gradient.to(torch.float64).flatten().numpy()

    def report(intermediate_result: OptimizeResult) -> None:
        nonlocal done
        done += 1
        progress.report(done / iterations, f"L-BFGS-B {done}/{iterations}")

    return minimize(
        evaluate,
        start.to(torch.float64).flatten().numpy(),
        method="L-BFGS-B",
        jac=True,
        bounds=Bounds(0.0, 1.0),
        callback=report,
        options={"maxiter": iterations, "maxfun": 20 * iterations, "maxcor": _MEMORY,
                 "ftol": 0.0, "gtol": tol, "maxls": 40},
    )  # fmt: skip
