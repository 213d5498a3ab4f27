"""Kernels that nobody told, and pictures restored with them beside those with the true ones."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy.io
import scipy.ndimage
import torch

from figures import Figure
from labapp.accuracy.blurs import Array, shake, simulate_photograph
from labapp.files.reading import bundled_path
from optics.inverse.blind import FAIR, find_kernel
from optics.inverse.observation_builder import build_observation
from optics.inverse.total_variation import total_variation
from optics.threads import single_threaded

_SHARED = Path(__file__).parents[3] / "shared/data"
_PHOTOGRAPH = bundled_path("photograph.jpg")

_SEED, _CASES, _SIDE, _NOISE = 20, 20, 255, 0.01

_GOAL, _RATIO = 0.75, 3.0

RIM, _FARTHEST = 25, 12.0
"""Pixels at the border that aren't compared, and by which pictures may be shifted."""


@single_threaded
def blind_figures(folder: Path) -> list[Figure]:
    """Some cases, drawn by chance, of photographs and kernels."""
    rng = np.random.default_rng(_SEED)
    pictures, kernels = photographs(), known_kernels(rng)
    found = [_case(pictures, kernels, rng) for _ in range(_CASES)]
    ratios, scores = np.array(found).T
    right, trusted = ratios <= _RATIO, scores >= FAIR
    share = float(right.mean())
    what = (
        f"{_CASES} cases of {len(pictures)} photographs and {len(kernels)} kernels, seed {_SEED}, "
        f"{_SIDE}², noise {_NOISE:g} untold, border unknown"
    )
    return [
        Figure(
            "blind deconvolution, error ratio ≤ 3",
            f"≥ {_GOAL:.0%} of cases",
            f"{share:.0%}, median ratio {np.median(ratios):.2f}; trusted (score ≥ {FAIR:g}) "
            f"{trusted.sum()}, of them right {(trusted & right).sum()}; {what}",
            share >= _GOAL,
        )
    ]


def photographs() -> list[Array]:
    """Grey, full scale 1: of Kodak's that lie beside the checkout if they do, the project's own and
    scikit-image's, where that is installed."""
    files = [*sorted((_SHARED / "natural/kodak").glob("*.png")), _PHOTOGRAPH]
    found: list[Any] = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files]
    if importlib.util.find_spec("skimage"):
        data: Any = importlib.import_module("skimage.data")
        colour = (data.astronaut, data.chelsea, data.coffee, data.rocket)
        found += [data.camera(), *(cv2.cvtColor(one(), cv2.COLOR_RGB2GRAY) for one in colour)]
    large = [one for one in found if one is not None and min(one.shape) >= _SIDE + 40]
    return [np.asarray(one, dtype=np.float64) / 255 for one in large]


def known_kernels(rng: np.random.Generator) -> list[Array]:
    """Published ones that lie beside the checkout if they do, else shaken ones drawn by chance."""
    found: list[Array] = []
    packed = _SHARED / "psf/kair/kernels_12.mat"
    if packed.is_file():
        found += [np.array(one, float) for one in scipy.io.loadmat(packed)["kernels"].ravel()]
    found += [np.loadtxt(file) for file in sorted((_SHARED / "psf/csf_kernels").glob("*.dlm"))]
    found = found or [shake(length, seed) for seed, length in enumerate(rng.uniform(12, 30, 12))]
    return [one / one.sum() for one in found]


def _case(
    pictures: list[Array], kernels: list[Array], rng: np.random.Generator
) -> tuple[float, float]:
    """Error ratio and score."""
    picture = pictures[rng.integers(len(pictures))]
    kernel = kernels[rng.integers(len(kernels))]
    wide = _SIDE + max(kernel.shape) - 1
    y, x = (int(rng.integers(n - min(wide, n) + 1)) for n in picture.shape)
    scene = picture[y : y + wide, x : x + wide]
    case = simulate_photograph("", scene, kernel, _NOISE, int(rng.integers(1 << 31)))
    found = find_kernel(torch.from_numpy(case.observation), max(kernel.shape))
    return error_ratio(case.observation, np.asarray(found.psf), kernel, case.truth), found.score


def error_ratio(seen: Array, found: Array, kernel: Array, truth: Array) -> float:
    """Squares of what is wrong in the picture restored with a found kernel, over those with the
    true one (Levin et al. 2009, doi 10.1109/CVPR.2009.5206815); both shifted to fit best."""
    ours, best = (
        least_squares(np.asarray(total_variation(build_observation(seen, one)).image), truth)
        for one in (found, kernel)
    )
    return ours / best


def least_squares(picture: Array, truth: Array) -> float:
    """Of a picture less the truth, inside the rim, over shifts by parts of a pixel."""
    inside = slice(RIM, -RIM)
    offset, _ = cv2.phaseCorrelate(truth, picture)
    step, at = 0.5, -np.clip(np.array(offset)[::-1], -_FARTHEST, _FARTHEST)

    def squares(shift: Array) -> float:
        moved = scipy.ndimage.shift(picture, shift, order=3, mode="nearest")
        return float(np.square((moved - truth)[inside, inside]).sum())

    best = squares(at)
    while step > 0.03:
        tried = [at + step * np.array(way) for way in ((0, 1), (1, 0), (0, -1), (-1, 0))]
        values = [squares(one) for one in tried]
        if min(values) < best:
            best, at = min(values), tried[int(np.argmin(values))]
        else:
            step /= 2
    return best


MEASUREMENTS = {"blind": blind_figures}
