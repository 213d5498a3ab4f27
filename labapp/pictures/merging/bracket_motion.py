"""Find and undo how frames from files moved against each other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.pictures.merging.bracket_files import BracketFiles
from optics import hdr
from optics.measuring import RigidMotion, resample_moved

_ALMOST_FULL = 0.98
"""Part of the full scale from which on a number doesn't count in registering. Chosen."""

_REGISTER = "Give --align to register them"

_TURN = 0.02
"""Degrees from which on a turn is told. Chosen."""

Mask = NDArray[np.bool_]


def bracket_motions(source: BracketFiles) -> hdr.FrameMotions:
    """Find how the frames moved."""
    return hdr.find_motions(_levels(source), math.lcm(*source.period))


def _levels(source: BracketFiles) -> Iterator[tuple[list[NDArray[Any]], list[Mask]]]:
    """Yield bands of like noise of each frame, and where they are clipped."""
    full = source.sensor.full_scale
    for frame, dark in zip(source.frames, source.darks, strict=True):
        if source.is_coded:
            yield list(frame), [band > hdr.HIGHEST for band in frame]
            continue
        bands = []
        for number, band in enumerate(frame):
            level = np.asarray(dark[number] if isinstance(dark, np.ndarray) else dark, np.float32)
            # The square root of light has like noise everywhere (Anscombe); in place for memory.
            share = np.subtract(band, level, dtype=np.float32)
            share *= 255**2 / np.maximum(np.float32(full) - level, 1)
            np.sqrt(np.clip(share, 0, 255**2, out=share), out=share)
            bands.append(share)
        yield bands, [band >= _ALMOST_FULL * full for band in frame]


def explain_motions(motions: hdr.FrameMotions, remedy: str = _REGISTER) -> list[str]:
    """Say in words which frames moved, and what to do: the remedy."""
    if not motions.moved:
        return []
    each = "; ".join(
        f"frame {one + 1} {_way(motions.motions[one])}, {motions.distances[one]:.2g} px at the "
        "corners"
        for one in motions.moved
    )
    return [
        f"frames don't show the scene at the same places: against frame {motions.reference + 1}, "
        f"{each}. {remedy}"
    ]


def explain_alignment(motions: hdr.FrameMotions) -> list[str]:
    """Say in words how frames were aligned."""
    if not motions.shifted:
        return ["--align: no frame moved, and none was changed"]
    found = [
        f"frames {', '.join(str(one + 1) for one in motions.shifted)} were registered to frame "
        f"{motions.reference + 1} and interpolated: the noise of their pixels is at most as "
        "stated, and neighbours share it"
    ]
    unknown = [k for k, one in enumerate(motions.deviations) if math.isinf(one)]
    if unknown:
        done = "are left out" if motions.lost else "stay as they are, like most of the others"
        found.append(
            f"frames {', '.join(str(one + 1) for one in unknown)} share too little detail with the "
            f"others to be registered, and {done}"
        )
    return found


def _way(motion: RigidMotion) -> str:
    """Say in words how a frame moved."""
    turn = math.degrees(motion.turn)
    turned = f" and turned by {turn:.2g}°" if abs(turn) >= _TURN else ""
    return f"moved {motion.down:.2g} px down and {motion.right:.2g} px right{turned}"


def describe_motions(motions: hdr.FrameMotions, aligned: bool) -> dict[str, Any]:
    """Return how the frames moved, as plain data for JSON."""
    rows = zip(motions.motions, motions.distances, motions.deviations, strict=True)
    return {
        "reference": motions.reference + 1,
        "moved": [one + 1 for one in motions.moved],
        "aligned": aligned,
        "frames": [
            {
                "turn_deg": math.degrees(motion.turn),
                "down_px": float(motion.down),
                "right_px": float(motion.right),
                "corner_px": distance,
                "deviation_px": deviation if math.isfinite(deviation) else None,
            }
            for motion, distance, deviation in rows
        ],
    }


def align_band(
    frames: Sequence[NDArray[Any]],
    motions: hdr.FrameMotions,
    unknown: Sequence[Mask],
    full: float,
    floor: float,
) -> tuple[list[NDArray[Any]], list[Mask]]:
    """Return a band of all frames at the places of the reference, and where each is absent.

    Frames that stand still stay as they are, and lost ones are absent. unknown: pixels that are
    clipped, or defective. full: number for those that rest on one. floor: the lowest number.
    """
    shown, absent = [], []
    for number, (frame, mask) in enumerate(zip(frames, unknown, strict=True)):
        placed, outside = frame, np.full(frame.shape, number in motions.lost)
        if number in motions.lost:
            placed = np.full(frame.shape, full, np.float32)
        elif number in motions.shifted:
            placed, rests, outside = resample_moved(frame, motions.motions[number], mask)
            placed[rests | outside] = full
            placed = np.clip(placed, floor, full)
        shown.append(placed)
        absent.append(outside)
    return shown, absent
