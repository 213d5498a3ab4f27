"""Brackets of 8-bit pictures as cameras make them, of photographs: response curves, noise, JPEG."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from figures import Figure
from labapp.common.errors import UserError
from labapp.pictures.merging.bracket_files import CODED_SENSOR, BracketFiles
from labapp.pictures.merging.merged_bracket import MergedFiles, merge_files
from optics import hdr
from optics.measuring import RigidMotion, resample_moved
from optics.progress import Progress
from optics.threads import single_threaded

Array = NDArray[np.float64]

_BESIDE = Path(__file__).parents[3] / "shared/data/natural"

FAULTS = {
    "time": "one time 10 to 50 % wrong",
    "turned": "one frame turned by .5 to 2°",
    "moved": "one frame moved by 1 to 8 px",
    "exchanged": "two frames exchanged",
    "none": "nothing",
}

_BRACKETS = 40
"""Of each kind."""

_ALIGNED = 30

_SEED = 20261128

_MARGIN = 14
"""Pixels of the drawn picture that a moved frame may reach beyond the border."""


@dataclass(frozen=True, eq=False)
class CodedBracket:
    """Frames (rows, columns, 3), uint8, blue first; times that are told; what is wrong.

    light: (rows, columns, 3), of the frame that stands still. turns: radians; shifts: pixels down
    and right, one for each frame: a point x of the scene, from the centre, is seen at R x + shift.
    """

    frames: list[NDArray[np.uint8]]
    told: list[float]
    true: list[float]
    light: Array
    turns: list[float]
    shifts: list[tuple[float, float]]
    fault: str
    frame: int
    curve: str


def photographs(part: str) -> list[Path]:
    """Return photographs to tune on ("tune"), or to judge on ("judge"): none is in both."""
    kodak = sorted((_BESIDE / "kodak").glob("*.png"))
    other = sorted((_BESIDE / "mcmaster").glob("*.tif"))
    return kodak[::2] + other[::2] if part == "tune" else kodak[1::2] + other[1::2]


def draw_bracket(
    path: Path, rng: np.random.Generator, fault: str, frames: int | None = None
) -> CodedBracket:
    """Return a bracket of a photograph with one fault, or none."""
    scene = _scene(path, rng)
    count = int(rng.integers(3, 10)) if frames is None else frames
    # More than 14 stops show nothing in most frames.
    step = float(rng.uniform(2, min(8.0, 2.0 ** (14 / (count - 1)))))
    true = 2.0 ** -rng.uniform(4, 9) * step ** np.arange(count)
    wrong = int(rng.integers(count))
    turns, shifts, told = [0.0] * count, [(0.0, 0.0)] * count, true.copy()
    if fault == "time":
        told[wrong] *= (1 + rng.uniform(0.1, 0.5)) ** rng.choice([-1, 1])
    elif fault == "turned":
        turns[wrong] = float(np.deg2rad(rng.uniform(0.5, 2) * rng.choice([-1, 1])))
    elif fault == "moved":
        way, far = rng.uniform(0, 2 * np.pi), rng.uniform(1, 8)
        shifts[wrong] = (far * np.sin(way), far * np.cos(way))
    elif fault == "exchanged":
        other = int(rng.choice([k for k in range(count) if k != wrong]))
        told[[wrong, other]] = told[[other, wrong]]
    elif fault == "held":
        turns = np.deg2rad(rng.normal(0, 0.4, count)).tolist()
        shifts = [tuple(one) for one in rng.normal(0, 3, (count, 2))]
        turns[count // 2], shifts[count // 2] = 0.0, (0.0, 0.0)
    name, curve = _curve(rng)
    full = rng.uniform(4_000, 30_000)
    read = rng.uniform(2, 12)
    quality = int(rng.integers(85, 99)) if rng.random() < 0.5 else None
    middle = true[0] * step ** ((count - 1) / 2)
    key = np.exp(np.log(scene[scene > 0]).mean())
    gain = rng.uniform(0.1, 0.3) / key / middle
    shown = []
    for time, turn, shift in zip(true, turns, shifts, strict=True):
        light = _warped(scene, turn, shift) * time * gain
        electrons = rng.poisson(np.minimum(light, 4) * full) + rng.normal(0, read, light.shape)
        numbers = np.clip(np.rint(255 * curve(np.clip(electrons / full, 0, 1))), 0, 255)
        shown.append(_stored(numbers.astype(np.uint8), quality))
    still = _warped(scene, 0.0, (0.0, 0.0)) * gain
    return CodedBracket(
        shown, told.tolist(), true.tolist(), still, turns, shifts, fault, wrong, name
    )


def _scene(path: Path, rng: np.random.Generator) -> Array:
    """Return the light of a photograph, twice as fine as frames are; half of them lit unevenly."""
    stored = cv2.imread(str(path), cv2.IMREAD_COLOR)
    light = ((stored / 255 + 0.055) / 1.055) ** 2.4
    if rng.random() < 0.5:
        rows, columns = (np.linspace(-1, 1, n) for n in light.shape[:2])
        place = rng.uniform(-0.7, 0.7, 2)
        far = np.hypot(rows[:, None] - place[0], columns - place[1])
        light = light * np.exp(rng.uniform(1, 4) * (1 - far))[..., None]
    return np.ascontiguousarray(light + 1e-4 * light.max())


def _warped(scene: Array, turn: float, shift: tuple[float, float]) -> Array:
    """Return the scene as a frame sees it, half as fine, without the margin."""
    rows, columns = scene.shape[:2]
    centre = np.array([(columns - 1) / 2, (rows - 1) / 2])
    cos, sin = np.cos(turn), np.sin(turn)
    # A frame's pixel y sees the scene's point x with y = R x + s, in (column, row).
    turned = np.array([[cos, sin], [-sin, cos]])
    back = np.linalg.inv(turned)
    moved = np.array([2 * shift[1], 2 * shift[0]])
    matrix = np.column_stack([back, centre - back @ (centre + moved)])
    seen = cv2.warpAffine(
        scene.astype(np.float32), matrix, (columns, rows),
        flags=cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REFLECT,
    )  # fmt: skip
    seen = np.maximum(seen, scene.min())
    seen = seen[: rows // 2 * 2, : columns // 2 * 2]
    half = seen.reshape(rows // 2, 2, columns // 2, 2, 3).mean(axis=(1, 3), dtype=np.float64)
    return half[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN]


def _curve(rng: np.random.Generator) -> tuple[str, Any]:
    """Return a camera's response curve, of light 0 to 1: sRGB's, a gamma, or S-shaped."""
    kind = rng.choice(["sRGB", "gamma", "S"])
    if kind == "sRGB":
        return "sRGB", _srgb
    if kind == "gamma":
        power = rng.uniform(1.6, 2.6)
        return f"gamma {power:.2f}", lambda light: light ** (1 / power)
    steep = rng.uniform(0.3, 1)

    def s_shaped(light: Array) -> Array:
        coded = _srgb(light)
        return (1 - steep) * coded + steep * coded**2 * (3 - 2 * coded)

    return f"S {steep:.2f}", s_shaped


def _srgb(light: Array) -> Array:
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def _stored(numbers: NDArray[np.uint8], quality: int | None) -> NDArray[np.uint8]:
    """Return a picture as a file gives it back: PNG, or JPEG of a quality."""
    if quality is None:
        return numbers
    _, data = cv2.imencode(".jpg", numbers, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return cv2.imdecode(data, cv2.IMREAD_COLOR)


@single_threaded
def coded_bracket_figures(folder: Path) -> list[Figure]:
    """Brackets of photographs on which nothing was tuned: 3 to 9 frames, factors of 2 to 8."""
    if not photographs("judge"):
        return []
    rng = np.random.default_rng(_SEED)
    return [*_named_figures(rng), *_aligned_figures(rng)]


def _named_figures(rng: np.random.Generator) -> list[Figure]:
    """How many brackets of each fault are named, by a warning or a refusal."""
    found, files = [], photographs("judge")
    for fault, words in FAULTS.items():
        named = sum(
            bool(_words(draw_bracket(files[rng.integers(len(files))], rng, fault)))
            for _ in range(_BRACKETS)
        )
        sound = fault == "none"
        least = math.ceil(0.95 * _BRACKETS)
        found.append(
            Figure(
                f"8-bit brackets, {words} wrong: named"
                if sound
                else f"8-bit brackets, {words}: named",
                "<= 1 of 40" if sound else f">= {least} of {_BRACKETS}",
                f"{named} of {_BRACKETS}",
                named <= 1 if sound else named >= least,
            )
        )
    return found


def _aligned_figures(rng: np.random.Generator) -> list[Figure]:
    """Corners of aligned frames, and pixels within 2 % of the light, beside the true motion's."""
    errors: list[float] = []
    good = np.zeros(2)
    files = photographs("judge")
    for number in range(_ALIGNED):
        fault = ("turned", "moved", "held")[number % 3]
        drawn = draw_bracket(files[rng.integers(len(files))], rng, fault)
        merged = merge_drawn(drawn, align=True)
        assert merged.motions is not None
        true = true_motions(drawn, merged.motions)
        errors += [
            one.corner_distance(other, true.shape)
            for k, (one, other) in enumerate(zip(merged.motions.motions, true.motions, strict=True))
            if k != true.reference
        ]
        good += _within(drawn, merged), _within(drawn, merge_drawn(drawn, True, true))
    share = float((np.array(errors) <= 0.25).mean())
    ratio = good[0] / good[1]
    return [
        Figure(
            "8-bit brackets aligned, frames with corners right to .25 px",
            ">= 95 %",
            f"{share:.1%} of {len(errors)}; median error {np.median(errors):.3f} px",
            share >= 0.95,
        ),
        Figure(
            "8-bit brackets aligned, pixels within 2 % of the light, over those by the true motion",
            ">= .95",
            f"{ratio:.3f}",
            bool(ratio >= 0.95),
        ),
    ]


def merge_drawn(
    drawn: CodedBracket, align: bool = False, motions: hdr.FrameMotions | None = None
) -> MergedFiles:
    """Merge a drawn bracket as `labapp merge` does; motions: in the place of those found."""
    frames = [np.ascontiguousarray(np.moveaxis(one[..., ::-1], -1, 0)) for one in drawn.frames]
    count = len(frames)
    source = BracketFiles(
        [str(k) for k in range(count)], frames, list(drawn.told), [0.0] * count,
        [math.inf] * count, CODED_SENSOR, is_coded=True, may_move=True,
    )  # fmt: skip
    return merge_files(source, "full", True, Progress(), align, motions)


def _words(drawn: CodedBracket) -> list[str]:
    """What the command says against a bracket."""
    try:
        return [one for one in merge_drawn(drawn).told if "was measured on them" not in one]
    except UserError as error:
        return [str(error)]


def true_motions(drawn: CodedBracket, found: hdr.FrameMotions) -> hdr.FrameMotions:
    """The motions that were drawn, against the frame that was found to stand still."""
    moved = [
        RigidMotion(turn, float(down), float(right))
        for turn, (down, right) in zip(drawn.turns, drawn.shifts, strict=True)
    ]
    back = moved[found.reference].inverse()
    true = tuple(one.after(back) for one in moved)
    return hdr.FrameMotions(found.reference, true, (0.0,) * len(true), found.shape)


def _within(drawn: CodedBracket, merged: MergedFiles) -> float:
    """Pixels of the merged light within 2 % of the scene's, whose unit is that of the median."""
    assert merged.motions is not None
    reference = merged.motions.reference
    moved = RigidMotion(drawn.turns[reference], *map(float, drawn.shifts[reference]))
    count = 0
    for number in range(3):
        light = drawn.light[..., 2 - number]
        nothing = np.zeros(light.shape, dtype=bool)
        true, _, outside = resample_moved(light, moved.inverse(), nothing)
        ratio = merged.rate[number] / np.maximum(true, 1e-9)
        seen = ~outside & (merged.state[number] == hdr.VALID)
        count += int((np.abs(ratio[seen] / np.median(ratio[seen]) - 1) < 0.02).sum())
    return count


MEASUREMENTS = {"coded-brackets": coded_bracket_figures}
