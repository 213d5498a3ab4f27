"""Phase retrieval: what an iteration costs, and how good patterns and videos are for their time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy.fft
import torch
from numpy.typing import NDArray

from figures import Figure
from figures.stopwatch import processor_seconds
from labapp.common.speed import machine_speed
from optics.camera import Camera, Panel
from optics.fourier import CommensurateTransform, FourierGeometry
from optics.plane import Plane, centred_crop
from optics.retrieval import (
    PatternQuality,
    RetrievalResult,
    design_plane,
    retrieve,
    window_for_reach,
)
from optics.retrieval.far_field import FarField
from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.phase_retrieval import measure_quality
from optics.retrieval.slow_crystal import displayed_psf
from optics.targets import Target, ring, spiral
from optics.threads import single_threaded

_WAVELENGTH = 550e-9
_CAMERA = Camera(Panel())
_LENGTH, _WINDOW = 2048, 160
_REPEATS = 9
_AT_ONCE = 5
"""Iterations of slmsuite in a call, so that what it does around them counts little."""

_PUBLISHED = "shared/data/thesis/phase_retrieval/results/phase_pattern_images/r_30p"

Field = NDArray[np.complex64]


@single_threaded
def iteration_cost(folder: Path) -> list[Figure]:
    """One iteration beside an FFT pair of its grid, and both after thirty of them."""
    shape = _CAMERA.panel.shape
    far_field = FarField(shape, _LENGTH, (_WINDOW, _WINDOW))
    plane = Plane((_WINDOW, _WINDOW), (1e-6, 1e-6))
    amplitude = torch.sqrt(ring(plane, 50e-6, 6e-6)).to(torch.float32)
    rng = np.random.default_rng(0)
    start = np.exp(2j * np.pi * rng.random(shape)).astype(np.complex64)
    field = far_field.forward(torch.from_numpy(start))
    whole = np.zeros((_LENGTH, _LENGTH), dtype=np.complex64)
    whole[: shape[0], : shape[1]] = start

    def ours() -> torch.Tensor:
        return far_field.round_trip(torch.sgn(field) * amplitude)

    def pair() -> Field:
        return np.asarray(scipy.fft.ifft2(scipy.fft.fft2(whole)))

    jobs: dict[str, Callable[[], Any]] = {"ours": ours, "pair": pair}
    slmsuite = _slmsuite_iteration()
    if slmsuite is not None:
        jobs["slmsuite"] = slmsuite
    times = processor_seconds(jobs, _REPEATS)
    ratio = times["ours"] / times["pair"]
    miss = _phase_difference(start, amplitude.numpy(), far_field)
    told = f"{ratio:.2f} ({1e3 * times['ours']:.0f} ms), phase within {miss:.1g} rad"
    found = [
        Figure(
            "a Gerchberg-Saxton iteration, 1080x1920 in 2048², time over that of an FFT pair",
            "≤ 0.35, phase within 0.01 rad of the full transform after 30",
            told,
            ratio <= 0.35 and miss <= 0.01,
        )
    ]
    name, goal = "slmsuite's time over ours for the same iteration", "≥ 15"
    if slmsuite is None:
        return [*found, Figure(name, goal, "slmsuite isn't installed", None)]
    faster = times["slmsuite"] / _AT_ONCE / times["ours"]
    return [*found, Figure(name, goal, f"{faster:.0f}", faster >= 15)]


def _slmsuite_iteration() -> Callable[[], Any] | None:
    """Iterations of slmsuite on the same panel, grid and target; None if it isn't installed."""
    try:
        from slmsuite.holography.algorithms import Hologram
    except ImportError:
        return None
    target = np.zeros((_LENGTH, _LENGTH), dtype=np.float32)
    plane = Plane((_WINDOW, _WINDOW), (1e-6, 1e-6))
    first = (_LENGTH - _WINDOW) // 2
    inside = slice(first, first + _WINDOW)
    target[inside, inside] = np.sqrt(ring(plane, 50e-6, 6e-6).numpy())
    hologram = Hologram(target, slm_shape=_CAMERA.panel.shape)
    return lambda: hologram.optimize("GS", maxiter=_AT_ONCE, verbose=False)


def _phase_difference(start: Field, amplitude: NDArray[Any], far_field: FarField) -> float:
    """99.9th percentile, after thirty iterations, against whole FFTs of every sample."""
    rows, columns = start.shape
    wanted = np.zeros((_LENGTH, _LENGTH), dtype=np.float32)
    first = _LENGTH // 2 - _WINDOW // 2
    inside = slice(first, first + _WINDOW)
    wanted[inside, inside] = amplitude
    wanted = scipy.fft.ifftshift(wanted)
    whole = start
    field = far_field.forward(torch.from_numpy(start))
    pruned = torch.from_numpy(start)
    for iteration in range(30):
        far = scipy.fft.fft2(whole, s=(_LENGTH, _LENGTH))
        back = scipy.fft.ifft2(far / np.maximum(np.abs(far), 1e-30) * wanted)
        back = back[:rows, :columns]
        whole = (back / np.maximum(np.abs(back), 1e-30)).astype(np.complex64)
        asked = torch.sgn(field) * torch.from_numpy(amplitude)
        if iteration < 29:
            field = far_field.round_trip(asked)
        else:
            pruned = far_field.adjoint(asked)
    difference = np.abs(np.angle(pruned.numpy() * whole.conj()))
    return float(np.percentile(difference, 99.9))


def _target(shape: Target[..., Any], *sizes: float) -> Callable[[Camera], RetrievalGoal]:
    """A target of sizes in units of the panel's diffraction limit, wavelength z / width."""

    def goal(camera: Camera) -> RetrievalGoal:
        width = max(camera.panel.shape) * camera.panel.pitch
        unit = _WAVELENGTH * camera.lens.image_distance / width
        lengths = [size * unit for size in sizes]
        window = window_for_reach(camera, _WAVELENGTH, shape.reach(*lengths))
        plane = design_plane(camera, _WAVELENGTH, window)
        return RetrievalGoal(camera, shape(plane, *lengths), plane, _WAVELENGTH)

    return goal


_SPIRAL = _target(spiral, 50.0, 1.75)
_RING = _target(ring, 25.0, 3.1)
"""The thesis' sizes: 50 samples to the spiral's end, 25 to the ring, of 1920."""


def _retrieved(goal: RetrievalGoal, **options: Any) -> RetrievalResult:
    generator = torch.Generator().manual_seed(1)
    return retrieve(
        goal.camera,
        goal.target,
        goal.plane,
        goal.wavelength,
        generator=generator,
        speed=machine_speed(),
        **options,
    )


def _warm() -> None:
    """What is made once, and is no part of a retrieval's time."""
    _retrieved(_RING(_CAMERA), iterations=2)


def _told(found: RetrievalResult) -> str:
    q = found.quality
    return (
        f"steered share {q.steered_share:.3f}, efficiency {q.efficiency:.3f} of all light, "
        f"contrast {q.contrast:.4f}, NRMSE {q.nrmse:.3f} "
        f"in {found.cpu_seconds:.2f} s ({found.method}, {found.iterations} iterations)"
    )


@single_threaded
def single_frames(folder: Path) -> list[Figure]:
    """One frame of 1080x1920 pixels, 8 bit, judged on a grid twice finer than Nyquist."""
    _warm()
    one = _retrieved(_SPIRAL(_CAMERA), budget=1.5)
    other = _retrieved(_RING(_CAMERA), budget=0.2)
    return [
        Figure(
            "one frame for a spiral PSF",
            "steered share ≥ .92, contrast ≤ .20 in ≤ 1.5 s",
            _told(one),
            _good(one.quality, 0.92, 0.20) and one.cpu_seconds <= 1.5,
        ),
        Figure(
            "one frame for a ring PSF",
            "steered share ≥ .94, contrast ≤ .16 in ≤ 0.2 s",
            _told(other),
            _good(other.quality, 0.94, 0.16) and other.cpu_seconds <= 0.2,
        ),
    ]


def _good(
    quality: PatternQuality, efficiency: float, contrast: float, nrmse: float = np.inf
) -> bool:
    return (
        quality.steered_share >= efficiency
        and quality.contrast <= contrast
        and quality.nrmse <= nrmse
    )


@single_threaded
def several_frames(folder: Path) -> list[Figure]:
    """Videos for the spiral, whose mean counts."""
    _warm()
    eight = _retrieved(_SPIRAL(_CAMERA), frames=8, budget=3.0)
    many = _retrieved(_SPIRAL(_CAMERA), frames=24, budget=9.0)
    return [
        Figure(
            "8 frames for a spiral PSF",
            "contrast ≤ .02, NRMSE ≤ .03, steered share ≥ .90 in ≤ 3 s",
            _told(eight),
            _good(eight.quality, 0.90, 0.02, 0.03) and eight.cpu_seconds <= 3,
        ),
        Figure(
            "24 frames for a spiral PSF",
            "contrast ≤ .01 in ≤ 9 s",
            _told(many),
            _good(many.quality, 0.0, 0.01) and many.cpu_seconds <= 9,
        ),
    ]


@single_threaded
def slow_crystal(folder: Path) -> list[Figure]:
    """8 frames at 60 Hz on a liquid crystal of 5 ms, with and without knowing of it."""
    slow = replace(_CAMERA, panel=replace(_CAMERA.panel, response_time=5e-3))
    still, moving = _SPIRAL(_CAMERA), _SPIRAL(slow)
    blind = _retrieved(still, frames=8, iterations=100)
    aware = _retrieved(moving, frames=8, iterations=100)
    shown = measure_quality(moving, displayed_psf(moving, blind.phases, 1))
    lost = blind.quality.steered_share - shown.steered_share
    recovered = (aware.quality.steered_share - shown.steered_share) / lost
    return [
        Figure(
            "8 frames at 60 Hz, response time 5 ms: lost share that is recovered",
            "≥ 50 %",
            f"{recovered:.0%}: {blind.quality.steered_share:.3f} standing, "
            f"{shown.steered_share:.3f} moving, {aware.quality.steered_share:.3f} aware of it; "
            f"contrast {shown.contrast:.3f} and {aware.quality.contrast:.3f}",
            recovered >= 0.5,
        )
    ]


def published_patterns(folder: Path) -> list[Figure]:
    """The thesis authors' own patterns, where they lie beside the checkout."""
    name, goal = "published patterns against the PSFs published with them", "correlation ≥ .999"
    where = Path(__file__).parents[3] / _PUBLISHED
    if not where.is_dir():
        return [Figure(name, goal, "the patterns aren't beside the checkout", None)]
    found = {i: _correlation(where, i) for i in ("1", "569(min_constraint)")}
    told = ", ".join(f"{value:.4f} at {i.split('(')[0]}" for i, value in found.items())
    return [Figure(name, goal, f"{told} iterations", min(found.values()) >= 0.999)]


def _correlation(where: Path, iteration: str) -> float:
    """Of a pattern's far field with the picture; their grid has 1920 x 1920 samples."""
    pattern, picture = (
        np.asarray(cv2.imread(str(where / f"slm{kind}_gaussianRing_iter_{iteration}.png"), 0))
        for kind in ("Phase", "PSF")
    )
    window = Plane((200, 200), (1e-6, 1e-6))
    pupil = Plane(_CAMERA.panel.shape, (8e-6, 8e-6))
    transform = CommensurateTransform(FourierGeometry(pupil, window, 1920 * 8e-12), torch.complex64)
    phase = torch.from_numpy(pattern).to(torch.float64) * (2 * np.pi / 255)
    field = transform(torch.polar(torch.ones_like(phase), phase))
    light = (field.real**2 + field.imag**2).numpy().ravel()
    wanted = centred_crop(torch.from_numpy(picture), window.shape).numpy().ravel()
    return float(np.corrcoef(light, wanted)[0, 1])


MEASUREMENTS = {
    "iteration": iteration_cost,
    "frame": single_frames,
    "video": several_frames,
    "crystal": slow_crystal,
    "published": published_patterns,
}
