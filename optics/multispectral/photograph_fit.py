"""How well a snapshot camera's model explains a photograph, and pixels that it hasn't seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.band_coupling import BandCoupling
from optics.inverse.blur import transfer_function
from optics.inverse.mosaics import MosaicObservation
from optics.inverse.total_variation import total_variation
from optics.multispectral.snapshot_calibration import SnapshotCalibration
from optics.multispectral.snapshot_model import SnapshotModel
from optics.progress import Progress

LEAST_NOISE_SHARE = 2e-3
"""Least noise for which a photograph is taken, relative to the rms of its light: modelled PSFs are
never more exact."""


@dataclass(frozen=True, eq=False)
class PhotographFit:
    """Restores a photograph by models of a camera, and compares what they predict with it.

    observation: the photograph with its noise, border, weights and clipped pixels.
    model: the camera's nominal model. Its parameters are vectors of deviations: see
        ParameterLayout.
    gains: transmission of each band, (bands,), float64, which multiplies the response.
    coupling: the restoration's prior of the scene's spectra.
    iterations: number of iterations of a restoration.
    """

    observation: MosaicObservation
    model: SnapshotModel
    gains: torch.Tensor
    coupling: BandCoupling
    iterations: int

    @cached_property
    def noise(self) -> float:
        """Standard deviation of pixels of weight 1, kept above 0."""
        rms = float(self.observation.image.square().mean().sqrt())
        return max(self.observation.noise, LEAST_NOISE_SHARE * rms)

    @cached_property
    def weights(self) -> torch.Tensor:
        """Pixel weights, (rows, columns); 0 where a pixel is dead or clipped."""
        known = self.observation.effective_weights
        return torch.ones_like(self.observation.image) if known is None else known

    def observe(
        self,
        deviation: torch.Tensor,
        image: torch.Tensor | None = None,
        weights: torch.Tensor | None = None,
    ) -> MosaicObservation:
        """Return the observation by the model of a vector of deviations.

        `image` is another photograph of the same pixels, and `weights` are other weights, if given.
        """
        seen = self.observation
        if image is not None:
            seen = replace(seen, image=image, weights=self.weights, clipped=None)
        if weights is not None:
            seen = replace(seen, weights=weights)
        seen = replace(seen, given_noise=self.noise)
        return observe_by_model(seen, self.model, deviation, self.gains)

    def restore(
        self, seen: MosaicObservation, weight: float | None = None
    ) -> tuple[torch.Tensor, float]:
        """Restore the bands on the whole period, and return the prior's weight as well."""
        found = total_variation(seen, weight, bands=self.coupling, iterations=self.iterations)
        assert found.weight is not None
        return found.period_image, found.weight

    def predict(self, seen: MosaicObservation, picture: torch.Tensor) -> torch.Tensor:
        """Return the photograph, (rows, columns), that an observation's model predicts of bands."""
        light = _blur(seen, rfft2(picture), seen.psfs)
        return (seen.filters * light).sum(0)

    def score(
        self, seen: MosaicObservation, picture: torch.Tensor, deviation: torch.Tensor
    ) -> torch.Tensor:
        """Return the derivative of the log likelihood by the parameters, (parameters,).

        The bands are held at the restored `picture`, (bands, rows, columns) on the period.
        """
        layout, spectrum = self.model.layout, rfft2(picture)
        score = torch.zeros(layout.count, dtype=torch.float64)
        with torch.no_grad():
            left = (seen.image - self.predict(seen, picture)) * self.weights / self.noise**2
            pulls = [
                (seen.filters * _blur(seen, spectrum, slope.to(left)) * left).sum((1, 2))
                for slope in self.model.psf_slopes(deviation)
            ]
            score.index_add_(0, layout.band_places.flatten(), torch.cat(pulls).double())
            light = _blur(seen, spectrum, seen.psfs) * left
            masks = self.model.channel_masks(left.shape).to(left)
            by_channel = torch.einsum("cyx,byx->cb", masks, light).double() * self.gains
            by_ratio = (self.model.response_slopes(deviation) * by_channel).sum(1)
            score.index_add_(0, layout.ratio_places.flatten(), by_ratio.flatten())
        return score


def observe_by_model(
    observation: MosaicObservation,
    model: SnapshotModel,
    deviation: torch.Tensor,
    gains: torch.Tensor,
) -> MosaicObservation:
    """Return an observation with the PSFs and filters of a camera's model.

    `deviation` is the vector of the model's deviations from nominal, and `gains`, (bands,),
    multiply the response. The photograph, its noise, border, weights and clipped pixels are kept.
    """
    with torch.no_grad():
        psfs, response = model.psfs(deviation), model.response_at(deviation) * gains
    image = observation.image
    return replace(
        observation,
        psf=psfs.mean(0).to(image),
        psfs=psfs.to(image),
        filters=model.filters(response, image.shape).to(image),
        filter_period=(len(model.pattern), len(model.pattern[0])),
    )


def busiest_window(observation: MosaicObservation, side: int) -> MosaicObservation:
    """Return the part of a photograph, up to `side` pixels square, with the most contrast.

    It begins at a whole period of the filter pattern. The scene goes on beyond it.
    """
    image, steps = observation.image, observation.filter_period
    sizes = [min(side, n) // step * step for n, step in zip(image.shape, steps, strict=True)]
    if all(n >= m for n, m in zip(sizes, image.shape, strict=True)):
        return observation
    contrast = torch.zeros_like(image)
    down, along = steps
    contrast[down:] += (image[down:] - image[:-down]).square()
    contrast[:, along:] += (image[:, along:] - image[:, :-along]).square()
    if observation.effective_weights is not None:
        contrast = contrast * (observation.effective_weights > 0)
    sums = torch.nn.functional.pad(contrast.double(), (1, 0, 1, 0)).cumsum(0).cumsum(1)
    rows, columns = sizes
    inside = (sums[rows:, columns:] - sums[:-rows, columns:] - sums[rows:, :-columns]) + sums[
        :-rows, :-columns
    ]
    starts = inside[::down, ::along]
    row, column = divmod(int(starts.argmax()), starts.shape[1])
    return _crop(observation, (row * down, column * along), (rows, columns))


def _crop(
    observation: MosaicObservation, corner: tuple[int, int], sizes: Sequence[int]
) -> MosaicObservation:
    """Return the part with these sizes that begins at a corner (row, column)."""
    part = tuple(slice(first, first + n) for first, n in zip(corner, sizes, strict=True))
    weights, clipped = observation.weights, observation.clipped
    return replace(
        observation,
        image=observation.image[part].contiguous(),
        weights=None if weights is None else weights[part],
        clipped=None if clipped is None else clipped[part],
        filters=observation.filters[(slice(None), *part)],
        border="unknown",
        given_noise=observation.noise,
    )


def _blur(seen: MosaicObservation, spectrum: torch.Tensor, psfs: torch.Tensor) -> torch.Tensor:
    """Return bands in the frame, blurred by PSFs; `spectrum` is that of the period."""
    transfer = transfer_function(psfs, seen.period_shape)
    return seen.crop_to_frame(irfft2(spectrum * transfer, seen.period_shape))


_EVERY = 8
"""One pixel in so many is held out, at random places. With 3, the scene between them is restored so
much worse that the estimates get worse."""

_STEPS = 3
"""Steps of Gauss-Newton's method. Measured on six scenes: the zeroth order is within 0.01 of the
end after three."""

_DIFFERENCES = (0.01, 0.003)
"""Steps of zeroth order and scale for derivatives, which are small beside what matters."""

_LARGEST_STEPS = (0.03, 0.01)
"""Largest step of zeroth order and scale. Beyond a zeroth order of 0.29, rings have no zeros in
their OTF any more, and a step across that point leads astray."""

_CAUTION = 25.0
"""Factor on the variance of the held-out residuals, whose errors are alike in neighbouring pixels
and which other wrong parameters change as well. Measured on six scenes: the estimate's errors are
about five times as large as the residuals alone let expect."""


def validate_on_held_out_pixels(
    fit: PhotographFit, prior: SnapshotCalibration, progress: Progress
) -> torch.Tensor:
    """Estimate a camera's zeroth order and scale by cross-validation.

    The photograph is restored without some of its pixels, and the model whose restoration predicts
    these pixels best is looked for by Gauss-Newton's method. An error of the zeroth order that all
    bands share and the scale are estimated, as they matter most; all else stays as it was. Unlike
    the residual of pixels that the restoration has seen, that of others isn't least for models that
    allow the picture to explain noise. See Reeves and Mersereau 1992, doi 10.1109/83.148604 (blur
    identification by cross-validation).

    Returns the model's deviations from nominal, (parameters,), float64: a start for better
    estimates.
    """
    layout, start = prior.model.layout, prior.deviation
    ways = torch.zeros(2, layout.count, dtype=torch.float64)
    ways[0, layout.zeroth_orders] = 1
    ways[1, layout.scale] = 1
    precision = ways @ torch.linalg.inv(prior.covariance) @ ways.mT
    largest = torch.tensor(_LARGEST_STEPS, dtype=torch.float64)
    generator = torch.Generator().manual_seed(0)
    chosen = torch.randint(_EVERY, tuple(fit.weights.shape), generator=generator) == 0
    judges = chosen & (fit.weights > 0)
    place = torch.zeros(2, dtype=torch.float64)
    weight: float | None = None
    for number in range(_STEPS):
        progress.report(number / _STEPS, f"zeroth order and size of PSFs {number + 1}/{_STEPS}")
        deviation = start + place @ ways
        if number < 2:
            _, weight = fit.restore(fit.observe(deviation))
        residual = _held_out_residual(fit, deviation, judges, weight)
        slopes = torch.stack([
            (residual - _held_out_residual(fit, deviation + step * way, judges, weight)) / step
            for step, way in zip(_DIFFERENCES, ways, strict=True)
        ])  # fmt: skip
        variance = _CAUTION * residual.square().mean()
        information = slopes @ slopes.mT / variance + precision
        step = torch.linalg.solve(information, slopes @ residual / variance - precision @ place)
        place = place + step * (largest / step.abs().clamp(min=1e-12)).min().clamp(max=1)
    return start + place @ ways


def _held_out_residual(
    fit: PhotographFit, deviation: torch.Tensor, judges: torch.Tensor, weight: float | None
) -> torch.Tensor:
    """Return the residuals of held-out pixels, over their noise, as a vector."""
    seen = fit.observe(deviation, weights=fit.weights * ~judges)
    picture, _ = fit.restore(seen, weight)
    left = seen.image - fit.predict(seen, picture)
    return (left * fit.weights.sqrt() / fit.noise)[judges].to(torch.float64)
