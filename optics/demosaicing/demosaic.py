"""The entry point of demosaicing, which checks its arguments and calls the chosen method."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import torch

from optics.demosaicing.joint_demosaicing import demosaic_with_prior
from optics.demosaicing.mosaic_builder import (
    build_mosaic_observation,
    validate_pattern,
    validate_raw,
)
from optics.demosaicing.opencv_interpolation import INTERPOLATIONS, interpolate_bayer
from optics.progress import Progress
from optics.validation import (
    accepts_numpy,
    require_count,
    require_positive,
)

Method = Literal["prior", "bilinear", "edge-aware", "vng"]

METHODS: tuple[Method, ...] = ("prior", *INTERPOLATIONS)


@accepts_numpy
def demosaic(
    raw: torch.Tensor,
    pattern: Sequence[str],
    method: Method = "prior",
    *,
    channels: str = "RGB",
    response: torch.Tensor | None = None,
    noise: float | None = None,
    psf: torch.Tensor | None = None,
    weights: torch.Tensor | None = None,
    clipped: torch.Tensor | None = None,
    weight: float | None = None,
    iterations: int = 30,
    progress: Progress | None = None,
) -> torch.Tensor:
    """Demosaic a raw picture: estimate all colours of each pixel of a mosaic of colour filters.

    The method "prior" solves Eq. 4.7 of the thesis with a prior that penalises the curvature of
    the brightness, and that of colour differences more. The other methods are
    those of OpenCV, for the Bayer pattern only; of the optional arguments they accept only
    `channels`. The prior assumes that all bands of a white surface are equal: for channels that
    aren't balanced, give ``diag(gains)`` as `response`.

    Parameters
    ----------
    raw : torch.Tensor or numpy.ndarray, (rows, columns)
        Light of each pixel less the dark level, of a frame of any size.
    pattern : sequence of str
        Rows of one letter per pixel that repeat from the first pixel on, as ``("RG", "GB")``.
    method : {"prior", "bilinear", "edge-aware", "vng"}, default "prior"
        Method of demosaicing, one of `METHODS`.
    channels : str, default "RGB"
        Letters of the channels. Without a response each channel is a band, in this order.
    response : torch.Tensor or numpy.ndarray, (channels, bands), optional
        Share of each band that the filter of each letter transmits; the identity if None.
    noise : float, optional
        Standard deviation of a pixel, in the unit of `raw`. Estimated if None.
    psf : torch.Tensor or numpy.ndarray, optional
        PSF of the lens, (rows, columns), or (bands, rows, columns) for one per band; no blur if
        None.
    weights : torch.Tensor or numpy.ndarray, (rows, columns), optional
        Weight of each pixel in the data term; 0 where a pixel is dead.
    clipped : torch.Tensor or numpy.ndarray of bool, (rows, columns), optional
        True where the well was full: there the light is at least what was measured.
    weight : float, optional
        Regularisation weight of the prior. Chosen from the noise and the scale of the light if
        None.
    iterations : int, default 30
        Number of iterations, 1 or more.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    torch.Tensor or numpy.ndarray, (bands, rows, columns)
        Light of each band. Noise may make it negative in dark places.

    Raises
    ------
    ValueError
        If an argument has the wrong shape or isn't finite, if the method doesn't accept it, or if
        no pixel sees one of the bands.
    """
    rows, raw = validate_pattern(pattern, channels), validate_raw(raw)
    if method not in METHODS:
        raise ValueError(f"method is {method!r}; take one of {', '.join(METHODS)}")
    if method != "prior":
        names = ("response", "psf", "weights", "clipped", "weight")
        told = (response, psf, weights, clipped, weight)
        given = [name for name, value in zip(names, told, strict=True) if value is not None]
        if given:
            raise ValueError(f"method {method!r} takes no {', '.join(given)}; take 'prior'")
        return interpolate_bayer(raw, rows, method)[["RGB".index(letter) for letter in channels]]
    if weight is not None:
        require_positive("weight", weight, "")
    require_count("iterations", iterations)
    seen = build_mosaic_observation(
        raw, rows, psf, channels=channels, response=response, noise=noise,
        weights=weights, clipped=clipped,
    )  # fmt: skip
    found = demosaic_with_prior(seen, weight, iterations=iterations, progress=progress)
    # The restored image is cut at 0, which would brighten what is dark on the mean.
    return seen.crop_to_frame(found.period_image).reshape(seen.bands, *raw.shape).clone()
