"""Merge frames of a bracket band by band, with exposures as the frames show them.

8-bit pictures are merged by their response curve, with times and motion checked.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage

from labapp.common.errors import UserError
from labapp.pictures.analysis.colour_filters import ColourFilters
from labapp.pictures.merging.bracket_files import BracketFiles
from labapp.pictures.merging.bracket_motion import (
    align_band,
    bracket_motions,
    explain_alignment,
    explain_motions,
)
from labapp.pictures.merging.mosaic_colours import bracket_filters, merged_colours
from optics import hdr
from optics.progress import Progress

_KEEP_STILL = (
    "RAW frames behind colour filters can't be registered: keep the camera still, or develop them "
    "to linear 16-bit TIFFs, and merge these with --align"
)

_RATES_PER_DECADE = 2
"""Rates for which the accuracy of a merge is told. Chosen."""

_NEARLY_ALL, _NOTABLE = 0.99, 0.01
"""Shares of pixels from which on a bracket counts as clipped or dark, and as darker than without
light. Chosen."""

_BELOW = 5.0
"""Standard deviations below no light from which on a pixel is darker than without light. Chosen."""

_ROWS = 256
"""Rows that are looked at together, which saves memory. Chosen."""

_CUT, _ROUNDED = 3.0, 0.5
"""Standard deviations of the noise below which a black level cuts it, and digital numbers of noise
above which it isn't rounding that makes zeros. Chosen."""

_BRIGHT = 10.0
"""Standard deviations of its noise from which on a pixel is bright, so that the dark ones around it
may be the scene's own, as around a star. Chosen: chance reaches six in ten megapixels."""

_FULL = 255
"""Highest number of an 8-bit picture."""

_BLOCK, _MOST = 16, 0.8
"""Side of a block in pixels, and part of it that contradicts itself from which on something moved
there. Chosen: at edges, up to half of them do that were interpolated."""


@dataclass(frozen=True, eq=False)
class MergedFiles:
    """A merged bracket of files.

    rate, variance, state: (bands, rows, columns). factors: light of each frame over that of its
    exposure time, or None where it wasn't measured. told: what is wrong with exposures, in words.
    clipped: share of each frame's pixels at full scale. accuracy: of such a merge, by simulation;
    None for 8-bit pictures, whose response curves are given instead, one for each band, and the
    check of their exposure times, unless these are trusted. motions: of frames from files.
    is_aligned: whether these were undone. notes: what was done, in words. filters: colour filters
    of RAW files, behind which rate, variance and state are. colours: linear sRGB, (3, rows,
    columns), as these show it.
    """

    source: BracketFiles
    method: str
    rate: NDArray[np.float32]
    variance: NDArray[np.float32]
    state: NDArray[np.uint8]
    factors: hdr.ExposureFactors | None
    told: list[str]
    clipped: list[float]
    accuracy: hdr.ExpectedAccuracy | None
    curves: tuple[hdr.ResponseCurve, ...] = ()
    coded_times: hdr.CodedTimes | None = None
    motions: hdr.FrameMotions | None = None
    is_aligned: bool = False
    notes: tuple[str, ...] = ()
    filters: ColourFilters | None = None
    colours: NDArray[np.float32] | None = None

    @property
    def shown(self) -> NDArray[np.float32]:
        """Return the light to look at: grey, or of three colours."""
        return self.rate if self.colours is None else self.colours

    def share(self, state: hdr.PixelState) -> float:
        """Return the share of pixels in a state."""
        return float((self.state == state).mean())


def merge_files(
    source: BracketFiles,
    method: hdr.Method,
    refine: bool,
    progress: Progress,
    align: bool = False,
    motions: hdr.FrameMotions | None = None,
) -> MergedFiles:
    """Merge each band by itself, with one factor for each frame.

    refine: whether exposures are measured; those that surely differ are corrected. align: whether
    frames that moved are registered. motions: of the frames; by default, they are found. 8-bit
    pictures are merged by their response curve instead.
    """
    if source.is_coded:
        return _merge_coded(source, refine, align, progress, motions)
    told, notes = list(source.doubts), list(source.notes)
    if source.may_move and len(source.frames) > 1:
        progress.report(0.0, "comparing frames")
        motions = motions or bracket_motions(source)
        if align:
            source = _aligned(source, motions)
            notes += explain_alignment(motions)
        else:
            told += explain_motions(motions, *([] if source.period == (1, 1) else [_KEEP_STILL]))
    bands = [file_bracket(source, number) for number in range(len(source.frames[0]))]
    factors: hdr.ExposureFactors | None = None
    if refine and len(source.frames) > 1:
        progress.report(0.0, "measuring exposures")
        factors, words = _measured_factors(bands)
        told += words
        if factors is not None:
            bands = [one.with_factors(factors.corrections) for one in bands]
    found = []
    for number, band in enumerate(bands):
        ends = (0.1 + 0.7 * (number + k) / len(bands) for k in (0, 1))
        report = functools.partial(progress.part(*ends).report, message="merging")
        defects = hdr.find_defects(band)
        known = defects.mask if source.defects is None else defects.mask | source.defects
        found.append(hdr.merge(band, method, known, report))
        colour = f"colour {number + 1}: " if len(bands) > 1 else ""
        told += [f"{colour}{words}. They are left out" for words in defects.explain()]
    progress.report(0.8, "simulating the merge")
    full = source.sensor.full_scale
    rate, variance, state = (_join_bands(every) for every in zip(*found, strict=True))
    told += _useless_light(rate, variance, state) + _cut_noise(bands)
    filters, colours = None, None
    if source.raw is not None:
        filters, said, doubts = bracket_filters(source.raw)
        notes, told = notes + said, told + doubts
    if filters is not None:
        report = functools.partial(progress.part(0.8, 0.9).report, message="finding colours")
        colours = merged_colours(rate[0], variance[0], state[0], filters, report)
    return MergedFiles(
        source, method, rate, variance, state, factors, told,
        [float((frame >= full).mean()) for frame in source.frames],
        hdr.expected_accuracy(bands[0], _told_rates(bands[0]), method),
        motions=motions, is_aligned=align, notes=tuple(notes), filters=filters, colours=colours,
    )  # fmt: skip


def _aligned(source: BracketFiles, motions: hdr.FrameMotions) -> BracketFiles:
    """Return frames that moved at the places of the reference.

    Darks and defects belong to the sensor's pixels, so that they are taken off before.
    """
    full, level, found = source.sensor.full_scale, source.sensor.black_level, []
    for number in range(len(source.frames[0])):
        band = file_bracket(source, number)
        defects = hdr.find_defects(band).mask
        if source.defects is not None:
            defects = defects | source.defects
        lit, unknown = [], []
        for frame, dark in zip(band.frames, band.darks, strict=True):
            unknown.append((frame >= full) | defects)
            light = np.asarray(frame, np.float32) - np.asarray(dark, np.float32)
            lit.append(np.where(unknown[-1], np.float32(full), light + np.float32(level)))
        found.append(align_band(lit, motions, unknown, full, -float(full))[0])
    frames = [np.stack([band[number] for band in found]) for number in range(len(source.frames))]
    return replace(source, frames=frames, darks=[level] * len(frames), defects=None)


def _useless_light(
    rate: NDArray[np.float32], variance: NDArray[np.float32], state: NDArray[np.uint8]
) -> list[str]:
    """Say in words if the light is nearly all clipped, or dark, or partly below no light."""
    found = []
    clipped, dark = (float((state == one).mean()) for one in (hdr.CLIPPED, hdr.DARK))
    if clipped > _NEARLY_ALL:
        found.append(f"{clipped:.1%} of the pixels are clipped in all exposures: add shorter ones")
    if dark > _NEARLY_ALL and not _share_below(-rate, variance, _BRIGHT):
        found.append(f"{dark:.1%} of the pixels are dark in all exposures: add longer ones")
    below = _share_below(rate, variance, _BELOW)
    if below > _NOTABLE:
        found.append(
            f"{below:.1%} of the pixels are darker than without light: the black level or the dark "
            "frames are too bright; check --black, --dark and the sensor file"
        )
    return found


def _share_below(
    light: NDArray[np.float32], variance: NDArray[np.float32], deviations: float
) -> float:
    """Return the share of pixels so many standard deviations below no light."""
    count = 0
    for start in range(0, light.shape[1], _ROWS):
        part = np.s_[:, start : start + _ROWS]
        count += int(np.count_nonzero(light[part] < -deviations * np.sqrt(variance[part])))
    return count / light.size


def _cut_noise(bands: Sequence[hdr.Bracket]) -> list[str]:
    """Say in words if the numbers end at 0, above the lowest ones of the noise."""
    shortest, gain = bands[0].exposures[0], bands[0].sensor.gain
    number, noise = shortest.frames[0], math.sqrt(shortest.floor) / gain
    share = max(1 - np.count_nonzero(one.frames[number]) / math.prod(one.shape) for one in bands)
    if share < _NOTABLE or noise < _ROUNDED or shortest.dark_level > _CUT * noise:
        return []
    return [
        f"{share:.1%} of the numbers of frame {number + 1} are 0, which cuts the noise of dark "
        "pixels: their light comes out too bright. Raise the camera's black level (offset)"
    ]


def _merge_coded(
    source: BracketFiles,
    refine: bool,
    align: bool,
    progress: Progress,
    motions: hdr.FrameMotions | None,
) -> MergedFiles:
    """Merge each band of 8-bit pictures by the response curve that it shows.

    Exposure times are checked, and a wrong one is corrected. Raises UserError for frames out of
    order, and if nothing tells a curve.
    """
    _require_order(source)
    progress.report(0.0, "comparing frames")
    motions = motions or bracket_motions(source)
    told = [
        "the response curve of these 8-bit pictures was measured on them. If numbers are sRGB's, "
        "or linear, say so by --encoding srgb or linear, with --gain and --read-noise",
        *source.doubts,
        *([] if align else explain_motions(motions)),
    ]
    notes = [*source.notes, *(explain_alignment(motions) if align else [])]
    times, checked = np.array(source.exposures), None
    if refine:
        checked = hdr.check_coded_times(source.frames, times, motions.motions)
        told += checked.explain()
        times = times * checked.corrections
        if len(source.frames) == 2:
            notes.append("two frames of 8-bit pictures can't tell whether exposure times are right")
    found, curves, count = [], list[hdr.ResponseCurve](), len(source.frames[0])
    for number in range(count):
        frames = [frame[number] for frame in source.frames]
        clipped = [one > hdr.HIGHEST for one in frames]
        # A curve is told by pixels that see one place, whether or not the light is merged so.
        aligned, outside = align_band(frames, motions, clipped, _FULL, 0)
        aligned = [one.astype(np.float32) for one in aligned]
        try:
            curves.append(hdr.fit_response(aligned, times))
        except ValueError as error:
            raise UserError(
                f"{source.names[0]} and the others: {error}; or say what the numbers are by "
                "--encoding linear or srgb, with --gain and --read-noise."
            ) from error
        part = progress.part(0.1 + 0.8 * number / count, 0.1 + 0.8 * (number + 1) / count)
        report = functools.partial(part.report, message="merging")
        shown, absent = (aligned, outside) if align else (frames, None)
        found.append(hdr.merge_by_response(shown, times, curves[-1], report, absent))
    if align or not motions.moved:
        told += _explain_ghosts([one.state.numpy() for one in found])
    rate, variance, state = (_join_bands(every) for every in zip(*found, strict=True))
    shares = [float((frame > hdr.HIGHEST).mean()) for frame in source.frames]
    return MergedFiles(
        source, "response curve", rate, variance, state, None, told, shares, None, tuple(curves),
        checked, motions, align, tuple(notes),
    )  # fmt: skip


def _require_order(source: BracketFiles) -> None:
    """Raise UserError for frames that aren't brighter the longer they were exposed.

    A response curve without order would be no camera's.
    """
    shares = [np.asarray(frame, dtype=np.float32) / _FULL for frame in source.frames]
    light = np.array([one.mean(dtype=np.float64) for one in shares])
    # Rounding is the least noise.
    noise = np.full(len(shares), 1 / math.sqrt(12 * shares[0].size) / _FULL)
    disordered = hdr.find_disorder(light, noise, np.array(source.exposures))
    if disordered:
        names = ", ".join(source.names[one] for one in disordered)
        raise UserError(f"{names}: {hdr.explain_disorder(disordered)}.")


def _explain_ghosts(states: Sequence[NDArray[np.uint8]]) -> list[str]:
    """Say in words where something moved between the frames, if it did."""
    moved = np.mean([one == hdr.MOVED for one in states], axis=0)
    share = ndimage.uniform_filter(moved, _BLOCK, mode="constant")
    if share.max() < _MOST:
        return []
    row, column = np.unravel_index(int(share.argmax()), share.shape)
    return [
        f"something moved between the frames, most of all around row {row}, column {column}: "
        f"frames that contradict the others are left out in {moved.mean():.1%} of the pixels"
    ]


def _join_bands(bands: Sequence[torch.Tensor]) -> NDArray[Any]:
    """Stack bands into one array; a single one isn't copied."""
    return bands[0].numpy()[None] if len(bands) == 1 else torch.stack(list(bands)).numpy()


def file_bracket(source: BracketFiles, number: int) -> hdr.Bracket:
    """Return one band of all frames."""
    return hdr.Bracket(
        [frame[number] for frame in source.frames],
        source.exposures,
        [dark[number] if isinstance(dark, np.ndarray) else dark for dark in source.darks],
        source.dark_counts,
        source.sensor,
    )


def _measured_factors(
    bands: list[hdr.Bracket],
) -> tuple[hdr.ExposureFactors | None, list[str]]:
    """Return the exposure factors by the band that tells most, and what is wrong, in words."""
    measured, refused = [], ""
    for band in bands:
        try:
            measured.append(hdr.measure_exposure_factors(band))
        except ValueError as error:
            refused = str(error)
    if not measured:
        return None, [f"exposures were taken as they were given: {refused}"]
    best = min(measured, key=lambda one: float(one.deviations.max()))
    told = best.explain()
    if best.scatter > 1.5:
        told.append(
            f"frames differ by {best.scatter:.2g} times the noise that the sensor is said to have: "
            "check gain and read noise, and whether numbers are proportional to light"
        )
    return best, told


def _told_rates(band: hdr.Bracket) -> NDArray[np.float64]:
    """Return rates from the noise of the longest to the top of the shortest exposure."""
    shortest, longest = band.exposures[0], band.exposures[-1]
    low = math.log10(math.sqrt(longest.floor) / longest.time)
    high = math.log10(0.9 * shortest.clip_level / shortest.time)
    count = max(2, math.ceil((high - low) * _RATES_PER_DECADE) + 1)
    return np.asarray(np.logspace(low, high, count))
