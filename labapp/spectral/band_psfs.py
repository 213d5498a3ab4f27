"""PSFs of the bands of a coded snapshot, from the star of a record.

All PSFs are cut out around one pixel, and moved by what is left to the middle of the neutral star
of their band. Bands then lie where the neutral pictures have them. A common shift of all PSFs only
moves the restored cube, and can't be seen in the photograph.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift as shift_picture
from scipy.ndimage import uniform_filter

from labapp.common.errors import UserError
from labapp.files.plan_file import Reconstruction
from labapp.files.wavelengths import format_nanometres
from labapp.pictures.analysis.brackets import WAVELENGTH_TOLERANCE, Bracket, find_bracket
from labapp.pictures.analysis.colour_filters import described_filters
from labapp.pictures.analysis.star_psf import bright_centroid, crop_centred
from labapp.runs.record.reader import Record
from labapp.spectral.band_response import mosaic_of
from labapp.spectral.snapshot import recorded_wavelengths
from labapp.spectral.star_spot import StarSpot, fit_star_spot

Picture = NDArray[np.float64]

# Pixels from which a PSF is moved to its star's middle. Chosen: moving interpolates, which costs
# sharpness, and stars through colour filters show no twentieth of a pixel.
_LEAST_SHIFT = 0.05

_SIGNIFICANCE = 3.0  # standard deviations from which a band's star counts as beside the others
_MOST_SHARE = 1.25  # light of a coded star over the neutral one's that is still taken for noise
_UNSURE = 0.5  # pixels; standard deviation of a star's place from which the user is told
_MARGIN = 8  # pixels around a PSF's window that help to interpolate colours at its border

SHIFT_NOTE = "a common shift of all PSFs only moves the cube; it can't be seen in the photograph"


@dataclass(frozen=True, eq=False)
class BandPSFs:
    """One PSF for each band, and the star's light in it.

    psfs: (bands, rows, columns), origin at n // 2.
    light: (bands,), electrons per second behind the filter that sees most of the band; None where
        the star isn't of the snapshot's own run.
    spots: neutral star of each band; None where it couldn't be found.
    notes: remarks for the user.
    knows_share: whether the PSFs are shares of the neutral star's light, as a sensor without
        filters shows it. Otherwise each sums to 1.
    """

    psfs: Picture
    light: NDArray[np.float64] | None
    spots: tuple[StarSpot | None, ...] = ()
    notes: tuple[str, ...] = ()
    knows_share: bool = False

    def with_light_share(self, share: NDArray[np.float64] | None) -> BandPSFs:
        """Scale PSFs that sum to 1 each by the share of light that they pass.

        `share` is (bands,), relative to the neutral pattern; None where it isn't known. The star's
        light becomes that of the neutral star. PSFs that know their share stay as they are.
        """
        if share is None or self.knows_share:
            return self
        light = None if self.light is None else self.light / share
        return replace(self, psfs=self.psfs * share[:, None, None], light=light)

    def with_unit_sums(self) -> BandPSFs:
        """Return the PSFs, scaled so that each sums to 1."""
        psfs = self.psfs / self.psfs.sum((1, 2), keepdims=True)
        return replace(self, psfs=psfs, knows_share=False)


def measure_band_psfs(
    record: Record, brackets: list[Bracket], roles: Reconstruction, wavelengths: Sequence[float]
) -> BandPSFs:
    """Measure one PSF for each band (metres) on a record's star, from its merged pictures.

    Raises UserError if the star is missing or dark in a band, or much brighter coded than neutral.
    """

    def stars(pattern: str) -> list[Bracket]:
        path = record.path
        return [find_bracket(brackets, roles.star, pattern, one, path) for one in wavelengths]

    coded, neutral = stars(roles.coded), None
    if roles.neutral != roles.coded and record.select(target=roles.star, pattern=roles.neutral):
        neutral = stars(roles.neutral)
    gains = [_sensitivity(record, one) for one in coded]
    near = _brightest_pixel(neutral or coded, gains)
    spots: list[StarSpot | None] = [None] * len(coded)
    if neutral is not None:
        pairs = zip(neutral, gains, strict=True)
        spots = [fit_star_spot(one.rate, one.variance, share, near) for one, share in pairs]
    places = star_places(spots, near)
    row, column = (round(float(one)) for one in places.mean(0))
    window = min(roles.psf_window_px, *coded[0].rate.shape)
    cut = [
        _move(_cut_band(record, one, (row, column), window, spot), place - (row, column))
        for one, spot, place in zip(coded, spots, places, strict=True)
    ]
    psfs = np.stack(cut)
    light = psfs.sum((1, 2))
    _require_light(record, light, wavelengths, roles.star)
    notes = tuple(_notes(roles, spots))
    if mosaic_of(record) is not None or neutral is None:
        return BandPSFs(psfs / light[:, None, None], light, tuple(spots), notes)
    totals = np.array([crop_centred(one.rate, (row, column), window).sum() for one in neutral])
    _require_light(record, totals, wavelengths, roles.star)
    _require_shares(record, light / totals, neutral, wavelengths)
    psfs = psfs / totals[:, None, None]
    return BandPSFs(psfs, totals, tuple(spots), notes, knows_share=True)


def star_places(spots: Sequence[StarSpot | None], near: tuple[int, int]) -> Picture:
    """Return the place of the neutral star in each band, (bands, 2), as rows and columns in pixels.

    A band whose star is certainly beside the others has its own place; all others have the mean,
    weighted by certainty.
    """
    found = [one for one in spots if one is not None]
    if not found:
        return np.tile(np.array(near, dtype=np.float64), (len(spots), 1))
    trust = np.array([1 / max(one.deviation, 1e-3) ** 2 for one in found])
    own = np.array([(one.y, one.x) for one in found])
    mean = (own * trust[:, None]).sum(0) / trust.sum()
    places = np.tile(mean, (len(spots), 1))
    for at, one in enumerate(spots):
        if one is None:
            continue
        apart = np.hypot(one.y - mean[0], one.x - mean[1])
        if apart > max(_SIGNIFICANCE * one.deviation, _LEAST_SHIFT):
            places[at] = one.y, one.x
    return places


def require_star(record: Record, roles: Reconstruction, wavelengths: Sequence[float]) -> None:
    """Raise UserError if the star wasn't recorded with the coded pattern in one of the bands."""
    seen = recorded_wavelengths(record, roles.star, roles.coded)
    for wavelength in wavelengths:
        if any(abs(one - wavelength) < WAVELENGTH_TOLERANCE for one in seen):
            continue
        has = ", ".join(f"{one * 1e9:g}" for one in seen) or "no wavelength"
        raise UserError(
            f"{record.path}: has no star {roles.star!r} with pattern {roles.coded!r} at "
            f"{format_nanometres(wavelength)}; it has it at {has}. Leave that band out of --bands, "
            "give the PSFs (--psf FILE), or name another target that is a star (--star NAME)."
        )


def _sensitivity(record: Record, star: Bracket) -> Picture:
    """Return each pixel's sensitivity in the band of the star's picture, (rows, columns)."""
    filters = described_filters(record, star, is_grey=True)
    if filters is None:
        return np.ones(star.rate.shape)
    return filters.gains[filters.channel_map(star.rate.shape)]


def _brightest_pixel(pictures: Sequence[Bracket], gains: Sequence[Picture]) -> tuple[int, int]:
    """Return the pixel (row, column) around which all bands of a star are brightest together.

    Means of 3 x 3 pixels hold a pixel of each of Bayer's colours.
    """
    lit = [np.clip(one.rate / max(float(one.rate.max()), 1e-300), 0, None) for one in pictures]
    total, seen = (uniform_filter(np.sum(one, axis=0), 3) for one in (lit, gains))
    return bright_centroid(total / np.maximum(seen, 1e-3 * seen.max()))


def _cut_band(
    record: Record, star: Bracket, pixel: tuple[int, int], window: int, middle: StarSpot | None
) -> Picture:
    """Cut a star out of a merged picture, behind filters as Eq. 4.7 of the thesis restores it.

    What the pattern leaves in the middle has the shape of the neutral star, `middle`, and is
    smaller than the distance between pixels of one colour. It is taken out before colours are
    interpolated, and put back then.
    """
    filters = described_filters(record, star, is_grey=True)
    if filters is None:
        return crop_centred(star.rate, pixel, window)
    core = np.zeros(star.rate.shape)
    if middle is not None:
        sensitivity = _sensitivity(record, star)
        light = middle.share_in(star.rate, star.variance, sensitivity)
        core = light * middle.shape_on(*star.rate.shape)
        star = replace(star, rate=star.rate - sensitivity * core)
    part = [
        slice(max((at - window // 2 - _MARGIN) // n * n, 0), at + window // 2 + _MARGIN + 1)
        for at, n in zip(pixel, filters.period, strict=True)
    ]
    rate, variance = star.rate[part[0], part[1]], star.variance[part[0], part[1]]
    clipped = ~np.isfinite(variance)
    noise = float(np.sqrt(variance[~clipped].mean())) if not clipped.all() else 0.0
    around = filters.separate(rate, noise, clipped)[0].astype(np.float64)
    band = around + core[part[0], part[1]]
    return crop_centred(band, (pixel[0] - part[0].start, pixel[1] - part[1].start), window)


def _move(psf: Picture, offset: Picture) -> Picture:
    """Move a PSF against an offset in pixels, if that is large enough to count."""
    if np.hypot(*offset) <= _LEAST_SHIFT:
        return psf
    moved: Picture = shift_picture(psf, -offset, order=3, mode="constant")
    return moved * (psf.sum() / moved.sum()) if moved.sum() > 0 else psf


def _require_light(
    record: Record, light: NDArray[np.float64], wavelengths: Sequence[float], star: str
) -> None:
    """Raise UserError if the star is dark in a band."""
    dark = [one for one, total in zip(wavelengths, light, strict=True) if not total > 0]
    if dark:
        raise UserError(
            f"{record.path}: the star {star!r} is dark at {format_nanometres(dark[0])}. Expose it "
            "longer, or leave that band out of --bands."
        )


def _require_shares(
    record: Record,
    shares: NDArray[np.float64],
    neutral: Sequence[Bracket],
    wavelengths: Sequence[float],
) -> None:
    """Raise UserError if the coded star is much brighter than the neutral one."""
    for one, share, picture in zip(wavelengths, shares, neutral, strict=True):
        if share > _MOST_SHARE:
            clipped = " It is clipped in every exposure" if picture.clipped else ""
            raise UserError(
                f"{record.path}: the coded star at {format_nanometres(one)} has {share:.2g} times "
                f"the light of the neutral one.{clipped or ' Check lamp and exposures'}: take the "
                "neutral star with a shorter exposure as well."
            )


def _notes(roles: Reconstruction, spots: Sequence[StarSpot | None]) -> list[str]:
    """Remark on how well the star gives the place of the PSFs."""
    said = [SHIFT_NOTE]
    if not any(spots):
        said.append(
            f"the star has no frames with the pattern {roles.neutral!r}: its place is that of the "
            "coded star's brightest part"
        )
    elif unsure := [one for one in spots if one is None or one.deviation > _UNSURE]:
        said.append(
            f"the neutral star's place is uncertain by more than half a pixel in {len(unsure)} "
            "bands, which have the mean of the others"
        )
    return said
