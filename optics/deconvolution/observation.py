"""A photograph, the blur in it, and what is known of its pixels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch

from optics.deconvolution.border import extend_periodically
from optics.deconvolution.noise import PowerLaw, WienerPrediction, fit_power_law, squared_modulus
from optics.operators.blur import Border, blur_shape, require_border, transfer_function
from optics.plane import centred_crop, centred_pad
from optics.validation import require_finite, require_same_shape

LEAST_NOISE = 1e-6
"""Standard deviation, relative to the photograph's own: what single precision leaves."""

_SCALE_ROWS_LOG2 = 7
"""Binary digits of the number of rows from which lengths are taken, at least."""

_CENTRE_SIDE, _CENTRE_PSF_SIDES = 512, 4
"""Pixels of a photograph's side whose spectrum tells enough of it, or so many sides of the PSF."""


@dataclass(frozen=True, eq=False)
class Observation:
    """A photograph, the PSF that blurred the scene, and what is known of each pixel.

    It states the problem that a restoration solves. `build_observation` makes one from arrays of
    any kind. Where the PSF sums to less than 1, the missing light doesn't arrive, and the restored
    scene is that much brighter than the photograph.

    Parameters
    ----------
    image : torch.Tensor, (rows, columns)
        What the camera measured, light per pixel, of a scene that `psf` has blurred.
    psf : torch.Tensor, (rows, columns)
        Point spread function with its origin at n // 2. Its sum is the share of light that arrives.
    given_noise : float, optional
        Standard deviation of a pixel of weight 1, in the image's unit. Estimated from the
        photograph if None.
    border : {"unknown", "dark", "periodic"}, default "unknown"
        What the scene does beyond the frame. "unknown" is right for what a camera sees.
    weights : torch.Tensor, (rows, columns), optional
        How much each pixel is to be trusted: the inverse of its variance, relative to noise²; 0
        where it is dead. All 1 if None.
    clipped : torch.Tensor of bool, (rows, columns), optional
        True where the well was full: there the light is at least what was measured.

    Raises
    ------
    ValueError
        If shapes don't fit, a value isn't finite, the noise or a weight is negative, the PSF sends
        no light anywhere, `border` is another word, or no pixel is left that measured anything.
    """

    image: torch.Tensor
    psf: torch.Tensor
    given_noise: float | None = None
    border: Border = "unknown"
    weights: torch.Tensor | None = None
    clipped: torch.Tensor | None = None

    def __post_init__(self) -> None:
        if self.image.ndim != 2 or self.psf.ndim != 2:
            raise ValueError(
                f"image is {tuple(self.image.shape)} and psf {tuple(self.psf.shape)}; both are "
                "(rows, columns)"
            )
        require_psf(self.psf)
        require_border(self.border)
        if self.given_noise is not None and not (
            self.given_noise >= 0 and math.isfinite(self.given_noise)
        ):
            raise ValueError(f"noise is {self.given_noise:g}; it must be finite, and not negative")
        require_same_shape("image", self.image, weights=self.weights, clipped=self.clipped)
        if self.weights is not None:
            require_weights(self.weights)
        require_finite("image", self.image)
        if self.effective_weights is not None and not bool(self.effective_weights.any()):
            raise ValueError("every pixel is clipped or has no weight; nothing was measured")

    @property
    def psf_sum(self) -> float:
        """Share of the scene's light that arrives: the sum of the PSF."""
        return float(self.psf.sum(dtype=torch.float64))

    @cached_property
    def effective_weights(self) -> torch.Tensor | None:
        """Weights, with 0 for each clipped pixel; None where all are 1."""
        if self.clipped is None or not bool(self.clipped.any()):
            return self.weights
        sound = (~self.clipped).to(self.image)
        return sound if self.weights is None else self.weights * sound

    @property
    def is_fully_measured(self) -> bool:
        """Whether the whole period was measured, and each of its pixels counts fully."""
        return self.border == "periodic" and self.effective_weights is None

    @cached_property
    def period_shape(self) -> tuple[int, int]:
        """Shape (rows, columns) of the period on which the scene is estimated."""
        rows, columns = self.image.shape
        frame = rows, columns
        return frame if self.border == "periodic" else blur_shape(frame, self.psf.shape)

    @cached_property
    def otf(self) -> torch.Tensor:
        """Optical transfer function of the PSF with a sum of 1, on the period; complex."""
        return transfer_function(self.psf / self.psf_sum, self.period_shape)

    @cached_property
    def scale(self) -> float:
        """Scale of the scene's light, by which lengths and weights are chosen.

        It is the photograph's standard deviation, or a share of its mean where the photograph is
        even, on the scene's scale; 1 where nothing shines.
        """
        image = self.image.detach()[:: max(1, len(self.image) >> _SCALE_ROWS_LOG2)].to(
            torch.float64
        )
        spread = max(float(image.std(correction=0)), 1e-3 * float(image.abs().mean()))
        return spread / self.psf_sum if spread > 0 else 1.0

    @cached_property
    def squared_mtf(self) -> torch.Tensor:
        """Squared modulation transfer function |H|² on the period."""
        return squared_modulus(self.otf)

    @cached_property
    def conjugate_otf(self) -> torch.Tensor:
        """Complex conjugate H* of the transfer function on the period."""
        return self.otf.conj().resolve_conj()

    @cached_property
    def power_law(self) -> PowerLaw:
        """Power law and noise of the spectrum of the photograph's middle, on its own scale."""
        rows, columns = self._centre_shape
        middle = centred_crop(self.inpainted_image, (rows, columns)) * self.psf_sum
        return fit_power_law(middle, self.psf / self.psf_sum)

    @property
    def wiener_prediction(self) -> WienerPrediction:
        """What the best linear filter is predicted to recover, by that power law."""
        return self.power_law.wiener_prediction(
            self._squared_mtf_on(self._centre_shape), self._centre_shape
        )

    def _squared_mtf_on(self, shape: tuple[int, int]) -> torch.Tensor:
        """|H|² on a period of that shape."""
        return squared_modulus(transfer_function(self.psf / self.psf_sum, shape))

    @property
    def _centre_shape(self) -> tuple[int, int]:
        rows, columns = (
            min(n, max(_CENTRE_SIDE, _CENTRE_PSF_SIDES * m))
            for n, m in zip(self.image.shape, self.psf.shape, strict=True)
        )
        return rows, columns

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a pixel of weight 1, given or estimated, in the image's unit."""
        return (
            math.sqrt(self.power_law.noise_variance)
            if self.given_noise is None
            else self.given_noise
        )

    @property
    def scene_noise(self) -> float:
        """Noise on the scene's scale, no less than what rounding leaves."""
        return max(self.noise / self.psf_sum, LEAST_NOISE * self.scale)

    @cached_property
    def normalised_image(self) -> torch.Tensor:
        """The photograph on the scene's scale: divided by the sum of the PSF."""
        return self.image / self.psf_sum

    @cached_property
    def inpainted_image(self) -> torch.Tensor:
        """The normalised photograph, with untrusted pixels filled in from their neighbours."""
        if self.effective_weights is None:
            return self.normalised_image
        known = self.effective_weights > 0
        return (
            self.normalised_image if bool(known.all()) else _inpaint(self.normalised_image, known)
        )

    @cached_property
    def extended_image(self) -> torch.Tensor:
        """The inpainted photograph continued to the whole period, so that opposite edges meet
        smoothly.

        With a dark border, zeros are put around it instead.
        """
        if self.border == "dark":
            return centred_pad(self.inpainted_image, self.period_shape)
        return extend_periodically(self.inpainted_image, self.period_shape)

    @cached_property
    def support(self) -> torch.Tensor | None:
        """Mask of the period: 1 where the scene may shine; None where that is everywhere."""
        if self.border != "dark":
            return None
        return centred_pad(torch.ones_like(self.image), self.period_shape)

    def crop_to_frame(self, period_image: torch.Tensor) -> torch.Tensor:
        """Crop a picture on the whole period to what the camera sees; a view."""
        return centred_crop(period_image, self.image.shape)

    @torch.no_grad()
    def mean_squared_residual(self, light: torch.Tensor) -> float:
        """Mean squared residual of trusted pixels, over the noise variance.

        The residual is the normalised photograph less `light`, the blurred picture on the whole
        period.
        """
        squares = (self.crop_to_frame(light) - self.normalised_image).square_()
        if self.effective_weights is None:
            mean = float(squares.mean())
        else:
            mean = float(
                squares.mul_(self.effective_weights).sum() / (self.effective_weights > 0).sum()
            )
        return mean / self.scene_noise**2


def require_weights(weights: torch.Tensor) -> None:
    require_finite("weights", weights)
    if float(weights.min()) < 0 or not float(weights.max()) > 0:
        raise ValueError("weights must be positive somewhere, and negative nowhere")


def require_psf(psf: torch.Tensor) -> None:
    """Raise ValueError for a PSF that no deconvolution can use."""
    if not torch.isfinite(psf).all():
        raise ValueError("psf has NaN or infinite values; measure or compute it again")
    if not float(psf.sum()) > 0:
        raise ValueError(f"psf sums to {float(psf.sum()):g}; it must send light somewhere")


def _inpaint(image: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    """Unknown pixels by the mean of known ones around them, from ever farther away."""
    value = torch.where(valid, image, 0.0)[None, None]
    share = valid.to(image)[None, None]
    answer, missing = value.clone(), share == 0
    pool: Callable[..., torch.Tensor] = torch.nn.functional.avg_pool2d
    while bool(missing.any()):
        value, share = (pool(one, 3, 1, 1) for one in (value, share))
        found = missing & (share > 1e-12)
        answer[found] = value[found] / share[found]
        missing &= ~found
    return answer[0, 0]
