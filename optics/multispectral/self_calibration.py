"""Refine the calibration of a snapshot camera from the photograph alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import torch

from optics.fourier import irfft2, rfft2
from optics.inverse.band_coupling import BandCoupling
from optics.inverse.blur import transfer_function
from optics.inverse.mosaics import MosaicObservation
from optics.inverse.restored_image import RestoredImage
from optics.inverse.total_variation import total_variation
from optics.multispectral.restoration import restore_spectra
from optics.multispectral.snapshot_calibration import SnapshotCalibration
from optics.multispectral.snapshot_model import SnapshotModel
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_unmasked

_LEAST_NOISE_SHARE = 2e-3  # of the light's rms: modelled PSFs are never more exact


@dataclass(frozen=True, eq=False)
class PhotographFit:
    """Restores a photograph by models of a camera, and compares what they predict with it.

    The models are `model` with vectors of deviations from nominal (see ParameterLayout), and
    `gains`, (bands,) float64, which multiply the response. `coupling` is the restoration's prior of
    the scene's spectra.
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
        return max(self.observation.noise, _LEAST_NOISE_SHARE * rms)

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
        """Return the observation by a model, with another photograph or weights if given."""
        seen = self.observation
        if image is not None:
            seen = replace(seen, image=image, weights=self.weights, clipped=None)
        if weights is not None:
            seen = replace(seen, weights=weights)
        seen = replace(seen, given_noise=self.noise)
        return _observe_by_model(seen, self.model, deviation, self.gains)

    def restore(
        self, seen: MosaicObservation, weight: float | None = None
    ) -> tuple[torch.Tensor, float]:
        """Restore the bands on the whole period, and return the prior's weight as well."""
        found = total_variation(seen, weight, bands=self.coupling, iterations=self.iterations)
        assert found.weight is not None
        return found.period_image, found.weight

    def predict(self, seen: MosaicObservation, picture: torch.Tensor) -> torch.Tensor:
        """Return the photograph, (rows, columns), that an observation's model predicts of bands."""
        return (seen.filters * _blur(seen, rfft2(picture), seen.psfs)).sum(0)

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

    def score_of(self, image: torch.Tensor, deviation: torch.Tensor, weight: float) -> torch.Tensor:
        """Restore another photograph by a model, and return its score."""
        seen = self.observe(deviation, image)
        return self.score(seen, self.restore(seen, weight)[0], deviation)

    def draw_noise(self, seed: int) -> torch.Tensor:
        """Draw the noise of a simulated photograph, 0 where pixels have no weight."""
        generator = torch.Generator().manual_seed(seed)
        standard = torch.randn(tuple(self.weights.shape), generator=generator).to(self.weights)
        inverse = torch.where(self.weights > 0, self.weights, 1.0).rsqrt()
        return self.noise * standard * inverse * (self.weights > 0)


def _observe_by_model(
    observation: MosaicObservation,
    model: SnapshotModel,
    deviation: torch.Tensor,
    gains: torch.Tensor,
) -> MosaicObservation:
    """Return an observation with the PSFs and filters of a camera's model, all else kept."""
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


def _blur(seen: MosaicObservation, spectrum: torch.Tensor, psfs: torch.Tensor) -> torch.Tensor:
    """Return bands in the frame, blurred by PSFs; `spectrum` is that of the period."""
    transfer = transfer_function(psfs, seen.period_shape)
    return seen.crop_to_frame(irfft2(spectrum * transfer, seen.period_shape))


def busiest_window(observation: MosaicObservation, side: int) -> MosaicObservation:
    """Return the part of a photograph, up to `side` pixels square, with the most contrast.

    It begins at a whole period of the filter pattern. The scene goes on beyond it.
    """
    image, (down, along) = observation.image, observation.filter_period
    rows, columns = (
        min(side, n) // step * step for n, step in zip(image.shape, (down, along), strict=True)
    )
    if rows >= image.shape[0] and columns >= image.shape[1]:
        return observation
    contrast = torch.zeros_like(image)
    contrast[down:] += (image[down:] - image[:-down]).square()
    contrast[:, along:] += (image[:, along:] - image[:, :-along]).square()
    if observation.effective_weights is not None:
        contrast = contrast * (observation.effective_weights > 0)
    sums = torch.nn.functional.pad(contrast.double(), (1, 0, 1, 0)).cumsum(0).cumsum(1)
    inside = (sums[rows:, columns:] - sums[:-rows, columns:] - sums[rows:, :-columns]) + sums[
        :-rows, :-columns
    ]
    starts = inside[::down, ::along]
    row, column = divmod(int(starts.argmax()), starts.shape[1])
    part = (
        slice(row * down, row * down + rows),
        slice(column * along, column * along + columns),
    )
    weights, clipped = observation.weights, observation.clipped
    return replace(
        observation,
        image=image[part].contiguous(),
        weights=None if weights is None else weights[part],
        clipped=None if clipped is None else clipped[part],
        filters=observation.filters[(slice(None), *part)],
        border="unknown",
        given_noise=observation.noise,
    )


# One pixel in so many is held out, at random places. With 3, the scene between them is restored so
# much worse that the estimates get worse.
_HELD_OUT = 8

# Steps of Gauss-Newton's method: on six scenes, the zeroth order is then within 0.01 of the end.
_VALIDATION_STEPS = 3

_DIFFERENCES = (0.01, 0.003)  # of zeroth order and scale, for derivatives

# Largest step of zeroth order and scale. Beyond a zeroth order of 0.29, rings have no zeros in
# their OTF any more, and a step across that point leads astray.
_LARGEST_STEPS = (0.03, 0.01)

# Factor on the variance of the held-out residuals, whose errors are alike in neighbouring pixels
# and which other wrong parameters change as well. Measured on six scenes: the estimate's errors are
# about five times as large as the residuals alone let expect.
_VALIDATION_CAUTION = 25.0


def _validate_on_held_out_pixels(
    fit: PhotographFit, prior: SnapshotCalibration, progress: Progress
) -> torch.Tensor:
    """Estimate a camera's zeroth order and scale by cross-validation.

    The photograph is restored without some of its pixels, and Gauss-Newton's method looks for the
    model whose restoration predicts these best, by an error of the zeroth order that all bands
    share and by the scale, which matter most. Unlike the residual of pixels that the restoration
    has seen, that of others isn't least for models that allow the picture to explain noise. See
    Reeves and Mersereau 1992, doi 10.1109/83.148604 (blur identification by cross-validation).

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
    chosen = torch.randint(_HELD_OUT, tuple(fit.weights.shape), generator=generator) == 0
    judges = chosen & (fit.weights > 0)
    weight: float | None = None

    def held_out_residual(deviation: torch.Tensor) -> torch.Tensor:
        """Return the residuals of held-out pixels, over their noise, as a vector."""
        seen = fit.observe(deviation, weights=fit.weights * ~judges)
        picture, _ = fit.restore(seen, weight)
        left = seen.image - fit.predict(seen, picture)
        return (left * fit.weights.sqrt() / fit.noise)[judges].to(torch.float64)

    place = torch.zeros(2, dtype=torch.float64)
    for number in range(_VALIDATION_STEPS):
        progress.report(
            number / _VALIDATION_STEPS,
            f"zeroth order and size of PSFs {number + 1}/{_VALIDATION_STEPS}",
        )
        deviation = start + place @ ways
        if number < 2:
            _, weight = fit.restore(fit.observe(deviation))
        residual = held_out_residual(deviation)
        slopes = torch.stack([
            (residual - held_out_residual(deviation + step * way)) / step
            for step, way in zip(_DIFFERENCES, ways, strict=True)
        ])  # fmt: skip
        variance = _VALIDATION_CAUTION * residual.square().mean()
        information = slopes @ slopes.mT / variance + precision
        step = torch.linalg.solve(information, slopes @ residual / variance - precision @ place)
        place = place + step * (largest / step.abs().clamp(min=1e-12)).min().clamp(max=1)
    return start + place @ ways


_STEPS = 4  # of Gauss-Newton; more change the estimates by less than their deviations

# Share of each step that is taken. Whole steps swing to and fro along some directions, along which
# the score changes up to twice as fast as simulated photographs let expect.
_DAMPING = 0.7

# Relative error of the expected score, which is that of the restored picture, not of the scene's;
# and variance of the score over that of an exactly known expected score, which the noise of both
# and errors of the model enlarge. Chosen so that 90 % intervals hold at least as often as they say:
# measured with 36 cameras, on photographs with measured reflectances and on scenes of 24 and 11
# measured bands.
_CORRECTION_ERROR, _STATISTICAL_FACTOR = 0.1, 20.0

# Factor on the deviations of the PSFs' centres, which the score follows less well the farther they
# are from the start. Chosen with the same cameras: without it, the intervals of single centres held
# 75 to 97 % of them, with it 89 to 100 %.
_CENTRE_CAUTION = 1.35

_LARGEST_STEP = 1.0  # of a parameter, in its prior standard deviations


def _solve_corrected_score(
    fit: PhotographFit,
    prior: SnapshotCalibration,
    start: torch.Tensor,
    response_side: int,
    progress: Progress,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Estimate all parameters of a camera's model, where the corrected score is 0.

    The score that is expected of the right model is taken off: the mean of two simulated
    photographs with opposite noise. Returns deviations from nominal, (parameters,), and their
    covariance, (parameters, parameters).

    start: first deviations from nominal, (parameters,), float64.
    response_side: sides in pixels of the part that shows how the score changes with the parameters.
    """
    precision = torch.linalg.inv(prior.covariance)
    spread = prior.covariance.diagonal().sqrt()
    _, weight = fit.restore(fit.observe(start))
    part = replace(
        fit,
        observation=busiest_window(fit.observation, response_side),
        iterations=_RESPONSE_ITERATIONS,
    )
    slopes = _score_slopes(part, start, spread, weight, progress.part(0, 0.5))
    slopes = slopes * (fit.weights.numel() / part.weights.numel())
    # Information is symmetric and not negative.
    sizes, axes = torch.linalg.eigh((slopes + slopes.mT) / 2)
    information = (axes * sizes.clamp(min=0)) @ axes.mT
    deviation, noise = start, fit.draw_noise(0)
    for number in range(_STEPS):
        progress.report(0.5 + 0.5 * number / _STEPS, f"all parameters {number + 1}/{_STEPS}")
        seen = fit.observe(deviation)
        picture, _ = fit.restore(seen, weight)
        clean = fit.predict(seen, picture.clamp(min=0))
        expected = torch.stack([
            fit.score_of(clean + one, deviation, weight) for one in (noise, -noise)
        ]).mean(0)  # fmt: skip
        error = (_CORRECTION_ERROR * expected).square()
        trust = torch.linalg.inv(_STATISTICAL_FACTOR * information + torch.diag(error))
        total = information @ trust @ information + precision
        pull = information @ trust @ (fit.score(seen, picture, deviation) - expected)
        step = torch.linalg.solve(total, pull - precision @ (deviation - prior.deviation))
        longest = float((step.abs() / spread).max())
        deviation = deviation + step * min(_DAMPING, _LARGEST_STEP / max(longest, 1e-12))
    caution = torch.ones_like(deviation)
    caution[fit.model.layout.centres] = _CENTRE_CAUTION
    return deviation, torch.linalg.inv(total) * caution[:, None] * caution


# Step of each parameter for the score's derivatives, in prior standard deviations.
_DIFFERENCE = 0.3
_RESPONSE_ITERATIONS = 30  # for derivatives; with 30 instead of 120, they change by 8 % at most


def _score_slopes(
    fit: PhotographFit,
    deviation: torch.Tensor,
    spread: torch.Tensor,
    weight: float,
    progress: Progress,
) -> torch.Tensor:
    """Return how fast the score changes with the parameters, (parameters, parameters).

    Photographs are simulated for each changed parameter, and restored by the unchanged model.
    """
    seen = fit.observe(deviation)
    scene = fit.restore(seen, weight)[0].clamp(min=0)
    noise = fit.draw_noise(1)
    base = fit.score_of(fit.predict(seen, scene) + noise, deviation, weight)
    columns, count = [], len(deviation)
    for number in range(count):
        progress.report(number / count, f"influence of parameter {number + 1}/{count}")
        step = _DIFFERENCE * float(spread[number])
        other = deviation.clone()
        other[number] += step
        changed = fit.predict(fit.observe(other), scene)
        columns.append((fit.score_of(changed + noise, deviation, weight) - base) / step)
    return torch.stack(columns, 1)


# Least sides in pixels of the part of the photograph that is used, and of its part for derivatives;
# least sides over those of the PSFs, which mustn't blur all that they show. Chosen for the time.
_SIDE, _RESPONSE_SIDE = 192, 128
_PSF_SIDES, _RESPONSE_PSF_SIDES = 2.5, 2.0
_ITERATIONS = 60  # of each restoration on the way; with 30, held-out pixels are predicted worse


@single_threaded
def refine_from_photograph(
    observation: MosaicObservation,
    spectra: Any,
    prior: SnapshotCalibration,
    *,
    progress: Progress | None = None,
) -> tuple[SnapshotCalibration, RestoredImage]:
    """Refine a snapshot camera's calibration from one photograph, and restore its bands.

    Cross-validation finds zeroth order and scale, which matter most, and then the score of the
    likelihood all parameters, corrected by simulated photographs. Both use the part of the
    photograph with the most contrast.

    Parameters
    ----------
    observation : MosaicObservation
        The raw picture, whose PSFs and filters are replaced by those of the calibration.
    spectra : torch.Tensor or numpy.ndarray, (samples, bands)
        Typical spectra on the scale of the scene's bands; as many as bands or more.
    prior : SnapshotCalibration
        What is known before: `SnapshotCalibration.nominal`, or a calibration from frames.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    tuple of SnapshotCalibration and RestoredImage
        The calibration with its uncertainty, and the bands as restored with it.

    Raises
    ------
    ValueError
        For another number of bands or another filter pattern than the calibration's, or for
        unusable spectra.
    """
    model, progress = prior.model, progress or Progress()
    period = (len(model.pattern), len(model.pattern[0]))
    if observation.bands != model.bands or observation.filter_period != period:
        raise ValueError(
            f"observation has {observation.bands} bands and a filter pattern of "
            f"{observation.filter_period}; the calibration is of {model.bands} bands and {period}"
        )
    require_unmasked(spectra)
    samples = torch.as_tensor(spectra)
    gains = torch.ones(model.bands, dtype=torch.float64)
    if prior.transmission is not None:
        gains = prior.transmission.values
    wide = max(model.coded.shape[1:])
    response_side = max(_RESPONSE_SIDE, round(_RESPONSE_PSF_SIDES * wide))
    part = busiest_window(observation, max(_SIDE, round(_PSF_SIDES * wide)))
    fit = PhotographFit(part, model, gains, BandCoupling.spectral(samples), _ITERATIONS)
    start = _validate_on_held_out_pixels(fit, prior, progress.part(0, 0.25))
    deviation, covariance = _solve_corrected_score(
        fit, prior, start, response_side, progress.part(0.25, 0.75)
    )
    refined = prior.with_estimates(deviation, covariance, f"{prior.source} and photograph")
    seen = _observe_by_model(observation, model, refined.relative_deviation, gains)
    return refined, restore_spectra(seen, samples, progress=progress.part(0.75, 1))
