"""Bound what any pattern can reach over a range of depths, with a linear filter or the depth known.

A pupil P of modulus 1 at most, in focus at D0, has for an object at the depth D (in dioptres) the
OTF at the pupil shift s = wavelength x image distance x frequency

    H(s, D) = (1 / A) integral of P(p + s / 2) P*(p - s / 2) exp(2 pi i e p.s / wavelength) dp,

where e = D - D0, and A is the light of the open pupil. The defocus phases
pi / wavelength e |p +- s / 2|² leave the difference 2 pi e p.s / wavelength, which changes along s
only. With t the position along s, and g(t) the integral of P(p + s / 2) P*(p - s / 2) across s,

    H = (1 / A) integral of g(t) exp(2 pi i e |s| t / wavelength) dt.

It is a Fourier transform from t to e |s| / wavelength, and by Parseval's theorem

    integral over all D of |H|² dD = wavelength / (|s| A²) integral of |g(t)|² dt.

|g(t)| is at most the width w(t) of the overlap of the shifted pupils. So over a range R of
dioptres, whatever the pattern, the mean of |H|² is at most

    wavelength / (|s| R A²) integral of w(t)² dt.

It is also at most the square of the OTF in focus without a pattern, the overlap's area over A.

The sensor's samples fold all orders f + m, with m whole cycles per pixel, onto the frequency f. The
root mean square over depth of the sum of the orders is at most the sum of their root mean squares
(Minkowski's inequality).

For known depth, the error S sigma² / (S |H|² + sigma²) is convex in |H|² and falls with it. By
Jensen's inequality its mean over depth is at least its value at the mean of |H|², and hence at the
limit of that. Restoration that doesn't know the depth can't do better.

The bound is proved for patterns on the panel or masks in its plane, of any phase and of any
modulus up to 1, for paraxial optics of one wavelength without aberrations, for depths that are
uniform over a *continuous* range of dioptres, for restoration by linear filters, and for the mean
over pictures of the squared error, with the power spectrum given. It doesn't hold for a few
discrete depths, for single pictures, or for non-linear restoration.

References
----------
A. Levin et al., ACM Trans. Graph. 28(3), 97, 2009, doi 10.1145/1531326.1531403, who bound the power
over a "focal manifold" in the same way; J. W. Goodman, Introduction to Fourier Optics, chapter 6.
"""

from __future__ import annotations

import math

import torch

from optics.camera import Camera
from optics.camera.pupil import pupil_amplitude, require_valid_source
from optics.edof.dioptres import DEPTH_RANGE, require_depth_range
from optics.edof.frequency_grid import FrequencyGrid
from optics.edof.picture_spectrum import averaging_transfer
from optics.edof.pupil_overlap import ConvexPupil, Rule, convex_pupil, overlap_integrals
from optics.edof.spectral_criterion import error_level, noise_variance
from optics.validation import accepts_numpy, as_number, require_count


def rms_transfer_limit(
    camera: Camera,
    wavelength: float,
    grid: FrequencyGrid,
    *,
    depth_range: tuple[float, float] = DEPTH_RANGE,
    binning: int = 1,
    folded: bool = True,
    nodes: int = 100,
    rule: Rule = "gauss-legendre",
) -> torch.Tensor:
    """Compute the largest root mean square over depth of the OTF that any pattern can have.

    Parameters
    ----------
    camera : Camera
        The camera; its panel stands at the lens, which has no aberrations and a convex stop.
    wavelength : float
        Metres.
    grid : FrequencyGrid
        The frequencies, in cycles per (binned) pixel.
    depth_range : tuple of (float, float), optional
        Farthest and nearest depth in dioptres.
    binning : int, optional
        Sensor pixels along each side of the squares that are averaged into a pixel. The scene is
        taken to be constant within such a square.
    folded : bool, optional
        Whether all orders that the samples fold onto a frequency count, which the bound needs (the
        default). Without them the limit is that of the optics before sampling.
    nodes, rule
        The quadrature; see `overlap_integrals`.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Limit of the root mean square of the OTF, relative to the light of the open pupil.

    Raises
    ------
    ValueError
        If the camera isn't one that this model covers, or a number is out of range.
    """
    require_valid_source(math.inf, wavelength)
    require_depth_range(depth_range)
    require_count("binning", binning)
    _require_bounded(camera)
    pupil = convex_pupil(camera)
    light = float(pupil_amplitude(camera).sum()) * camera.panel.pitch**2
    # Metres of pupil shift per cycle per binned pixel.
    shift = wavelength * as_number(camera.lens.image_distance) / camera.sensor.pitch / binning
    focal_spread = wavelength / (depth_range[1] - depth_range[0])
    total = torch.zeros(grid.shape, dtype=torch.float64)
    fy, fx = grid.frequencies()
    for my in _orders(pupil, 0, shift, folded):
        for mx in _orders(pupil, 1, shift, folded):
            oy, ox = (f.expand(grid.shape).flatten() for f in (fy + my, fx + mx))
            box = averaging_transfer(oy / binning, binning) * averaging_transfer(
                ox / binning, binning
            )
            area, square = overlap_integrals(pupil, oy * shift, ox * shift, nodes=nodes, rule=rule)
            length = torch.hypot(oy, ox) * shift
            in_focus = (area / light) ** 2
            safe = torch.where(length > 0, length, torch.ones_like(length))
            spread = torch.where(length > 0, focal_spread * square / (safe * light**2), 1.0)
            limit = torch.minimum(spread, in_focus.clamp(max=1.0)).sqrt()
            total += (limit * box**2).reshape(grid.shape)
    return total.clamp(max=1.0)


@accepts_numpy
def known_depth_bound(
    limit: torch.Tensor, spectrum: torch.Tensor, shares: torch.Tensor, noise: float
) -> float:
    """Compute the highest expected PSNR in dB that any pattern and linear restoration can reach.

    Parameters
    ----------
    limit : torch.Tensor, (rows, columns)
        From `rms_transfer_limit`.
    spectrum, shares : torch.Tensor, (rows, columns)
        Power spectrum of the pictures, and the frequencies' shares, as in `known_depth_error`.
    noise : float
        Standard deviation of a pixel's noise, where white is the light of the open pupil.

    Returns
    -------
    float
        PSNR in dB, of the mean squared error over pictures and depths. It bounds restoration with
        the depth known, and so also without.

    Raises
    ------
    ValueError
        If shapes don't fit or the noise is out of range.
    """
    if limit.shape != spectrum.shape or limit.shape != shares.shape:
        raise ValueError(
            f"limit is {tuple(limit.shape)}, spectrum {tuple(spectrum.shape)} and shares "
            f"{tuple(shares.shape)}; they must be on the same frequencies"
        )
    variance, spectrum = noise_variance(noise), spectrum.double()
    return error_level((shares * spectrum * variance / (spectrum * limit**2 + variance)).sum())


def _orders(pupil: ConvexPupil, axis: int, shift: float, folded: bool) -> range:
    """Return the orders along an axis, in cycles per pixel, in which a pupil passes light."""
    if not folded:
        return range(1)
    cutoff = sum(pupil.offsets[2 * axis : 2 * axis + 2]) / shift
    most = math.floor(cutoff + 0.5)
    return range(-most, most + 1)


def _require_bounded(camera: Camera) -> None:
    """Raise ValueError for a camera whose depth of field this bound isn't derived for."""
    if not camera.lens.has_quadratic_phase:
        raise ValueError("camera.lens has aberrations or isn't thin; the bound is for a thin lens")
    if as_number(camera.separation):
        raise ValueError(
            f"camera.separation is {as_number(camera.separation):g} m; the bound is for a panel "
            "at the lens: set 0"
        )
