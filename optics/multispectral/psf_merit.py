"""A merit function for the PSFs of spectral bands, by which designs are compared."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch

from optics.inverse import build_mosaic_observation
from optics.inverse.blur import Blur
from optics.inverse.pixel_operators import SpectralMosaic, filter_weights
from optics.multispectral.dead_leaves import draw_dead_leaves
from optics.multispectral.predicted_error import predict_errors
from optics.multispectral.restoration import restore_spectra
from optics.threads import single_threaded
from optics.validation import require_count, require_positive, require_unmasked

_SIDE = 96
_ITERATIONS = 60
"""Size of the simulated scene, and iterations of its restoration; chosen. A simulation takes a
quarter of a second."""

_LEAST_SQUARE = 1e-14
"""Mean square error to which a simulated band may be restored exactly, in single precision."""


class PsfMerit:
    """Rates PSFs by the mean PSNR in dB that spectral bands are expected to be restored with.

    The merit is the mean of two estimates, neither of which needs a picture. `predict_errors` is
    right for smooth scenes, but blind to what sharp edges add: a Gaussian scene has one datum for
    each frequency, however the PSFs differ. The other estimate restores a simulated scene of sharp
    edges (see `draw_dead_leaves`) by `restore_spectra`. With 38 designs and six scenes, the rank
    correlation with measured levels is 0.95 for the first, 0.94 for the second, and 0.98 for both.

    Parameters
    ----------
    response : torch.Tensor or numpy.ndarray, (channels, bands)
        Share of each band that the filter of each letter transmits.
    pattern : sequence of str
        Rows of one letter per pixel that repeat, as ``("RG", "GB")``.
    spectra : torch.Tensor or numpy.ndarray, (samples, bands)
        Typical spectra of the scene; 1 is the peak of the PSNR.
    noise : float
        Standard deviation of a pixel of the raw picture, above 0.
    generator : torch.Generator
        Source of the simulated scene and its noise, which are the same for all PSFs.
    channels : str, default "RGB"
        Letters of the channels, in the order of `response`.
    side : int, default 96
        Rows and columns of the simulated scene.

    Raises
    ------
    ValueError
        For shapes that don't fit, values that aren't finite, or noise that isn't positive.
    """

    def __init__(
        self,
        response: Any,
        pattern: Sequence[str],
        spectra: Any,
        noise: float,
        *,
        generator: torch.Generator,
        channels: str = "RGB",
        side: int = _SIDE,
    ) -> None:
        require_count("side", side)
        require_positive("noise", noise, "")
        require_unmasked(response, spectra)
        self._response, self._spectra = (
            torch.as_tensor(one, dtype=torch.float64) for one in (response, spectra)
        )
        self._pattern, self._channels, self._noise = tuple(pattern), channels, noise
        self._scene = draw_dead_leaves(self._spectra, side, generator).to(torch.float32)
        random = torch.randn(side, side, generator=generator, dtype=torch.float64)
        self._disturbance = noise * random.to(torch.float32)

    def __call__(self, psfs: Any) -> float:
        """Rate PSFs, (bands, rows, columns), by the expected mean PSNR of the bands in dB."""
        require_unmasked(psfs)
        stack = torch.as_tensor(psfs, dtype=torch.float64)
        return (self.predicted_psnr(stack) + self.simulated_psnr(stack)) / 2

    def predicted_psnr(self, psfs: torch.Tensor) -> float:
        """Predict the mean PSNR in dB of the spectral bands of a Gaussian scene."""
        return predict_errors(
            psfs, self._response, self._pattern, self._spectra, self._noise, channels=self._channels
        ).mean_psnr

    @single_threaded
    @torch.no_grad()
    def simulated_psnr(self, psfs: torch.Tensor) -> float:
        """Measure the mean PSNR in dB of the spectral bands of the simulated scene, restored."""
        single = psfs.to(torch.float32)
        shape = self._scene.shape[1:]
        filters = filter_weights(self._pattern, self._response.float(), self._channels, shape)
        raw = SpectralMosaic(filters)(Blur(single, shape)(self._scene)) + self._disturbance
        seen = build_mosaic_observation(
            raw, self._pattern, single, channels=self._channels, response=self._response,
            noise=self._noise, border="periodic",
        )  # fmt: skip
        restored = restore_spectra(seen, self._spectra, iterations=_ITERATIONS, adapts=False)
        errors = (restored.image - self._scene).to(torch.float64).square().mean((1, 2))
        return -10 * float(errors.clamp(min=_LEAST_SQUARE).log10().mean())
