"""Merge 8-bit pictures by their response curve, with times and motion checked."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from labapp.common.errors import UserError
from labapp.pictures.merging.bracket_files import BracketFiles
from labapp.pictures.merging.bracket_motion import align_band, bracket_motions, explain_motions
from optics import hdr
from optics.progress import Progress

_FULL = 255
"""Highest number of an 8-bit picture."""

_BLOCK, _MOST = 16, 0.8
"""Side of a block in pixels, and part of it that contradicts itself from which on something moved
there. Chosen: at edges, up to half of them do that were interpolated."""


@dataclass(frozen=True, eq=False)
class CodedMerge:
    """Bands merged from 8-bit pictures.

    times: check of the exposure times; None if it wasn't asked for. motions: of the frames. told:
    what is wrong, in words.
    """

    bands: list[hdr.RadianceEstimate]
    curves: tuple[hdr.ResponseCurve, ...]
    times: hdr.CodedTimes | None
    motions: hdr.FrameMotions
    told: list[str]


def merge_coded_bands(
    source: BracketFiles,
    refine: bool,
    align: bool,
    progress: Progress,
    motions: hdr.FrameMotions | None = None,
) -> CodedMerge:
    """Merge each band of 8-bit pictures by the response curve that it shows.

    refine: whether exposure times are checked, and a wrong one is corrected. align: whether frames
    that moved are aligned. motions: of the frames; by default, they are found. Raises UserError for
    frames out of order, and if nothing tells a curve.
    """
    _require_order(source)
    progress.report(0.0, "comparing frames")
    motions = motions or bracket_motions(source)
    told = [] if align else explain_motions(motions)
    times, checked = np.array(source.exposures), None
    if refine:
        checked = hdr.check_coded_times(source.frames, times, motions.motions)
        told += checked.explain()
        times = times * checked.corrections
    found, curves, count = [], [], len(source.frames[0])
    for number in range(count):
        frames = [frame[number] for frame in source.frames]
        clipped = [one > hdr.HIGHEST for one in frames]
        # A curve is told by pixels that see one place, whether or not the light is merged so.
        aligned, outside = align_band(frames, motions, clipped, _FULL, 0)
        aligned = [one.astype(np.float32) for one in aligned]
        curves.append(_curve(source, aligned, times))
        part = progress.part(0.1 + 0.8 * number / count, 0.1 + 0.8 * (number + 1) / count)
        report = functools.partial(part.report, message="merging")
        shown, absent = (aligned, outside) if align else (frames, None)
        found.append(hdr.merge_by_response(shown, times, curves[-1], report, absent))
    if align or not motions.moved:
        told += _explain_ghosts([one.state.numpy() for one in found])
    return CodedMerge(found, tuple(curves), checked, motions, told)


def _curve(
    source: BracketFiles, frames: Sequence[NDArray[np.float32]], times: NDArray[np.float64]
) -> hdr.ResponseCurve:
    """Fit the response curve that a band shows."""
    try:
        return hdr.fit_response(frames, times)
    except ValueError as error:
        raise UserError(
            f"{source.names[0]} and the others: {error}; or say what the numbers are by "
            "--encoding linear or srgb, with --gain and --read-noise."
        ) from error


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
