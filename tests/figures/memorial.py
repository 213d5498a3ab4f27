"""Merging of Debevec's 8-bit pictures of the Stanford Memorial Church, beside OpenCV's merges."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from figures import Figure
from optics.hdr import fit_response, merge_by_response
from optics.threads import single_threaded

_FOLDER = Path(__file__).parents[3] / "shared/data/hdr/memorial"
_TIMES = np.array([32, 16, 8, 4, 2, 1, 0.5, 0.25], np.float32)
_GOAL = 0.19
_LUMINANCE = np.array([0.0722, 0.7152, 0.2126])
"""Of blue, green and red, ITU-R BT.709."""


@single_threaded
def memorial_figures(folder: Path) -> list[Figure]:
    """Scatter of log2 of the ratio to memorial.hdr, which Debevec made of all 16 exposures.

    The same pixels for all: numbers from 5 to 250 in two of the eight frames at least, in each
    colour, outside the blue borders.
    """
    if not _FOLDER.exists():
        return []
    frames = np.array([cv2.imread(str(_FOLDER / f"memorial{61 + k:04d}.png")) for k in range(8)])
    published = cv2.imread(str(_FOLDER / "memorial.hdr"), cv2.IMREAD_UNCHANGED)
    border = ((frames[..., 0] == 255) & (frames[..., 1:] == 0).all(axis=-1)).any(axis=0)
    seen = (((frames >= 5) & (frames <= 250)).sum(axis=0) >= 2).all(axis=-1)
    seen &= ~border & (published > 0).all(axis=-1)
    every = list(frames)
    merges = {
        "response curve": np.stack(
            [
                merge_by_response(one, _TIMES, fit_response(one, _TIMES)).rate.numpy()
                for one in np.moveaxis(frames, -1, 0)
            ],
            axis=-1,
        ),
        "OpenCV, Debevec": cv2.createMergeDebevec().process(
            every, _TIMES, cv2.createCalibrateDebevec().process(every, _TIMES)
        ),
        "OpenCV, Robertson": cv2.createMergeRobertson().process(
            every, _TIMES, cv2.createCalibrateRobertson().process(every, _TIMES)
        ),
    }
    found = []
    for name, weights in (("mean of the colours", np.ones(3) / 3), ("luminance", _LUMINANCE)):
        spread = {
            kind: float(np.log2((light @ weights)[seen] / (published @ weights)[seen]).std())
            for kind, light in merges.items()
        }
        ours, *others = spread.values()
        found.append(
            Figure(
                f"Memorial Church, scatter of log₂ of the ratio to the published radiance, {name}",
                f"≤ {_GOAL:g}, below OpenCV's",
                ", ".join(f"{kind} {value:.3f}" for kind, value in spread.items())
                + f"; {int(seen.sum())} pixels",
                ours <= _GOAL and ours < min(others),
            )
        )
    return found


MEASUREMENTS = {"memorial": memorial_figures}
