"""Judges of phase retrieval: whole FFTs in numpy, direct sums, and targets drawn by formulas."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.spatial
import torch
from numpy.typing import NDArray

from judges.basics import positions
from optics.camera import Camera, Lens, Panel

WAVELENGTH = 532e-9
"""Tabulated: the panel reaches 6.7 pi."""

REACH = 6.7 * np.pi
PITCH = 40e-6

Array = NDArray[np.float64]


def camera(shape: tuple[int, int], stop: float | None = None, **panel: Any) -> Camera:
    """A panel of coarse pixels; stop: its diameter in pixels, far beyond the panel if None."""
    lens = Lens() if stop is None else Lens(f_number=0.125 / (stop * PITCH))
    return Camera(Panel(shape=shape, pitch=PITCH, **panel), lens)


def seeded(seed: int = 1) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


# Targets, on a grid `fine` times finer than the design's; lengths in samples of the latter


def _mesh(shape: tuple[int, int], fine: int) -> tuple[Array, Array]:
    rows, columns = shape
    return positions(rows * fine, 1 / fine)[:, None], positions(columns * fine, 1 / fine)[None, :]


def ring(shape: tuple[int, int], radius: float, width: float, fine: int = 1) -> Array:
    y, x = _mesh(shape, fine)
    return np.exp(-((np.hypot(y, x) - radius) ** 2) / (2 * width**2))


def spiral(shape: tuple[int, int], radius: float, width: float, fine: int = 1) -> Array:
    """Archimedes' spiral of three turns, drawn with a round brush."""
    turn = np.linspace(0, 1, 5000)
    angle = 6 * np.pi * turn
    curve = radius * np.stack([turn * np.sin(angle), turn * np.cos(angle)], axis=-1)
    places = np.stack(np.broadcast_arrays(*_mesh(shape, fine)), axis=-1)
    gap, _ = scipy.spatial.cKDTree(curve).query(places)
    return np.exp(-(gap**2) / (2 * width**2))


def dots(
    shape: tuple[int, int],
    places: list[tuple[float, float]],
    width: float,
    fine: int = 1,
    heights: tuple[float, ...] | None = None,
) -> Array:
    y, x = _mesh(shape, fine)
    heights = heights or (1.0,) * len(places)
    return sum(
        h * np.exp(-((y - v) ** 2 + (x - u) ** 2) / (2 * width**2))
        for h, (v, u) in zip(heights, places, strict=True)
    )


def tensor(target: Array) -> torch.Tensor:
    return torch.from_numpy(target)


# Light


def stop_share(shape: tuple[int, int], diameter: float) -> Array:
    """Share of each pixel inside a circle of a diameter in pixels, from 40 x 40 points each."""
    inner = (np.arange(40) + 0.5) / 40 - 0.5
    y, x = ((positions(n, 1.0)[:, None] + inner).ravel() for n in shape)
    inside = y[:, None] ** 2 + x[None, :] ** 2 <= (diameter / 2) ** 2
    return inside.reshape(shape[0], 40, shape[1], 40).mean((1, 3))


def whole_far_field(field: NDArray[Any], length: int) -> NDArray[np.complex128]:
    """All of the padded FFT, with the origin in the middle."""
    padded = np.zeros((length, length), dtype=complex)
    padded[: field.shape[0], : field.shape[1]] = field
    return np.fft.fftshift(np.fft.fft2(padded))


def window_of(picture: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """The samples around the origin, which is at n // 2 of both."""
    first = [n // 2 - m // 2 for n, m in zip(picture.shape, shape, strict=True)]
    return picture[first[0] : first[0] + shape[0], first[1] : first[1] + shape[1]]


def embedded(window: NDArray[Any], length: int) -> NDArray[Any]:
    """A window in the middle of a dark plane: the opposite of window_of()."""
    whole = np.zeros((length, length), dtype=window.dtype)
    window_of(whole, window.shape)[:] = window
    return whole


def light(
    phases: NDArray[Any], length: int, window: tuple[int, int], amplitude: Array | float = 1.0
) -> Array:
    """The mean PSF of frames (frames, rows, columns): share of all light a sample."""
    amplitude = np.broadcast_to(amplitude, phases.shape[1:])
    fields = [whole_far_field(amplitude * np.exp(1j * p.astype(float)), length) for p in phases]
    power = length**2 * (amplitude**2).sum()
    return np.mean([np.abs(window_of(f, window)) ** 2 for f in fields], axis=0) / power


def merits(psf: Array, target: Array) -> tuple[float, float, float]:
    """Efficiency, speckle contrast and NRMSE, as the design page of the project words them."""
    efficiency = psf[target > 0.02 * target.max()].sum()
    ratio = (psf / np.maximum(target, 1e-30))[target > 0.5 * target.max()]
    scale = (psf * target).sum() / (target**2).sum()
    error = np.linalg.norm(psf - scale * target) / np.linalg.norm(scale * target)
    return efficiency, ratio.std() / ratio.mean(), error


def quantised(phase: NDArray[Any], reach: float = REACH, levels: int = 256, orders: int = 1) -> Any:
    """What a linear panel shows: the level whose phase is nearest, modulo waves."""
    step, period = reach / (levels - 1), 2 * np.pi * orders
    wrapped = phase % period
    used = np.arange(levels) * step
    used = used[used < period]
    level = np.minimum(np.round(wrapped / step).astype(int), len(used) - 1)
    # A whole wave is nearer than the last level to phases right below it.
    level[np.abs(wrapped - period) < np.abs(wrapped - used[level])] = 0
    return used[level]


# Directions of phases


def turned(one: NDArray[Any], other: NDArray[Any]) -> Array:
    """Radians between two phases or fields, modulo whole waves."""
    one, other = (z if np.iscomplexobj(z) else np.exp(1j * z.astype(float)) for z in (one, other))
    return np.abs(np.angle(one * other.conj()))


def direct_sums(field: NDArray[Any], length: int, window: tuple[int, int]) -> NDArray[Any]:
    """Sum of f[y, x] exp(-2 pi i (y v + x u) / length), the first sample at y = x = 0."""
    v, u = (positions(n, 1.0) for n in window)
    y, x = (np.arange(n) for n in field.shape)
    down = np.exp(-2j * np.pi * np.outer(v, y) / length)
    return down @ field @ np.exp(-2j * np.pi * np.outer(x, u) / length)


def sums_back(window: NDArray[Any], length: int, y: NDArray[Any], x: NDArray[Any]) -> NDArray[Any]:
    """Sum of F[v, u] exp(2 pi i (y v + x u) / length) at any places, pixels from the first."""
    v, u = (positions(n, 1.0) for n in window.shape)
    down = np.exp(2j * np.pi * np.outer(y, v) / length)
    return down @ window @ np.exp(2j * np.pi * np.outer(u, x) / length)


# Algorithms, with whole FFTs of all samples in double precision


def gerchberg_saxton_by_whole_ffts(
    start: Array, target: Array, length: int, iterations: int, amplitude: Array
) -> Array:
    """Thesis §3.3.2: the panel's and the target's amplitudes replace those of the wave."""
    rows, columns = start.shape
    wanted, phase = embedded(np.sqrt(target), length), start
    for _ in range(iterations):
        far = whole_far_field(amplitude * np.exp(1j * phase), length)
        near = np.fft.ifft2(np.fft.ifftshift(wanted * np.exp(1j * np.angle(far))))
        phase = np.angle(near[:rows, :columns])
    return phase


def published_program(start: Array, target: Array, iterations: int) -> Array:
    """phaseRetrieval_Fraunhoffer_2d.m, line by line: a square of the panel's longer side.

    target: on that square. The panel lies in its middle; both planes have coordinates of 8 µm;
    the lens' phase goes on as exp(i k r² / 2 f) and is taken off as exp(i k r²).
    """
    side, pitch, wavelength, focal_length = len(target), 8e-6, 550e-9, 0.15
    wave = 2 * np.pi / wavelength
    r2 = (np.hypot(*np.meshgrid(*[(np.arange(side) - side // 2) * pitch] * 2))) ** 2
    mask = embed_panel(np.ones(start.shape), side)
    field = embed_panel(np.exp(1j * start), side)
    for _ in range(iterations):
        pupil = np.exp(1j * np.angle(field)) * mask
        image = np.exp(1j * wave * r2 / (2 * focal_length)) / (1j * wavelength * focal_length)
        image = image * np.fft.fftshift(np.fft.fft2(np.fft.fftshift(pupil))) * pitch**2
        image = np.sqrt(target) * np.exp(1j * np.angle(image)) / np.exp(1j * wave * r2)
        field = np.fft.ifftshift(np.fft.ifft2(np.fft.ifftshift(image)))
    top, left = (side - n for n in start.shape)
    return np.angle(field)[top // 2 : side - (top + 1) // 2, left // 2 : side - (left + 1) // 2]


def embed_panel(panel: NDArray[Any], side: int) -> NDArray[Any]:
    """A panel in the middle of a dark square."""
    return np.pad(panel, [((side - n) // 2, (side - n + 1) // 2) for n in panel.shape])
