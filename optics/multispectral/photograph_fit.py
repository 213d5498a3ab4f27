"""How well a snapshot camera's model explains one photograph: restoration, prediction and score."""

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
from optics.multispectral.snapshot_model import SnapshotModel

LEAST_NOISE_SHARE = 2e-3
"""Least noise for which a photograph is taken, relative to the rms of its light: modelled PSFs are
never more exact."""


@dataclass(frozen=True, eq=False)
class PhotographFit:
    """Restore a photograph by models of a snapshot camera, and compare what they predict with it.

    Attributes
    ----------
    observation : MosaicObservation
        The photograph with its noise, border, weights and clipped pixels.
    model : SnapshotModel
        The camera's nominal model. Its parameters are vectors of deviations: see ParameterLayout.
    gains : torch.Tensor, (bands,), float64
        Transmission of each band, which multiplies the response.
    coupling : BandCoupling
        The restoration's prior of the scene's spectra.
    iterations : int
        Number of iterations of a restoration.
    """

    observation: MosaicObservation
    model: SnapshotModel
    gains: torch.Tensor
    coupling: BandCoupling
    iterations: int

    @cached_property
    def noise(self) -> float:
        """The standard deviation of the snapshot's pixels of weight 1, kept above 0."""
        rms = float(self.observation.image.square().mean().sqrt())
        return max(self.observation.noise, LEAST_NOISE_SHARE * rms)

    @cached_property
    def weights(self) -> torch.Tensor:
        """The snapshot's pixel weights, (rows, columns); 0 where a pixel is dead or clipped."""
        known = self.observation.effective_weights
        return torch.ones_like(self.observation.image) if known is None else known

    def observe(
        self,
        deviation: torch.Tensor,
        image: torch.Tensor | None = None,
        weights: torch.Tensor | None = None,
    ) -> MosaicObservation:
        """Return the snapshot's observation by the model of a vector of deviations.

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
        """Restore a snapshot's bands on the whole period, and return the prior's weight as well."""
        found = total_variation(seen, weight, bands=self.coupling, iterations=self.iterations)
        assert found.weight is not None
        return found.period_image, found.weight

    def predict(self, seen: MosaicObservation, picture: torch.Tensor) -> torch.Tensor:
        """Return the snapshot, (rows, columns), that an observation's model predicts of bands."""
        light = _blur(seen, rfft2(picture), seen.psfs)
        return (seen.filters * light).sum(0)

    def score(
        self, seen: MosaicObservation, picture: torch.Tensor, deviation: torch.Tensor
    ) -> torch.Tensor:
        """Return the derivative of a snapshot's log likelihood by the parameters, (parameters,).

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
    """Return a photograph's observation with the PSFs and filters of a snapshot camera's model.

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
    """Return the part of a snapshot, up to `side` pixels square, with the most contrast.

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
    """Return the part of a snapshot with these sizes that begins at a corner (row, column)."""
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
    """Return a snapshot's bands in the frame, blurred by PSFs; `spectrum` is that of the period."""
    transfer = transfer_function(psfs, seen.period_shape)
    return seen.crop_to_frame(irfft2(spectrum * transfer, seen.period_shape))
