"""Levin's 32 real photographs with measured kernels, where they lie in the folder LEVIN.

Levin et al. (2009, doi 10.1109/CVPR.2009.5206815) took four pictures through eight camera shakes,
and measured the kernels. They may not be passed on. The folder holds im1.png to im4.png,
kernel1.png to kernel8.png and im1_kernel1_img.png to im4_kernel8_img.png.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from figures import Figure
from figures.blind import RIM, least_squares
from labapp.accuracy.blurs import Array
from labapp.pictures.networks import bundled_denoiser
from optics.inverse.blind import find_kernel
from optics.inverse.choice import restore
from optics.inverse.observation_builder import build_observation
from optics.threads import single_threaded

_UPRIGHT = (4, 8)
"""Kernels that are stored upright; the others are turned by half."""

_NONE = "not measured: set LEVIN to the folder of the photographs"
_TIERS = ("wiener", "total-variation", "plug-and-play")
_NEAR = 4.0
"""Decibels below the true kernel's restoration within which a blind one is near."""


@dataclass(frozen=True, eq=False)
class _Photograph:
    truth: Array
    seen: Array
    kernel: Array

    def psnr(self, image: Array) -> float:
        """Of a picture that is shifted to fit best, without the rim; white is 1."""
        error = least_squares(np.asarray(image, dtype=np.float64).clip(0, 1), self.truth)
        rows, columns = self.truth.shape
        return -10 * float(np.log10(error / ((rows - 2 * RIM) * (columns - 2 * RIM))))


def _photographs(folder: Path) -> Iterator[_Photograph]:
    for scene in range(1, 5):
        for number in range(1, 9):
            kernel = _read(folder / f"kernel{number}.png")
            kernel = kernel if number in _UPRIGHT else kernel[::-1, ::-1].copy()
            seen = _read(folder / f"im{scene}_kernel{number}_img.png")
            yield _Photograph(_read(folder / f"im{scene}.png"), seen, kernel / kernel.sum())


def _read(file: Path) -> Array:
    stored = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    if stored is None:
        raise FileNotFoundError(f"{file} is no picture that can be read")
    return np.asarray(stored, dtype=np.float64) / 255


@single_threaded
def measured_kernels(folder: Path) -> list[Figure]:
    """Nothing is told; three tiers."""
    name = "Levin's 32, measured kernels: mean / worst of default, dearest and cheapest tier"
    goal = "default ≥ 34.9 / 32.5, dearest ≥ 35.6 / 32.8 dB, each dearer ≥ every cheaper"
    place = os.environ.get("LEVIN")
    if place is None:
        return [Figure(name, goal, _NONE, None)]
    denoise = bundled_denoiser()
    levels = np.array(
        [
            [
                one.psnr(
                    restore(
                        build_observation(one.seen.astype(np.float32), one.kernel),
                        method=tier,
                        denoise=denoise if tier == "plug-and-play" else None,
                    ).image
                )
                for tier in _TIERS
            ]
            for one in _photographs(Path(place))
        ]
    )
    means, worsts = levels.mean(0), levels.min(0)
    words = ", ".join(
        f"{tier} {mean:.2f} / {worst:.2f}"
        for tier, mean, worst in zip(_TIERS, means, worsts, strict=True)
    )
    met = (
        means[1] >= 34.9 and worsts[1] >= 32.5 and means[2] >= 35.6 and worsts[2] >= 32.8
        and bool((np.diff(means) >= 0).all())
    )  # fmt: skip
    return [Figure(name, goal, f"{words} dB", met)]


@single_threaded
def unknown_kernels(folder: Path) -> list[Figure]:
    """As `labapp reconstruct --blind` restores them, the largest side of the kernel told."""
    name = "Levin's 32, blind: mean; below the photograph as taken"
    goal = "≥ 31.5 dB; 0"
    place = os.environ.get("LEVIN")
    if place is None:
        return [Figure(name, goal, _NONE, None)]
    rows = []
    for one in _photographs(Path(place)):
        found = find_kernel(one.seen, max(one.kernel.shape))
        seen = one.seen.astype(np.float32)
        blind, true = (
            one.psnr(restore(build_observation(seen, kernel)).image)
            for kernel in (np.asarray(found.psf), one.kernel)
        )
        good = found.verdict.startswith("good")
        rows.append((blind, true, one.psnr(one.seen), good))
    blind, true, before, good = np.array(rows).T
    near, called = true - blind <= _NEAR, good > 0
    sound = (near & called).sum() / max(called.sum(), 1)
    found_share = (near & called).sum() / max(near.sum(), 1)
    return [
        Figure(
            name,
            goal,
            f"{blind.mean():.2f} dB, worst {blind.min():.2f}; {(blind < before).sum()}",
            bool(blind.mean() >= 31.5 and not (blind < before).any()),
        ),
        Figure(
            "Levin's 32, blind: of those called good, within 4 dB of the true kernel's; of those "
            "within, called good",
            "≥ 85 %; ≥ 60 %",
            f"{sound:.0%} of {called.sum()}; {found_share:.0%} of {near.sum()}",
            bool(sound >= 0.85 and found_share >= 0.6),
        ),
    ]


MEASUREMENTS = {"levin": measured_kernels, "levin-blind": unknown_kernels}
