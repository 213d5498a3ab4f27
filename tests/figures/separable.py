"""A cubic plate's blur undone axis by axis and in two dimensions; and several depths together."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from figures import Figure
from figures.stopwatch import processor_seconds
from labapp.accuracy.blurs import Array, simulate_photograph
from labapp.files.reading import bundled_path
from optics.inverse.layered import build_layered_observation, paste_layers, restore_layers
from optics.inverse.observation import Observation
from optics.inverse.observation_builder import build_observation
from optics.inverse.restored_image import RestoredImage
from optics.inverse.separable import SeparableFilter, restore_separable, separable_parts
from optics.inverse.total_variation import total_variation
from optics.inverse.wiener import wiener
from optics.threads import single_threaded

_SIDE, _KERNEL, _MARGIN, _NOISE = 512, 47, 32, 0.01

_STRENGTH, _WAVES = 25.0, 1.5
"""Of the cubic phase at the aperture's edge, radians; of defocus there, in waves."""

_REPEATS, _SEED = 3, 1
_SAME = 1e-3
_PASTED_DB = 1.0


def cubic_kernel(strength: float, waves: float, n: int = _KERNEL) -> Array:
    """Of a slit with a cubic phase, out of focus by so many waves, on pixels of half a period of
    its cut-off: a direct sum."""
    x, u = np.linspace(-1, 1, 1601), (np.arange(8 * n) - 4 * n) / 8
    phase = strength * x**3 + 2 * np.pi * waves * x**2
    field = np.exp(-1j * np.pi * np.outer(u, x)) @ np.exp(1j * phase)
    kernel: Array = (np.abs(field) ** 2).reshape(n, 8).sum(1)
    return kernel / kernel.sum()


@single_threaded
def separable_figure(folder: Path) -> list[Figure]:
    """The same filter, the same weight, an unknown border: by both ways, interleaved."""
    down, along = cubic_kernel(_STRENGTH, _WAVES), cubic_kernel(_STRENGTH, 0.0)
    psf = np.outer(down, along)
    case = simulate_photograph("cubic plate", _photograph(_SIDE + _KERNEL - 1), psf, _NOISE, _SEED)
    truth, frame = case.truth, case.observation
    seen = _fresh(frame, psf)
    weight = wiener(seen, None, "flat").weight
    assert weight is not None
    planned = SeparableFilter(*separable_parts(torch.from_numpy(psf)), (_SIDE, _SIDE))
    data = seen.normalised_image - seen.normalised_image.mean()
    full = _same_as(planned(data, weight) + seen.normalised_image.mean(), seen, weight)
    ways: dict[str, Callable[[], object]] = {
        "separable": lambda: planned(data, weight),
        "2-D": lambda: wiener(_fresh(frame, psf), weight, "flat", steps=full.iterations - 1),
        "planning": lambda: SeparableFilter(down, along, (_SIDE, _SIDE)),
    }
    spent = processor_seconds(ways, _REPEATS)
    answer = (planned(data, weight) + seen.normalised_image.mean()).numpy()
    difference = float(np.linalg.norm(answer - full.image.numpy()) / np.linalg.norm(answer))
    largest = float(np.abs(answer - full.image.numpy()).max())
    work = _transform_work(seen.period_shape, full.iterations)
    quality = {
        "blurred": frame,
        "flat": answer,
        "neighbours": restore_separable(seen, prior="neighbours").image.numpy(),
        "each axis by itself": restore_separable(
            seen, prior="neighbours", joint=False
        ).image.numpy(),
        "2-D gradient": wiener(seen).image.numpy(),
    }
    return [
        Figure(
            "cubic plate, 512², unknown border: separable filter against the full 2-D one",
            f"same picture within {_SAME:g} L2; work and time shown",
            f"{difference:.1e} L2, at most {largest:.1e} of white; {planned.multiplications:.1e} "
            f"multiplications against {work:.1e} in {full.iterations} steps; "
            f"{1e3 * spent['separable']:.0f} ms against {1e3 * spent['2-D']:.0f} ms, "
            f"{spent['2-D'] / spent['separable']:.1f} times, "
            f"after {1e3 * spent['planning']:.0f} ms once",
            difference <= _SAME,
        ),
        Figure(
            "the same plate, separable: neighbours' prior against a flat one",
            "better",
            ", ".join(f"{name} {_psnr(one, truth):.1f} dB" for name, one in quality.items()),
            _psnr(quality["neighbours"], truth) > _psnr(quality["flat"], truth),
        ),
    ]


def _same_as(answer: torch.Tensor, seen: Observation, weight: float) -> RestoredImage:
    """The two-dimensional restoration by as few steps as come so near."""
    for steps in (5, 10, 15, 20, 30, 40, 80, 160, 320):
        full = wiener(seen, weight, "flat", steps=steps)
        left = torch.linalg.vector_norm(full.image - answer) / torch.linalg.vector_norm(answer)
        if float(left) <= _SAME:
            break
    return full


def _fresh(frame: Array, psf: Array) -> Observation:
    """With nothing computed yet."""
    return build_observation(frame.astype(np.float32), psf, _NOISE)


def _transform_work(shape: tuple[int, int], steps: int) -> float:
    """Multiplications of so many steps, four real FFTs each, of N log2(N) each (Duhamel and
    Vetterli 1990, doi 10.1016/0165-1684(90)90158-U, for complex ones of half the size), and eight
    products a frequency."""
    n = math.prod(shape)
    return float(steps * (4 * n * math.log2(n) + 8 * n))


@single_threaded
def depths_figure(folder: Path) -> list[Figure]:
    """A near disc, out of focus, before a far one in focus; both through the plate."""
    psfs = [np.outer(k, k) for k in (cubic_kernel(_STRENGTH, 2.5), cubic_kernel(_STRENGTH, 0.0))]
    whole = _photograph(256 + 2 * _MARGIN)
    near, far = whole, np.roll(whole, 70, 1)
    y, x = np.mgrid[: len(whole), : len(whole)]
    cover = (np.hypot(y - 180, x - 150) < 75).astype(np.float64)
    light = fftconvolve(cover * near, psfs[0], mode="same")
    past = 1 - fftconvolve(cover, psfs[0], mode="same")
    light += past * fftconvolve(far, psfs[1], mode="same")
    truth, layers = _cut(cover * near + (1 - cover) * far), _cut(1 - cover).astype(np.int64)
    frame = _noisy(_cut(light))
    seen = build_layered_observation(frame.astype(np.float32), psfs, layers)
    ways: dict[str, Callable[[], torch.Tensor]] = {
        "one PSF": lambda: total_variation(_fresh(frame, psfs[1])).image,
        "pasted": lambda: paste_layers(seen, total_variation),
        "together": lambda: restore_layers(seen).image,
    }
    edge = cv2.GaussianBlur(_cut(cover), (0, 0), 3)
    at = (edge > 0.02) & (edge < 0.98)
    told, found = [f"blurred {_psnr(frame, truth):.1f} dB"], dict[str, float]()
    for name, way in ways.items():
        started = time.process_time()
        picture = way().numpy()
        seconds = time.process_time() - started
        found[name] = _psnr(picture, truth, at)
        told.append(
            f"{name} {_psnr(picture, truth):.1f} dB ({found[name]:.1f} at edges, {seconds:.1f} s)"
        )
    return [
        Figure(
            "two depths in one photograph, PSF of each: together against pasted, along the edges",
            f"≥ {_PASTED_DB:g} dB better",
            ", ".join(told),
            found["together"] >= found["pasted"] + _PASTED_DB,
        )
    ]


def _noisy(frame: Array) -> Array:
    noisy: Array = frame + np.random.default_rng(_SEED).normal(0, _NOISE, frame.shape)
    return noisy


def _photograph(side: int) -> Array:
    """The bundled one in grey, mirrored where it is too small."""
    grey = cv2.imread(str(bundled_path("photograph.jpg")), cv2.IMREAD_GRAYSCALE)
    if grey is None:
        raise FileNotFoundError("photograph.jpg isn't in labapp's data; install labapp again")
    rows, columns = (max(side - n, 0) for n in grey.shape)
    wide = np.pad(grey, ((0, rows), (0, columns)), mode="reflect")
    photograph: Array = wide[:side, 100 : 100 + side].astype(np.float64) / 255.0
    return photograph


def _cut(whole: Array) -> Array:
    return whole[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN]


def _psnr(
    picture: NDArray[np.floating], truth: Array, at: NDArray[np.bool_] | None = None
) -> float:
    error = (np.clip(picture, 0, 1) - truth) ** 2
    return -10 * math.log10(float(np.mean(error if at is None else error[at])))


MEASUREMENTS = {"separable": separable_figure, "layers": depths_figure}
