"""A camera's figures from frames of even light and of darkness, after EMVA 1288 release 4."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from optics.measuring.group_statistics import (
    STEP_VARIANCE,
    SURE_VARIANCE,
    DarkStatistics,
    GroupStatistics,
    measure_groups,
    noise_below_a_step,
)
from optics.measuring.measured import Array, Measured, weighted_mean
from optics.measuring.paired_frames import PairedFrames
from optics.measuring.photon_transfer import (
    Linearity,
    PhotonTransfer,
    electrons,
    find_clip_level,
    fit_photon_transfer,
    measure_linearity,
    saturation_signal,
)
from optics.measuring.pixel_maps import BOX_SHARE, Defects, collect_defects

# Largest share of dark numbers at 0: beyond, mean and noise in darkness are cut off
_MOST_ZEROS = 1e-3
# Changes between frames that are expected where none is seen, at most (95 %, Poisson)
_LIMIT_EVENTS = 3.0


@dataclass(frozen=True)
class DarkPoint:
    """Dark frames of one exposure time (s), over the whole sensor.

    mean: number, DN, with its uncertainty by the pixels' noise.
    variance: temporal, DN², with its uncertainty.
    over_pixels: variance of all numbers, DN².
    """

    exposure: float
    mean: float
    mean_sigma: float
    variance: float
    variance_sigma: float
    over_pixels: float


@dataclass(frozen=True)
class DarkSignal:
    """Black level (DN), dark current (DN/s), and the points that tell them."""

    black_level: Measured
    current: Measured
    points: list[DarkPoint]

    @property
    def is_coarse(self) -> bool:
        """Whether the noise is too small for the converter's steps to measure it."""
        return self.points[0].variance - STEP_VARIANCE < SURE_VARIANCE


def _fit_dark_signal(groups: Sequence[GroupStatistics]) -> DarkSignal:
    """Fit black level and dark current, a straight line, to the mean numbers of dark frames.

    Where they scatter more than they should, the uncertainty is larger by as much. Raises
    ValueError if the numbers end at 0, or darkness was taken at one exposure time only.
    """
    points = [_dark_point(same) for same in zip(*(group.dark for group in groups), strict=True)]
    if len(points) < 2:
        raise ValueError("darkness was taken at one exposure time; take it at two or more")
    x, y, sigmas = np.array([(one.exposure, one.mean, one.mean_sigma) for one in points]).T
    design = np.stack([np.ones_like(x), x], axis=1) / sigmas[:, None]
    # Times of milliseconds and numbers of thousands are brought to the same size.
    scale = np.linalg.norm(design, axis=0)
    inverse = np.linalg.inv((design / scale).T @ (design / scale)) / np.outer(scale, scale)
    start, slope = inverse @ design.T @ (y / sigmas)
    chi2 = float((((y - start - slope * x) / sigmas) ** 2).sum()) / max(len(x) - 2, 1)
    errors = np.sqrt(np.diag(inverse * max(chi2, 1.0)))
    found = DarkSignal(
        Measured(float(start), float(errors[0])), Measured(float(slope), float(errors[1])), points
    )
    if not found.is_coarse:
        return found
    # Numbers that hardly change don't tell where between two steps their mean is.
    level = math.hypot(errors[0], math.sqrt(STEP_VARIANCE))
    current = math.hypot(errors[1], math.sqrt(2 * STEP_VARIANCE) / float(np.ptp(x)))
    return DarkSignal(Measured(float(start), level), Measured(float(slope), current), points)


def _dark_point(same: Sequence[DarkStatistics]) -> DarkPoint:
    """Return the point of one exposure time from its groups of pixels."""
    pixels = np.array([one.pixels for one in same], dtype=np.float64)
    zeros = float(np.average([one.zeros for one in same], weights=pixels))
    if zeros > _MOST_ZEROS:
        raise ValueError(
            f"{zeros:.1%} of the dark numbers at {same[0].exposure * 1e3:g} ms are 0, where "
            "noise is cut off; raise the camera's black level (offset), and take the frames again"
        )
    counts = np.array([one.count for one in same], dtype=np.float64)
    means = np.array([one.mean for one in same])
    variances = np.array([one.variance for one in same])
    mean = float(np.average(means, weights=pixels))
    variance = float(np.average(variances, weights=counts))
    sigmas = variances * np.sqrt(np.array([one.spread for one in same]) / counts)
    within = float(np.average([one.over_pixels for one in same], weights=pixels))
    between = float(np.average((means - mean) ** 2, weights=pixels))
    # A number that never changes may still be off by less than chance shows.
    floor = 1 / counts.sum()
    return DarkPoint(
        same[0].exposure, mean, math.sqrt(max(variance, floor) / (2 * counts.sum())), variance,
        max(float(np.sqrt((counts**2 * sigmas**2).sum()) / counts.sum()), floor),
        within + between,
    )  # fmt: skip


def _temporal_dark_noise(dark: DarkSignal, system_gain: float) -> Measured:
    """Return the variance of the read noise, DN², where the converter's steps aren't too coarse.

    The shot noise of the dark current, system_gain (DN per electron) times its mean, is taken off,
    and the rounding of the converter.
    """
    current = dark.current.value
    shot = np.array([system_gain * max(current, 0.0) * point.exposure for point in dark.points])
    variances, sigmas = np.array([(one.variance, one.variance_sigma) for one in dark.points]).T
    relative = dark.current.sigma / max(abs(current), 1e-300) if current > 0 else 0.0
    return weighted_mean(variances - STEP_VARIANCE - shot, np.hypot(sigmas, shot * relative))


def _noise_below_a_step(dark: DarkSignal) -> tuple[Measured, bool]:
    """Return the variance of a read noise of less than a step, DN², and whether it is a limit.

    The shortest exposure tells it, which has the least dark current.
    """
    point = dark.points[0]
    least = _LIMIT_EVENTS / 2 * point.variance_sigma

    def noise_variance(temporal: float) -> float:
        return noise_below_a_step(point.mean, point.over_pixels, temporal) ** 2

    if point.variance <= least:
        limit = noise_variance(least)
        return Measured(limit, limit), True
    found = noise_variance(point.variance)
    higher = noise_variance(point.variance + point.variance_sigma)
    return Measured(found, abs(higher - found)), False


def _covariance(sums: Sequence[Array]) -> Measured | None:
    """Return the covariance of a map's two halves over all its pixels, by `half_products`.

    The uncertainty is that of normal pixels (Wishart's distribution). None without two pixels.
    """
    n, first, second, first_squares, second_squares, products = sum(sums, np.zeros(6)).tolist()
    if n < 2:
        return None
    means = first / n, second / n
    product = products / n - means[0] * means[1]
    squares = first_squares / n - means[0] ** 2, second_squares / n - means[1] ** 2
    sigma = math.sqrt(max(squares[0] * squares[1] + product**2, 0.0) / (n - 1))
    return Measured(product * n / (n - 1), sigma)


_RISE = 1.5  # least signal of the longest exposure over that of the shortest; chosen
_SURE_LIGHT = 20.0  # least largest signal over the dark noise; chosen
# Step between the rows that tell a frame's mean: odd, for all colours to be among them
_EVERY_ROW = 5


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
        Whether it is only known to be below that: less than the converter's steps show.
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
        PRNU1288: relative standard deviation of the pixels' response; None if no exposure was
        bright and unclipped. Slow changes over the sensor are left out, as the light's (section 8).
    dsnu : Measured
        DSNU1288: standard deviation of the pixels' dark signal at the exposure times of the light,
        electrons. Both are without defective pixels.
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
    dark = _fit_dark_signal(groups)
    clip, limit = find_clip_level(groups, source.top_number)
    full = None if clip is None else clip.value - dark.black_level.value
    if dark.is_coarse:
        variance, is_limit = _noise_below_a_step(dark)
        # Anything below a limit is as likely.
        likely = Measured(variance.value / 2, variance.value / math.sqrt(12))
        transfer = fit_photon_transfer(groups, full, likely if is_limit else variance)
    else:
        transfer = fit_photon_transfer(groups, full, None)
        variance, is_limit = _temporal_dark_noise(dark, transfer.system_gain.value), False
    gain = transfer.system_gain.inverse
    read_noise = variance.root.times(gain)
    saturation = saturation_signal(groups)
    capacity = None if saturation is None else electrons(transfer, saturation)
    threshold = _sensitivity_threshold(read_noise, gain)
    response = _covariance([one.response for one in groups])
    offsets = _covariance([one.offsets for one in groups])
    assert offsets is not None
    if dark.is_coarse:
        # The noise is too small to average over the converter's steps: their rounding is in it.
        offsets = Measured(offsets.value, math.hypot(offsets.sigma, STEP_VARIANCE))
    black, full_well = _levels(dark, transfer, clip)
    ratios = np.array([[one.ratio for one in group.light] for group in groups])
    first = dark.points[0]
    return CameraNoise(
        gain=gain,
        read_noise=read_noise,
        read_noise_is_limit=is_limit,
        dark_noise=Measured(first.variance, first.variance_sigma).root,
        black_level=black,
        dark_current=dark.current.times(gain),
        full_well=full_well,
        clip_number=clip,
        clip_limit=limit,
        saturation_capacity=capacity,
        sensitivity_threshold=threshold,
        dynamic_range=capacity.times(threshold.inverse) if capacity else None,
        snr_max=capacity.root if capacity else None,
        linearity=measure_linearity(groups, full, _light_times(source)),
        prnu=(response * (1 / BOX_SHARE)).root if response else None,
        dsnu=offsets.root.times(gain),
        defects=collect_defects([(one.defects, one.rows, one.columns) for one in groups]),
        transfer=transfer,
        dark=dark,
        unevenness=_unevenness(groups),
        lamp_jump=float(np.abs(np.median(ratios, axis=0) - 1).max()),
        frames=len(source.frames),
    )


def _require_rising_light(source: PairedFrames) -> None:
    """Raise ValueError if the signal is that of darkness, or the same at all exposures."""
    rows = slice(0, source.shape[0], _EVERY_ROW)

    def some_rows(index: int) -> Array:
        return np.asarray(source.frames[index][rows, slice(None)], dtype=np.float64)

    numbers = [float(some_rows(pairs[0][0]).mean()) for pairs in source.light.values()]
    darks = [float(some_rows(source.dark[time][0][0]).mean()) for time in source.light]
    signals = [number - dark for number, dark in zip(numbers, darks, strict=True)]
    first, second = (some_rows(index) for index in next(iter(source.dark.values()))[0])
    noise = math.sqrt(max(float((first - second).var()) / 2, STEP_VARIANCE))
    if max(signals) < _SURE_LIGHT * noise:
        raise ValueError(
            f"the lit frames are at most {max(signals):.3g} numbers above the dark; light the "
            "target, expose longer, or check that light and dark frames aren't swapped"
        )
    if signals[-1] < _RISE * signals[0]:
        where = "saturated" if min(numbers) > 0.9 * source.top_number else "the same"
        raise ValueError(
            f"the light is {where} at every exposure time ({signals[0]:.5g} to {signals[-1]:.5g} "
            "numbers above darkness); expose shorter, or dim it, so that it rises from darkness to "
            "saturation"
        )


def _levels(
    dark: DarkSignal, transfer: PhotonTransfer, clip: Measured | None
) -> tuple[Measured, Measured | None]:
    """Return the black level, DN, and the electrons at which pixels clip, if they do.

    Darkness or photon transfer tells the black level, whichever does better.
    """
    level, offset, full_well = dark.black_level, transfer.offset, None
    if clip is not None:
        # Where steps are coarse, the offset's uncertainty is that of the dark number.
        own = 0.0 if dark.is_coarse else level.sigma
        signal = Measured(clip.value - level.value, math.hypot(clip.sigma, own))
        full_well = electrons(transfer, signal)
    if dark.is_coarse and offset.sigma <= level.sigma:
        level = Measured(level.value - offset.value, offset.sigma)
    return level, full_well


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
