"""A camera's figures from frames of even light and of darkness, after EMVA 1288 release 4."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from optics.measuring.dark_signal import DarkSignal, fit_dark_signal, temporal_dark_noise
from optics.measuring.group_statistics import (
    STEP_VARIANCE,
    GroupStatistics,
    HalfProducts,
    box_share,
    measure_groups,
)
from optics.measuring.measured import Array, Measured
from optics.measuring.paired_frames import PairedFrames
from optics.measuring.photon_transfer import (
    ClipLevel,
    Linearity,
    PhotonTransfer,
    electrons,
    find_clip_level,
    fit_photon_transfer,
    measure_linearity,
    saturation_signal,
)
from optics.measuring.pixel_maps import Defects, collect_defects


def photo_response_nonuniformity(groups: Sequence[GroupStatistics]) -> Measured | None:
    """Return the PRNU: the relative standard deviation of the pixels' response.

    Slow changes over the sensor are left out, as the light's (EMVA 1288 release 4, section 8), and
    defective pixels. None if no exposure was bright and unclipped.
    """
    total = sum((one.response for one in groups), HalfProducts())
    return (_covariance(total) * (1 / box_share())).root if total.count > 1 else None


def dark_signal_nonuniformity(groups: Sequence[GroupStatistics], *, is_coarse: bool) -> Measured:
    """Return the DSNU: the standard deviation over pixels of the dark number, DN.

    It is that at the exposure times of the light, without defective pixels.
    is_coarse: whether the noise is too small to average over the converter's steps, so that their
        rounding is in it.
    """
    found = _covariance(sum((one.offsets for one in groups), HalfProducts()))
    if is_coarse:
        found = Measured(found.value, math.hypot(found.sigma, STEP_VARIANCE))
    return found.root


def _covariance(sums: HalfProducts) -> Measured:
    """Return the covariance of a map's two halves over its pixels.

    The uncertainty is that of normal pixels (Wishart's distribution).
    """
    n = sums.count
    means = sums.first / n, sums.second / n
    products = sums.products / n - means[0] * means[1]
    squares = (sums.first_squares / n - means[0] ** 2, sums.second_squares / n - means[1] ** 2)
    sigma = math.sqrt(max(squares[0] * squares[1] + products**2, 0.0) / (n - 1))
    return Measured(products * n / (n - 1), sigma)


_RISE = 1.5
"""Least signal of the longest exposure over that of the shortest, for light that counts. Chosen."""

_SURE_LIGHT = 20.0
"""Least largest signal over the dark noise. Chosen."""

_EVERY_ROW = 5
"""Step between the rows that tell a frame's mean: odd, so that all colours are among them."""


@dataclass(frozen=True, eq=False)
class CameraNoise:
    """What a camera's noise and signal amount to, each with its standard uncertainty.

    Parameters
    ----------
    gain : Measured
        Conversion gain: electrons per digital number, the inverse of EMVA's overall system gain K.
    read_noise : Measured
        Temporal dark noise without exposure, electrons; rounding and dark current are taken off.
    read_noise_is_limit : bool
        Whether the read noise is only known to be below that: less than the converter's steps show.
    dark_noise : Measured
        Temporal dark noise of the numbers at the shortest exposure, DN, rounding included.
    black_level : Measured
        Number without light and exposure, DN.
    dark_current : Measured
        Electrons per second, without hot pixels.
    full_well : Measured or None
        Electrons of light at which pixels clip; None if no exposure saturates.
    clip_number : Measured or None
        Number at which they clip, DN.
    clip_limit : {"converter", "well"} or None
        What ends there: the converter's range, or the pixels' wells.
    saturation_capacity : Measured or None
        Electrons of light at which the variance is largest (EMVA 1288, section 6.6), known to the
        spacing of the exposures.
    sensitivity_threshold : Measured
        Electrons of light at which signal and noise are equal.
    dynamic_range : Measured or None
        Saturation capacity over sensitivity threshold.
    snr_max : Measured or None
        Largest ratio of signal to noise of a pixel, the root of the saturation capacity.
    linearity : Linearity or None
        Signal by exposure time; None with too few exposures.
    prnu : Measured or None
        PRNU1288: relative standard deviation of the pixels' response, without defective pixels.
    dsnu : Measured
        DSNU1288: standard deviation of the pixels' dark signal, electrons, without defective ones.
    defects : Defects
        Hot and dead pixels.
    transfer : PhotonTransfer
        The photon transfer curve.
    dark : DarkSignal
        Dark number and noise by exposure time.
    unevenness : float
        Light of the brightest area over that of the dimmest, less 1.
    lamp_jump : float
        Largest relative change of the light between the two frames of a pair.
    frames : int
        Frames that were evaluated.
    """

    gain: Measured
    read_noise: Measured
    read_noise_is_limit: bool
    dark_noise: Measured
    black_level: Measured
    dark_current: Measured
    full_well: Measured | None
    clip_number: Measured | None
    clip_limit: Literal["converter", "well"] | None
    saturation_capacity: Measured | None
    sensitivity_threshold: Measured
    dynamic_range: Measured | None
    snr_max: Measured | None
    linearity: Linearity | None
    prnu: Measured | None
    dsnu: Measured
    defects: Defects
    transfer: PhotonTransfer
    dark: DarkSignal
    unevenness: float
    lamp_jump: float
    frames: int

    @property
    def system_gain(self) -> Measured:
        """Overall system gain K of EMVA 1288, digital numbers per electron."""
        return self.gain.inverse


def characterise_camera(source: PairedFrames) -> CameraNoise:
    """Find a camera's gain, noise, saturation, linearity, non-uniformity and defects.

    Parameters
    ----------
    source : PairedFrames
        Pairs of frames of an evenly lit target, from darkness to saturation, and dark pairs.

    Returns
    -------
    CameraNoise
        Uncertainties are those of the pixels' and pairs' statistics; where points scatter more than
        these say, they are larger by as much.

    Raises
    ------
    ValueError
        If the light doesn't rise with exposure (saturated throughout, or dark), if too few
        exposures are below saturation, if dark numbers end at 0, if numbers exceed the
        converter's end, or if half of the pixels somewhere look defective.

    References
    ----------
    EMVA Standard 1288, release 4.0 linear (2021), sections 6 to 8. J. Janesick, Photon Transfer,
    SPIE Press 2007, doi 10.1117/3.725073.
    """
    _require_rising_light(source)
    groups = measure_groups(source)
    dark = fit_dark_signal(groups)
    clip = find_clip_level(groups, source.top_number)
    full = None if clip is None else clip.number.value - dark.black_level.value
    coarse = temporal_dark_noise(dark, 0.0) if dark.is_coarse else None
    transfer = fit_photon_transfer(groups, full, _likely_variance(coarse))
    system_gain = transfer.system_gain
    gain = system_gain.inverse
    black = _black_level(dark, transfer)
    variance, is_limit = coarse or temporal_dark_noise(dark, system_gain.value)
    read_noise = variance.root.times(gain)
    saturation = saturation_signal(groups)
    capacity = None if saturation is None else electrons(transfer, saturation)
    threshold = _sensitivity_threshold(read_noise, gain)
    pixels = [(one.defects, one.rows, one.columns) for one in groups]
    first = dark.points[0]
    return CameraNoise(
        gain=gain,
        read_noise=read_noise,
        read_noise_is_limit=is_limit,
        dark_noise=Measured(first.variance, first.variance_sigma).root,
        black_level=black,
        dark_current=dark.current.times(gain),
        full_well=None if clip is None else _full_well(clip, dark, transfer),
        clip_number=clip.number if clip else None,
        clip_limit=clip.limit if clip else None,
        saturation_capacity=capacity,
        sensitivity_threshold=threshold,
        dynamic_range=capacity.times(threshold.inverse) if capacity else None,
        snr_max=capacity.root if capacity else None,
        linearity=measure_linearity(groups, full, _light_times(source)),
        prnu=photo_response_nonuniformity(groups),
        dsnu=dark_signal_nonuniformity(groups, is_coarse=dark.is_coarse).times(gain),
        defects=collect_defects(pixels),
        transfer=transfer,
        dark=dark,
        unevenness=_unevenness(groups),
        lamp_jump=_lamp_jump(groups),
        frames=len(source.frames),
    )


def _require_rising_light(source: PairedFrames) -> None:
    """Raise ValueError if the signal is that of darkness, or the same at all exposures."""
    dark = {time: _mean_number(source, pairs[0][0]) for time, pairs in source.dark.items()}
    numbers = {time: _mean_number(source, pairs[0][0]) for time, pairs in source.light.items()}
    signals = [number - dark[time] for time, number in numbers.items()]
    first, second = (_some_rows(source, index) for index in next(iter(source.dark.values()))[0])
    noise = math.sqrt(max(float((first - second).var()) / 2, STEP_VARIANCE))
    if max(signals) < _SURE_LIGHT * noise:
        raise ValueError(
            f"the lit frames are at most {max(signals):.3g} numbers above the dark; light the "
            "target, expose longer, or check that light and dark frames aren't swapped"
        )
    if signals[-1] < _RISE * signals[0]:
        where = "saturated" if min(numbers.values()) > 0.9 * source.top_number else "the same"
        raise ValueError(
            f"the light is {where} at every exposure time ({signals[0]:.5g} to {signals[-1]:.5g} "
            "numbers above darkness); expose shorter, or dim it, so that it rises from darkness to "
            "saturation"
        )


def _mean_number(source: PairedFrames, index: int) -> float:
    """Return a frame's mean number, from some of its rows."""
    return float(_some_rows(source, index).mean())


def _some_rows(source: PairedFrames, index: int) -> Array:
    rows = slice(0, source.shape[0], _EVERY_ROW)
    return np.asarray(source.frames[index][rows, slice(None)], dtype=np.float64)


def _likely_variance(coarse: tuple[Measured, bool] | None) -> Measured | None:
    """Return the variance of the dark noise, DN²; anything below a limit is as likely."""
    if coarse is None or not coarse[1]:
        return coarse and coarse[0]
    limit = coarse[0].value
    return Measured(limit / 2, limit / math.sqrt(12))


def _black_level(dark: DarkSignal, transfer: PhotonTransfer) -> Measured:
    """Return the black level, DN, by what tells it better: darkness or photon transfer."""
    if not dark.is_coarse or transfer.offset.sigma > dark.black_level.sigma:
        return dark.black_level
    return Measured(dark.black_level.value - transfer.offset.value, transfer.offset.sigma)


def _full_well(clip: ClipLevel, dark: DarkSignal, transfer: PhotonTransfer) -> Measured:
    """Return the electrons at which pixels clip."""
    level = dark.black_level
    # Where steps are coarse, the offset's uncertainty is that of the dark number.
    own = 0.0 if dark.is_coarse else level.sigma
    signal = Measured(clip.number.value - level.value, math.hypot(clip.number.sigma, own))
    return electrons(transfer, signal)


def _sensitivity_threshold(read_noise: Measured, gain: Measured) -> Measured:
    """Return the electrons at which signal and noise are equal (EMVA 1288, equation 27)."""
    variance = read_noise.value**2 + gain.value**2 * STEP_VARIANCE
    value = math.sqrt(variance + 0.25) + 0.5
    slopes = read_noise.value, gain.value * STEP_VARIANCE
    sigma = math.hypot(slopes[0] * read_noise.sigma, slopes[1] * gain.sigma) / (value - 0.5)
    return Measured(value, sigma)


def _light_times(source: PairedFrames) -> dict[float, float]:
    """Return when the light of each exposure time was taken, seconds; empty if unknown."""
    if source.times is None:
        return {}
    return {
        time: float(np.mean([source.times[index] for pair in pairs for index in pair]))
        for time, pairs in source.light.items()
    }


def _lamp_jump(groups: list[GroupStatistics]) -> float:
    """Return the largest relative change of the light between the two frames of a pair."""
    ratios = np.array([[one.ratio for one in group.light] for group in groups])
    return float(np.abs(np.median(ratios, axis=0) - 1).max())


def _unevenness(groups: list[GroupStatistics]) -> float:
    """Return the light of the brightest area over that of the dimmest less 1, behind one colour."""
    found = 0.0
    for colour in {group.filter for group in groups}:
        same = [group.light for group in groups if group.filter == colour]
        middle = np.median([[one.signal for one in light] for light in same], axis=0)
        # The brightest exposure that is clear of clipping in all areas.
        half = int(np.searchsorted(middle, 0.4 * middle.max()))
        signals = [light[half].signal for light in same]
        found = max(found, max(signals) / max(min(signals), 1e-9) - 1)
    return found
