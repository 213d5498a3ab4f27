"""A photograph with its PSF, noise and pixel weights, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import torch

from optics.inverse.blur import Border, blur_shape, require_border, transfer_function
from optics.inverse.noise import PowerLaw, fit_power_law, mend_flat_noise
from optics.inverse.operator import squared_modulus
from optics.inverse.psf_origin import about_offset, light_offset, rms_radius, shifted_window
from optics.plane import centred_crop, centred_pad
from optics.validation import needs_gradient, require_finite, require_same_shape

# Root mean square radius of a wide PSF in pixels. Measured with six PSFs: from here on, twice the
# iterations add 0.1 to 0.7 dB where there is little noise.
_WIDE = 4.0

# Largest sum of a PSF. That of a star which is measured relative to another exceeds 1 by noise
# and by errors of the exposures.
_MOST_LIGHT = 1.25

LEAST_NOISE = 1e-6
"""Standard deviation of the rounding in single precision, relative to that of the photograph."""

MIN_EXPLAINED_SHARE = 3e-3
"""Smallest share of the data that a picture is taken to explain: its mean and coarsest features."""


@dataclass(frozen=True, eq=False)
class Observation:
    """A photograph with its PSF, noise, border and pixel weights.

    It states the problem that a restoration solves; `build_observation` makes one from arrays of
    any kind. If the PSF sums to less than 1, the restored scene is brighter than the photograph by
    the inverse of that sum.

    Parameters
    ----------
    image : torch.Tensor, (rows, columns)
        The photograph, in light per pixel, of a scene that `psf` has blurred.
    psf : torch.Tensor, (rows, columns)
        Point spread function, origin at n // 2. Its sum is the share of the light that arrives.
    given_noise : float, optional
        Standard deviation of a pixel of weight 1, in the image's unit; estimated if None.
    border : {"unknown", "dark", "periodic"}, default "unknown"
        What the scene does beyond the frame. "unknown" is right for photographs of a real scene.
    weights : torch.Tensor, (rows, columns), optional
        Weight of each pixel in the data term, relative to a pixel whose noise is `noise`; 0 where
        a pixel is dead. All 1 if None.
    clipped : torch.Tensor of bool, (rows, columns), optional
        True where the well was full: there the light is at least what was measured.
    is_numpy : bool, default False
        Whether the photograph was a numpy array, so that restore() returns one.
    least_noise : float, default 0
        Noise that is known to be there, for example of photons; an estimate isn't below it.
    variance : torch.Tensor, (rows, columns), optional
        Variance of each pixel from which `weights` were made: see `with_variance`. None where all
        have the same noise.
    offset : tuple of int, default (0, 0)
        Place of the restored picture's frame in the photograph's: see `with_centred_psf`.

    Raises
    ------
    ValueError
        If shapes don't fit or are empty, if a value isn't finite or is negative, if there is more
        noise than light, no light in the PSF or too much, another border, or no pixel to trust.
    """

    image: torch.Tensor
    psf: torch.Tensor
    given_noise: float | None = None
    border: Border = "unknown"
    weights: torch.Tensor | None = None
    clipped: torch.Tensor | None = None
    is_numpy: bool = False
    least_noise: float = 0.0
    variance: torch.Tensor | None = None
    offset: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        _require_sound(self)

    @property
    def psf_sum(self) -> float:
        """The share of the scene's light that reaches the sensor."""
        return float(self.psf.detach().sum(dtype=torch.float64))

    @property
    def _psf_light(self) -> float | torch.Tensor:
        """The PSF's sum, with its derivatives where the PSF's are recorded."""
        light = self.psf.detach().sum(dtype=torch.float64)
        return self.psf.sum() / light * self.psf_sum if self.psf.requires_grad else self.psf_sum

    @property
    def records_derivatives(self) -> bool:
        """Whether derivatives by the photograph, its PSF or weights are recorded."""
        given = map(needs_gradient, (self.image, self.psf, self.weights))
        return torch.is_grad_enabled() and any(given)

    @cached_property
    def effective_weights(self) -> torch.Tensor | None:
        """The pixel weights, 0 for clipped pixels; None if all are 1."""
        if self.clipped is None or not bool(self.clipped.any()):
            return self.weights
        sound = (~self.clipped).to(self.image)
        return sound if self.weights is None else self.weights * sound

    @property
    def is_fully_measured(self) -> bool:
        """Whether the photograph is a whole period, all with weight 1."""
        return self.period_shape == tuple(self.image.shape) and self.effective_weights is None

    @property
    def is_wide_beyond_frame(self) -> bool:
        """Whether the PSF is so wide that the scene beyond the frame is found slowly."""
        return self.border != "periodic" and self.psf_radius > _WIDE

    @cached_property
    def psf_offset(self) -> tuple[int, int]:
        """The (rows, columns) by which the PSF's light lies off its origin."""
        return light_offset(self.psf)

    def with_centred_psf(self) -> Self:
        """Return the problem with the PSF's light about its origin, and the picture's frame for it.

        A PSF whose derivatives are recorded stays, since each of its pixels counts.
        """
        if self.psf_offset == (0, 0) or self.psf.requires_grad:
            return self
        return replace(self, psf=about_offset(self.psf, self.psf_offset), offset=self.psf_offset)

    @cached_property
    def psf_radius(self) -> float:
        """The root mean square radius of the PSF about its centroid, in pixels."""
        return rms_radius(self.psf)

    @cached_property
    def unit(self) -> float:
        """The power of two below the photograph's brightest pixel, or else below its told noise."""
        light = float(self.image.detach().abs().max()) or self.given_noise or self.least_noise
        return math.ldexp(1.0, math.frexp(light)[1] - 1) if light else 1.0

    @cached_property
    def in_own_unit(self) -> Self:
        """The same problem with the photograph's brightest pixel from 1 to 2.

        Whatever the light's unit, its squares are within single precision there, and what is small
        is small relative to the picture. A power of two changes no digit.
        """
        unit, noise, variance = self.unit, self.given_noise, self.variance
        if unit == 1:
            return self
        if variance is not None:
            variance = (variance.to(torch.float64) / unit / unit).to(self.image)
        noise, least = None if noise is None else noise / unit, self.least_noise / unit
        image = self.image / unit
        return replace(self, image=image, given_noise=noise, least_noise=least, variance=variance)

    @cached_property
    def period_shape(self) -> tuple[int, int]:
        """The (rows, columns) of the period."""
        if self.border == "periodic":
            return self.image.shape[0], self.image.shape[1]
        return blur_shape(self.image.shape, self.psf.shape)

    @cached_property
    def otf(self) -> torch.Tensor:
        """The OTF of the normalised PSF on the period, complex."""
        return transfer_function(self.psf / self._psf_light, self.period_shape)

    @cached_property
    def scale(self) -> float:
        """The scale of the scene's light, which sets thresholds and weights.

        It is the standard deviation, but at least 1e-3 of the mean; 1 for a dark photograph.
        """
        # 128 rows are enough. Every n-th one, with an odd n, sees all rows of a mosaic.
        image = self.image.detach()[:: max(1, len(self.image) >> 7) | 1].to(torch.float64)
        spread = max(float(image.std(correction=0)), 1e-3 * float(image.abs().mean()))
        return spread / self.psf_sum if spread > 0 else 1.0

    @cached_property
    def squared_mtf(self) -> torch.Tensor:
        """The squared MTF ``|H|²`` on the period."""
        return squared_modulus(self.otf)

    @cached_property
    def conjugate_otf(self) -> torch.Tensor:
        """The complex conjugate H* of the OTF on the period."""
        return self.otf.conj().resolve_conj()

    @cached_property
    def power_law(self) -> PowerLaw:
        """The power law and noise of the photograph's spectrum, in its unit squared."""
        if self.unit == 1:
            return self._fitted_power_law()
        law, square = self.in_own_unit.power_law, self.unit * self.unit
        variances = law.noise_variance * square, law.model_error_variance * square
        return PowerLaw(law.strength * square, law.slope, *variances)

    @torch.no_grad()
    def _fitted_power_law(self) -> PowerLaw:
        """Fit the power law to the middle of the photograph."""
        trust, centre = self.effective_weights, self.centre
        squared_mtf = self._squared_mtf_on((centre.shape[0], centre.shape[1]))
        is_whole = trust is None or bool((trust > 0).all())
        law = fit_power_law(centre, squared_mtf, finds_model_error=is_whole)
        return mend_flat_noise(law, centre)

    @property
    def centre(self) -> torch.Tensor:
        """The middle of the photograph, 512 pixels or four PSFs, whose spectrum is fitted."""
        (rows, columns), (m, n) = self.image.shape, self.psf.shape
        shape = min(rows, max(512, 4 * m)), min(columns, max(512, 4 * n))
        return centred_crop(self.inpainted_image.detach(), shape) * self.psf_sum

    @property
    def squared_mtf_of_centre(self) -> tuple[torch.Tensor, tuple[int, int]]:
        """The squared MTF on the rfft2 grid of the photograph's middle, and the middle's shape."""
        rows, columns = self.centre.shape
        return self._squared_mtf_on((rows, columns)), (rows, columns)

    def _squared_mtf_on(self, shape: tuple[int, int]) -> torch.Tensor:
        """Compute the squared MTF ``|H|²`` on a period of the given shape."""
        return squared_modulus(transfer_function(self.psf / self.psf_sum, shape))

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a pixel of weight 1, given or estimated, in the image's unit."""
        if self.given_noise is not None:
            return self.given_noise
        return max(math.sqrt(self.power_law.noise_variance), self.least_noise)

    @property
    def scene_noise(self) -> float:
        """The noise divided by the sum of the PSF, but not below the rounding error."""
        return max(self.noise / self.psf_sum, LEAST_NOISE * self.scale)

    @cached_property
    def disturbance(self) -> float:
        """The noise against which a prior is weighed, with the PSF's error, on the scene's scale.

        See `PowerLaw.model_error_variance`. A residual is relative to `scene_noise` instead.
        """
        error = self.power_law.model_error_variance / self.psf_sum**2
        return math.hypot(self.scene_noise, math.sqrt(error))

    def explained_share(self, mean_squared_residual: float) -> float:
        """Return the share of the data that a picture with such a residual explains, above 0."""
        # Noise that is told a little too small would leave nothing explained.
        estimated = self.power_law.total_variance / self.psf_sum**2
        left = mean_squared_residual * self.scene_noise**2 / max(self.disturbance**2, estimated)
        return max(1 - left, MIN_EXPLAINED_SHARE)

    @cached_property
    def normalised_image(self) -> torch.Tensor:
        """The photograph divided by the sum of the PSF, on the scale of the scene's light."""
        return self.image / self._psf_light

    @cached_property
    def inpainted_image(self) -> torch.Tensor:
        """The normalised photograph, with pixels of weight 0 filled in from their neighbours."""
        if self.effective_weights is None:
            return self.normalised_image
        known, image = self.effective_weights > 0, self.normalised_image
        return image if bool(known.all()) else _inpaint(image, known)

    @cached_property
    def extended_image(self) -> torch.Tensor:
        """The inpainted photograph, extended smoothly to the period, or by zeros if it's dark."""
        extend = centred_pad if self.border == "dark" else extend_periodically
        return extend(self.inpainted_image, self.period_shape)

    @cached_property
    def support(self) -> torch.Tensor | None:
        """1 on the period where the scene may have light, else 0; None if it may everywhere."""
        whole = torch.ones_like(self.image)
        return centred_pad(whole, self.period_shape) if self.border == "dark" else None

    def crop_to_frame(self, period_image: torch.Tensor) -> torch.Tensor:
        """Crop a picture on the whole period to the photograph's frame, as a view."""
        return centred_crop(period_image, self.image.shape)

    def crop_to_picture(self, period_image: torch.Tensor) -> torch.Tensor:
        """Crop a picture on the period to its own frame, beyond which it goes on as at its edge."""
        if self.offset == (0, 0):
            return self.crop_to_frame(period_image)
        wraps = self.border == "periodic"
        return shifted_window(period_image, self.offset, self.image.shape, wraps)

    @property
    def bands(self) -> int:
        """The number of the scene's bands."""
        return 1

    @property
    def relative_filters(self) -> torch.Tensor | None:
        """The transmissions of a mosaic of filters over their norm; None without filters."""
        return None

    @property
    def channels(self) -> tuple[Observation, torch.Tensor]:
        """The photograph as one of each channel's light, and how bands mix into it.

        The mixing is (channels, bands). Of many bands, the channels' light is split off.
        """
        return self, torch.eye(self.bands, dtype=torch.float64)

    def sum_bands(self, light: torch.Tensor) -> torch.Tensor:
        """Return what the sensor measures of the bands' light in the frame, (1, rows, columns)."""
        filters = self.relative_filters
        return light if filters is None else (filters * light).sum(0, keepdim=True)

    def spread_to_bands(self, frame: torch.Tensor) -> torch.Tensor:
        """Apply the adjoint of sum_bands() to a picture in the frame."""
        return frame if self.relative_filters is None else self.relative_filters * frame

    @torch.no_grad()
    def mean_squared_residual(self, light: torch.Tensor) -> float:
        """Compute the mean squared residual of pixels with a weight, over the noise variance.

        The residual is the normalised photograph less `light`, a blurred picture on the period.
        """
        squares = (self.sum_bands(self.crop_to_frame(light)) - self.normalised_image).square_()
        trust = self.effective_weights
        mean = squares.mean() if trust is None else squares.mul_(trust).sum() / (trust > 0).sum()
        return float(mean) / self.scene_noise**2


def _require_sound(seen: Observation) -> None:
    """Raise ValueError for a photograph that can't be restored: see Observation."""
    shapes = f"image is {tuple(seen.image.shape)} and psf {tuple(seen.psf.shape)}"
    if seen.image.ndim != 2 or seen.psf.ndim != 2:
        raise ValueError(f"{shapes}; both are (rows, columns)")
    if not seen.image.numel() or not seen.psf.numel():
        raise ValueError(f"{shapes}; both need at least one pixel")
    require_psf(seen.psf)
    share, noise = float(seen.psf.detach().sum()), seen.given_noise
    if share > _MOST_LIGHT:
        raise ValueError(
            f"psf sums to {share:g}; the sum is the share of the scene's light that arrives, "
            "at most 1: divide the PSF by its sum"
        )
    require_border(seen.border)
    if noise is not None and not (noise >= 0 and math.isfinite(noise)):
        raise ValueError(f"noise is {noise:g}; it must be finite, and not negative")
    require_same_shape(
        "image", seen.image,
        weights=seen.weights, clipped=seen.clipped, variance=seen.variance,
    )  # fmt: skip
    if seen.weights is not None:
        require_weights(seen.weights)
    require_finite("image", seen.image)
    brightest = float(seen.image.detach().abs().max())
    if noise is not None and noise > brightest > 0:
        raise ValueError(
            f"noise is {noise:g}, and the photograph's largest pixel {brightest:g}; give the "
            "standard deviation of a pixel in the photograph's unit, or leave it out"
        )
    if seen.effective_weights is not None and not bool(seen.effective_weights.any()):
        raise ValueError("every pixel is clipped or has no weight; nothing was measured")


def require_weights(weights: torch.Tensor) -> None:
    """Raise ValueError for weights that are negative, all zero or not finite."""
    require_finite("weights", weights)
    if bool((weights < 0).any()) or not bool((weights > 0).any()):
        raise ValueError("weights must be positive somewhere, and negative nowhere")


def require_psf(psf: torch.Tensor) -> None:
    """Raise ValueError for a PSF that isn't finite or has no positive sum."""
    if not torch.isfinite(psf).all():
        raise ValueError("psf has NaN or infinite values; measure or compute it again")
    light = float(psf.detach().sum())
    if not light > 0:
        raise ValueError(f"psf sums to {light:g}; it must send light somewhere")


def _inpaint(image: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    """Fill invalid pixels with the mean of the nearest valid ones."""
    value = torch.where(valid, image, 0.0)[None, None]
    share = valid.to(image)[None, None]
    answer, missing = value.clone(), share == 0
    pool: Callable[..., torch.Tensor] = torch.nn.functional.avg_pool2d
    while bool(missing.any()):
        value, share = (pool(one, 3, 1, 1) for one in (value, share))
        found = missing & (share > 1e-12)
        answer[found] = value[found] / share[found]
        missing &= ~found
        if not bool(found.any()):
            # Some 25 pixels deep in a gap, too little arrives: what is filled counts as valid.
            value, share = torch.where(missing, 0.0, answer), (~missing).to(image)
    return answer[0, 0]


def extend_periodically(image: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Extend a photograph smoothly to the period `shape`, as FFTs need it.

    The picture is mirrored at each edge. Across the gap, the mirrored parts of two opposite edges
    are blended into each other by a raised cosine, so that opposite edges meet smoothly.
    """
    whole = centred_pad(image, shape)
    for dim in (-1, -2):
        n, length = image.shape[dim], shape[dim]
        gap, first = length - n, length // 2 - n // 2
        if gap == 0:
            continue
        step = torch.arange(gap)
        ramp = (0.5 * (1 + torch.cos(torch.pi * (step + 1) / (gap + 1)))).to(whole)
        period = max(2 * n - 2, 1)
        beyond = torch.stack([n + step, step - gap]) % period
        after, before = first + torch.where(beyond < n, beyond, period - beyond)
        filling = torch.lerp(
            whole.index_select(dim, before),
            whole.index_select(dim, after),
            ramp if dim == -1 else ramp[:, None],
        )
        end = gap - first
        whole.narrow(dim, first + n, end).copy_(filling.narrow(dim, 0, end))
        whole.narrow(dim, 0, first).copy_(filling.narrow(dim, end, first))
    return whole
