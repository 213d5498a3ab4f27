"""Picture files of public formats: read as what they are, refused by name, or neither."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import tifffile
from judges.basics import natural_image
from judges.picture_files import (
    CRASHED,
    KINDS,
    NAMED,
    RIGHT,
    UNNAMED,
    WRONG,
    Finding,
    counts,
    judge_kinds,
)

from figures import Figure
from figures.stopwatch import processor_seconds

_DRAWN = 60
"""Mixtures drawn of TIFF and of PNG."""

_RIGHT_GOAL = 0.95

_REPEATS = 5

_EARLIER = {
    "PNG": 1.38,
    "PNG, 16 bits": 1.04,
    "JPEG": 1.86,
    "TIFF": 1.98,
    "TIFF, 16 bits": 1.27,
    "LZW": 1.42,
    "LZW, 16 bits": 1.11,
}
"""Processor time over that of OpenCV's decoder by the reader that took what OpenCV returned
(commit 78a56ace; medians of 5, 2 cores of a shared machine)."""

_TIMES, _TIMES_LZW = 1.1, 2.0
"""Times as long as the earlier reader that this one may take."""


def picture_files_figure(folder: Path) -> list[Figure]:
    """A file of every kind, and mixtures drawn at random, against the arrays that made them."""
    read = _reader()
    listed = judge_kinds(read, KINDS, folder)
    drawn = judge_kinds(read, _mixtures(), folder, range(1, _DRAWN + 1))
    return [
        *_count_figures(f"{len(KINDS)} kinds of picture files", listed),
        *_count_figures(f"{2 * _DRAWN} mixtures of TIFF and PNG", drawn),
        *_cost_figures(folder, read),
    ]


def _reader() -> Callable[[Path, int | None], Any]:
    """As the commands read: RAW files by their mosaic, all others as photographs."""
    from labapp.files.picture.photograph import read_photograph
    from labapp.files.raw import is_raw, read_raw

    def read(path: Path, page: int | None) -> Any:
        if is_raw(path.read_bytes(), path):
            raw = read_raw(path)
            levels = raw.mosaic[None]
            return SimpleNamespace(
                levels=levels, light=levels, encoding="linear", mosaic=raw, remarks=raw.notes
            )
        return read_photograph(path, page=page)

    return read


def _mixtures() -> list[str]:
    return [kind for kind in KINDS if kind.endswith("mixture")]


def _count_figures(what: str, found: list[Finding]) -> list[Figure]:
    fates = counts(found)
    bad = fates[WRONG], fates[UNNAMED], fates[CRASHED]
    sound = [one for one in found if one.valid]
    right = sum(one.counted == RIGHT for one in sound)
    untold = sum(bool(one.untold) for one in found)
    return [
        Figure(
            f"{what}: silently wrong; refused without a name; crashed or library's text printed",
            "0; 0; 0",
            f"{bad[0]}; {bad[1]}; {bad[2]} of {len(found)}, {fates[NAMED]} refused by name",
            not any(bad),
        ),
        Figure(
            f"{what}: sound ones that are right in light",
            f"≥ {100 * _RIGHT_GOAL:g} %",
            f"{100 * right / len(sound):.1f} % of {len(sound)}, something untold of {untold}",
            right >= _RIGHT_GOAL * len(sound),
        ),
    ]


def usual_files(folder: Path) -> dict[str, Path]:
    """Photographs of 12 million pixels as cameras and programs write them most."""
    light = natural_image(3000, 4000, 0)[..., None] ** np.array([1.0, 1.3, 0.8])
    noise = np.random.default_rng(0).normal(scale=0.01, size=light.shape)
    eight = np.rint(255 * np.clip(light + noise, 0, 1)).astype(np.uint8)
    sixteen = np.rint(65535 * np.clip(light[..., 0] + noise[..., 0], 0, 1)).astype(np.uint16)
    paths = {name: folder / f"usual-{i}" for i, name in enumerate(_WRITERS)}
    for name, write in _WRITERS.items():
        paths[name] = paths[name].with_suffix(_ENDINGS[name.split(",")[0].split()[0]])
        write(str(paths[name]), sixteen if "16" in name else eight)
    return paths


def _tiff(**options: Any) -> Callable[[str, Any], None]:
    def write(path: str, levels: Any) -> None:
        tifffile.imwrite(path, levels, photometric="rgb" if levels.ndim == 3 else None, **options)

    return write


def _opencv(path: str, levels: Any) -> None:
    cv2.imwrite(path, levels[..., ::-1] if levels.ndim == 3 else levels)


_ENDINGS = {"PNG": ".png", "JPEG": ".jpg", "TIFF": ".tif", "LZW": ".tif"}
_WRITERS: dict[str, Callable[[str, Any], None]] = {
    "PNG": _opencv,
    "PNG, 16 bits": _opencv,
    "JPEG": _opencv,
    "TIFF": _tiff(rowsperstrip=16),
    "TIFF, 16 bits": _tiff(rowsperstrip=16),
    "LZW": _tiff(compression="lzw", predictor=True, rowsperstrip=16),
    "LZW, 16 bits": _tiff(compression="lzw", predictor=True, rowsperstrip=16),
}


def cost_ratios(paths: dict[str, Path], read: Callable[[Path, int | None], Any]) -> dict[str, Any]:
    """Processor seconds of a reader, of its light, and of OpenCV's bare decoder."""

    def decode(path: Path) -> None:
        cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)

    found = {}
    for name, path in paths.items():
        jobs = {
            "levels": lambda path=path: read(path, None).levels,
            "light": lambda path=path: read(path, None).light,
            "OpenCV": lambda path=path: decode(path),
        }
        found[name] = processor_seconds(jobs, _REPEATS)
    return found


def _cost_figures(folder: Path, read: Callable[[Path, int | None], Any]) -> Iterable[Figure]:
    for name, spent in cost_ratios(usual_files(folder), read).items():
        goal = _EARLIER[name] * (_TIMES_LZW if name.startswith("LZW") else _TIMES)
        ratio = spent["levels"] / spent["OpenCV"]
        yield Figure(
            f"{name} of 12 Mpx: processor time over that of OpenCV's decoder",
            f"≤ {goal:.2f}",
            f"{ratio:.2f} ({spent['levels']:.2f} s; with light {spent['light']:.2f} s)",
            ratio <= goal,
        )


MEASUREMENTS = {"picture files": picture_files_figure}
