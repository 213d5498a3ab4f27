"""The PSFs that restorations are compared on, and simulated photographs that they blur."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.fft import irfft2, rfft2
from scipy.signal import fftconvolve

from labapp.accuracy.option_validation import BLUR_NAMES, require_blur
from labapp.common.errors import UserError
from labapp.files.picture.encoding import LINEAR
from labapp.files.picture.photograph import read_photograph
from labapp.files.reading import bundled_path
from labapp.pictures.reconstructing.psf_files import read_psf_file
from labapp.pictures.reconstructing.recorded_photograph import RecordSelection
from optics import targets
from optics.inverse.blur import Border
from optics.inverse.observation import Observation
from optics.inverse.observation_builder import build_observation
from optics.metrics import psnr, ssim
from optics.plane import Plane
from optics.targets.strokes import draw_strokes

Array = NDArray[np.float64]

_FINER = 16
"""Samples per pixel in each direction, from which the covered share of a pixel is computed."""


@dataclass(frozen=True, eq=False)
class SimulatedPhotograph:
    """A simulated blurred photograph of a known scene, (rows, columns), where white is 1.

    truth: what a camera without blur and noise would have seen.
    psf: its sum is 1, its origin lies at n // 2.
    noise: standard deviation of a pixel.
    border: what the scene does beyond the frame.
    """

    name: str
    truth: Array
    observation: Array
    psf: Array
    noise: float
    border: Border

    @property
    def problem(self) -> Observation:
        """What every method restores: the picture in single precision, of unknown noise."""
        return build_observation(self.observation.astype(np.float32), self.psf, None, self.border)

    def quality(self, image: torch.Tensor | Array) -> tuple[float, float]:
        """Return the PSNR in dB and SSIM of a restoration, clipped to 0 to 1, over the frame."""
        seen = np.clip(np.asarray(image, dtype=np.float64), 0, 1)
        return psnr(seen, self.truth), ssim(seen, self.truth)


def simulate_photograph(
    name: str, scene: Array, psf: Array, noise: float, seed: int, border: Border = "unknown"
) -> SimulatedPhotograph:
    """Blur a known scene, (rows, columns), by convolution with a PSF, and add Gaussian noise.

    With an unknown border the photograph shows only the part of the scene whose light comes
    entirely from within the scene. A periodic scene is shown whole. Raises UserError for a scene
    that is no larger than the PSF.
    """
    if any(n <= m for n, m in zip(scene.shape, psf.shape, strict=True)):
        raise UserError(f"{name} is {scene.shape}, no larger than its PSF, {psf.shape}.")
    truth, frame = scene, scene
    if border == "periodic":
        rows, columns = psf.shape
        room = [(0, n - m) for n, m in zip(scene.shape, psf.shape, strict=True)]
        whole = np.roll(np.pad(psf, room), (-(rows // 2), -(columns // 2)), (0, 1))
        frame = irfft2(rfft2(scene) * rfft2(whole), s=scene.shape)
    else:
        frame = np.asarray(fftconvolve(scene, psf, mode="valid"))
        # The part of the scene that the photograph shows.
        top, left = (m - 1 - m // 2 for m in psf.shape)
        truth = scene[top : top + frame.shape[0], left : left + frame.shape[1]]
    noisy = frame + np.random.default_rng(seed).normal(0, noise, frame.shape)
    return SimulatedPhotograph(name, truth, noisy, psf, noise, border)


def photograph_from_options(
    picture: Path | None,
    blur: str,
    psf: Path | None,
    noise: float,
    border: str,
    size: int,
    seed: int,
) -> SimulatedPhotograph:
    """Simulate the photograph that the options of `labapp accuracy deconvolve` describe.

    Raises UserError for options that are unknown or can't be met.
    """
    require_blur(blur, border)
    if psf is None:
        kernel = BLURS[blur]()
    else:
        kernel = read_psf_file(psf, 1, RecordSelection())[0][0].astype(np.float64)
    levels = read_photograph(picture or bundled_path("photograph.jpg"), encoding=LINEAR).light
    grey = levels.mean(0, dtype=np.float64)
    if not (np.isfinite(grey).all() and grey.max() > 0):
        raise UserError(f"{picture}: is dark, or not finite. Give a picture with light in it.")
    # White is the first of these that no level of the picture exceeds, or else its brightest.
    brightest = float(levels.max())
    white = next((top for top in (1.0, 255.0, 65535.0) if brightest <= top), brightest)
    rows, columns = (slice((n - min(n, size)) // 2, (n + min(n, size)) // 2) for n in grey.shape)
    scene = np.ascontiguousarray((grey / white)[rows, columns])
    name = f"{blur if psf is None else psf.name}, noise {noise:g}, {scene.shape}, {border} border"
    return simulate_photograph(name, scene, kernel, noise, seed, cast(Border, border))


def disk(radius: float) -> Array:
    """Return the defocus PSF of geometrical optics: an even disk of `radius` pixels."""
    at = _subpixel_positions(radius)
    return _pixel_coverage(np.hypot(at[:, None], at) <= radius)


def box(side: int) -> Array:
    """Return an even square of `side` by `side` pixels."""
    return np.full((side, side), side**-2.0)


def gaussian(deviation: float) -> Array:
    """Return a Gaussian PSF. deviation: standard deviation in pixels."""
    reach = math.ceil(4 * deviation)
    at = np.arange(-reach, reach + 1) / deviation
    psf = np.exp(-(at[:, None] ** 2 + at**2) / 2)
    return _normalise(psf)


def circle(radius: float, centre: float) -> Array:
    """Return a circle, one pixel wide, around a pixel that has a share `centre` of the light."""
    at = _subpixel_positions(radius + 3)
    far = np.hypot(at[:, None], at)
    psf = (1 - centre) * _pixel_coverage(np.abs(far - radius) <= 0.5)
    psf[psf.shape[0] // 2, psf.shape[1] // 2] += centre
    return psf


def shake(length: float, seed: int) -> Array:
    """Return a camera-shake PSF: a random path of about `length` pixels."""
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0, 0.45, 24)) + rng.uniform(0, 2 * math.pi)
    steps = length / 24 * np.stack([np.sin(turn), np.cos(turn)], axis=1)
    path = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    return _rasterise_strokes([path - path.mean(0)], math.ceil(length))


def line(length: float, angle: float) -> Array:
    """Return the PSF of uniform motion of `length` pixels; angle: from x to y, in radians."""
    end = 0.5 * length * np.array([math.sin(angle), math.cos(angle)])
    return _rasterise_strokes([np.stack([-end, end])], math.ceil(length))


def shape(name: str, radius: float) -> Array:
    """Return a PSF shape of the thesis, such as "ring", with a radius in pixels."""
    side = 2 * math.ceil(radius + 6) + 1
    target = getattr(targets, name)
    return _normalise(np.asarray(target(Plane((side, side), (1.0, 1.0)), radius, 0.8)))


_MAKERS: dict[str, Callable[..., Array]] = {
    one.__name__: one for one in (disk, gaussian, box, line, shake, circle, shape)
}

BLURS: dict[str, Callable[[], Array]] = {
    name: partial(_MAKERS[maker], *sizes) for name, (maker, sizes) in BLUR_NAMES.items()
}
"""Functions that compute the PSF of each named blur."""


def _subpixel_positions(radius: float) -> Array:
    """Return positions along an axis, several per pixel: an odd number of pixels around a disk."""
    side = 2 * math.ceil(radius) + 1
    return (np.arange(side * _FINER) + 0.5) / _FINER - side / 2


def _pixel_coverage(inside: NDArray[np.bool_]) -> Array:
    """Average fine samples over each pixel."""
    side = inside.shape[0] // _FINER
    return _normalise(inside.reshape(side, _FINER, side, _FINER).mean((1, 3)))


def _rasterise_strokes(strokes: list[Array], reach: int) -> Array:
    plane = Plane((2 * reach + 9, 2 * reach + 9), (1.0, 1.0))
    psf = np.asarray(draw_strokes(strokes, 0.7, "the path", "make it shorter").render(plane))
    lit = np.argwhere(psf > 1e-4 * psf.max())
    half = int(np.abs(lit - np.array(psf.shape) // 2).max())
    middle = psf.shape[0] // 2
    return _normalise(psf[middle - half : middle + half + 1, middle - half : middle + half + 1])


def _normalise(psf: Array) -> Array:
    return psf / psf.sum()
