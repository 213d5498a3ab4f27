"""Other libraries on the same case, measured beside ours: one adapter for each of them.

An adapter sets everything up (stop, defocus, matrices) and gives the call that makes one
more PSF: that call is what is timed. Every library gets the way that serves it best, and the
same task: a circular stop and its defocus in, the light's density at the pixels' centres
times a pixel's area out, as a share of the light in the stop. All of them keep count of
their light, so that no scale is fitted. None takes a tolerance or predicts an error.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.accuracy.work_precision import Candidate, PlannedCall, Row, raise_refusal
from labapp.prediction.lens_options import LensCase
from labapp_peers.library import (
    COMPLEX,
    MOST_BYTES,
    Call,
    in_words,
    load_library,
    torchoptics_precision,
)
from optics.camera import Camera, Panel
from optics.camera.pupil import defocus_curvature, pupil_amplitude

_Real = NDArray[np.float64]

_GRIDS = (128, 256, 512, 1024, 2048)


@dataclass(frozen=True)
class _Method:
    """A way through a library: in words, and `set_up(library, case, grid, precision)`."""

    words: str
    set_up: Callable[[Any, LensCase, int, str], tuple[Call, int]]
    grids: tuple[int, ...] = _GRIDS
    precisions: tuple[str, ...] = tuple(COMPLEX)


def candidates(case: LensCase) -> Iterator[Candidate]:
    """prysm, poppy, hcipy and torchoptics at every pupil sampling and precision they offer.

    A library that can't be loaded is one candidate, whose plan says why. Whatever a library
    raises, or gives that isn't a picture, is a ValueError in words.
    """
    for name, methods in _methods(case).items():
        if not case.is_clear_thin_on_axis:
            error = ValueError("peers are compared on a clear, thin lens and a window on its axis")
            yield Candidate(
                Row("psf", case.name, name, "float64", None), partial(raise_refusal, error)
            )
            continue
        try:
            library, label = load_library(name)
        except ValueError as error:
            yield Candidate(
                Row("psf", case.name, name, "float64", None), partial(raise_refusal, error)
            )
            continue
        for method in methods:
            for grid in method.grids:
                for precision in method.precisions:
                    words = f"{label}, {method.words}, {grid}² pupil, gray edge"
                    set_up = partial(method.set_up, library, case, grid, precision)
                    yield Candidate(
                        Row("psf", case.name, words, precision, None),
                        partial(_plan, label, case.size, set_up),
                    )


def _methods(case: LensCase) -> dict[str, list[_Method]]:
    odd = tuple(grid - 1 for grid in _GRIDS)
    # prysm 0.21's chirp z is a pixel off where pupil and window aren't both even or both odd.
    alike = odd if case.size % 2 else _GRIDS
    direct = partial(_torchoptics, "DIM_FRESNEL")
    return {
        "prysm": [
            _Method("matrix DFT", partial(_prysm, "mdft"), alike),
            _Method("chirp z", partial(_prysm, "czt"), alike),
        ],
        # With numexpr, its single precision multiplies matrices in double all the same.
        "poppy": [_Method("matrix DFT", _poppy, precisions=("float64",))],
        "hcipy": [
            _Method("Fraunhofer MFT", partial(_hcipy, "MatrixFourierTransform")),
            _Method("Fraunhofer zoom FFT", partial(_hcipy, "ZoomFastFourierTransform")),
        ],
        "torchoptics": [
            # Padded five times: a finer pupil takes minutes and is as wrong.
            _Method("AUTO", partial(_torchoptics, "AUTO"), odd[:3], ("float64",)),
            _Method("DIM_FRESNEL", direct, odd),
            _Method("DIM_FRESNEL at the pixels", direct, (_at_pixels(case),), ("float32",)),
        ],
    }


def _plan(label: str, size: int, set_up: Callable[[], tuple[Call, int]]) -> PlannedCall:
    """Candidate's plan, with a library's troubles in words and its pictures checked."""
    with in_words(label):
        call, used = set_up()

    def picture() -> _Real:
        with in_words(label):
            values = np.asarray(call(), dtype=np.float64)
        if values.shape != (size, size):
            raise ValueError(f"{label} gave an array of {values.shape}, not of {(size, size)}")
        if not math.isfinite(values.sum()):
            raise ValueError(f"{label} gave a picture with values that aren't finite")
        return values

    return PlannedCall(picture, used)


def _prysm(method: str, prysm: Any, case: LensCase, grid: int, precision: str) -> tuple[Call, int]:
    """prysm's matrix DFT or chirp z: the transforms behind its `focus_fixed_sampling`.

    They sample the focal plane at the pixels, without padding; releases after 0.21 plan them
    with `prepare_executor`. Both planes have their origin at index n // 2, as ours. The gray
    stop is ours, with two spare samples: prysm's own ramps along the radius only and is less
    exact. Its matrices are kept by shape, whatever their precision, so each plan has its own.
    """
    propagation = importlib.import_module("prysm.propagation")
    config = importlib.import_module("prysm.conf").config
    step = case.lens.stop_diameter / (grid - 2)
    stop, squares = _stop(case, grid, step)
    pupil = stop / math.sqrt(stop.sum()) * np.exp(1j * _defocus(case) * squares)
    pupil = pupil.astype(COMPLEX[precision])
    # Millimetres in the pupil and of focal length; micrometres at the focus and of wavelength.
    wave, pitch, focal = 1e6 * case.wavelength, 1e6 * case.pitch, 1e3 * case.lens.image_distance
    before, config.precision = np.dtype(config.precision), np.finfo(precision).bits
    try:
        if hasattr(propagation, "prepare_executor"):
            transform = propagation.prepare_executor(
                1e3 * step, grid, pitch, case.size, wave, focal, kind=method
            )
        else:
            tools = importlib.import_module("prysm.fttools")
            makers = {"mdft": "MatrixDFTExecutor.dft2", "czt": "ChirpZTransformExecutor.czt2"}
            maker, _, run = makers[method].partition(".")
            q = propagation.Q_for_sampling(1e3 * step * grid, focal, wave, pitch)
            sampling = {"Q": q, "samples": (case.size, case.size)}
            transform = partial(getattr(getattr(tools, maker)(), run), **sampling)
        transform(pupil)  # Its matrices are made, in this precision, when they are first used.
    finally:
        config.precision = 8 * before.itemsize
    matrices = _matrix_bytes if method == "mdft" else _chirp_bytes
    return lambda: _intensity(transform(pupil)), matrices(grid, case.size, precision)


def _poppy(poppy: Any, case: LensCase, grid: int, precision: str) -> tuple[Call, int]:
    """poppy's matrix DFT, called by itself: what its Wavefront uses before a Detector.

    That spares drawing the lens and copying the wavefront for every PSF. Stop and defocus
    are its ThinLens with gray pixels. Its planes are centred between samples where their
    number is even: the offset of half a pixel brings the origin to index n // 2.
    """
    units, lens = importlib.import_module("astropy.units"), case.lens
    diameter, wavelength = lens.stop_diameter * units.m, case.wavelength * units.m
    wave = poppy.Wavefront(wavelength=wavelength, npix=grid, diam=diameter)
    wave *= poppy.ThinLens(
        nwaves=_defocus(case) * (lens.stop_diameter / 2) ** 2 / (2 * math.pi),
        reference_wavelength=wavelength,
        radius=diameter / 2,
        gray_pixel=True,
    )
    pupil = wave.wavefront / math.sqrt(np.abs(wave.wavefront).sum())
    transform = importlib.import_module("poppy.matrixDFT").MatrixFourierTransform("ADJUSTABLE")
    width = case.size * case.pitch / (case.wavelength * lens.image_distance / lens.stop_diameter)
    offset = (0.0, 0.0) if case.size % 2 else (0.5, 0.5)
    return (
        lambda: _intensity(transform.perform(pupil, width, case.size, offset=offset)),
        _matrix_bytes(grid, case.size, precision),
    )


def _hcipy(method: str, hcipy: Any, case: LensCase, grid: int, precision: str) -> tuple[Call, int]:
    """hcipy's matrix or zoom Fourier transform: what its FraunhoferPropagator chooses from.

    Both sample the focal plane at the pixels; its planner takes the matrix, and the zoom is
    often faster. The stop's edge is supersampled eight times, hcipy's own way; `has_center`
    puts the window's origin at index n // 2.
    """
    lens, scale = case.lens, case.wavelength * case.lens.image_distance
    plane = hcipy.make_pupil_grid(grid, lens.stop_diameter)
    pixels = hcipy.make_uniform_grid(
        [case.size, case.size], case.size * case.pitch, has_center=True
    )
    stop = hcipy.evaluate_supersampled(hcipy.make_circular_aperture(lens.stop_diameter), plane, 8)
    strength = case.pitch / scale / _root_area(case)
    phase = _defocus(case) * (plane.x**2 + plane.y**2)
    pupil = hcipy.Field((strength * stop * np.exp(1j * phase)).astype(COMPLEX[precision]), plane)
    transform = getattr(hcipy, method)(plane, pixels.scaled(2 * math.pi / scale))
    matrices = _matrix_bytes if method.startswith("Matrix") else _chirp_bytes
    return (
        lambda: _intensity(transform.forward(pupil).shaped),
        matrices(grid, case.size, precision),
    )


def _torchoptics(
    method: str, torchoptics: Any, case: LensCase, grid: int, precision: str
) -> tuple[Call, int]:
    """torchoptics' Lens and propagation to the sensor: it has no pupil-to-focus transform.

    AUTO is its default: it picks the angular spectrum, on which a coarse lens is aliased.
    DIM_FRESNEL, asked for by name, sums the paraxial integral directly, exact where the
    pupil is sampled at the pixels; elsewhere it takes the nearest sample for a pixel, which
    is better than its interpolation of a field that turns faster than that. Odd grids have a
    sample on the axis, and an offset of half a pixel brings the window's origin to n // 2.
    """
    lens, most = case.lens, 6 * (5 * grid) ** 2 if method == "AUTO" else 8 * (grid + case.size) ** 2
    used = most * _item(precision)
    if used > MOST_BYTES:
        raise ValueError(f"{grid}² samples take {used / 1e9:.1f} GB: more than is tried")
    step = case.pitch if grid == _at_pixels(case) else lens.stop_diameter / (grid - 2)
    stop, squares = _stop(case, grid, step)
    source = math.pi / case.wavelength / case.distance * squares
    light = case.pitch / _root_area(case) * stop * np.exp(1j * source)
    shift = 0.0 if case.size % 2 else -case.pitch / 2
    dtype = getattr(torch, precision)
    with torchoptics_precision(torchoptics, dtype):
        field = torchoptics.Field(torch.from_numpy(light), case.wavelength, spacing=step)
        element = torchoptics.elements.Lens((grid, grid), lens.focal_length, spacing=step)
        system = torchoptics.System(element)

    def call() -> Any:
        with torchoptics_precision(torchoptics, dtype):
            window = (case.size, case.size), lens.image_distance, case.pitch, (shift, shift)
            return system.measure(field, *window, propagation_method=method).intensity()

    return call, used


def _at_pixels(case: LensCase) -> int:
    """Samples, an odd number, that cover the stop and its gray edge at the pixels' pitch."""
    return 2 * math.ceil(case.lens.stop_diameter / case.pitch / 2) + 3


def _stop(case: LensCase, grid: int, step: float) -> tuple[_Real, _Real]:
    """The open share of each sample of a pupil, and its squared distance from the axis."""
    camera = Camera(Panel(shape=(grid, grid), pitch=step, fill_factor=1.0), case.lens)
    y, x = camera.panel.plane.mesh()
    return pupil_amplitude(camera).numpy(), (y**2 + x**2).numpy()


def _defocus(case: LensCase) -> float:
    return defocus_curvature(case.lens, case.distance, case.wavelength)


def _root_area(case: LensCase) -> float:
    return math.sqrt(math.pi) * case.lens.stop_diameter / 2


def _intensity(field: Any) -> Any:
    return field.real**2 + field.imag**2


def _item(precision: str) -> int:
    return np.dtype(COMPLEX[precision]).itemsize


def _matrix_bytes(grid: int, size: int, precision: str) -> int:
    """Pupil, two matrices, the product of the first, and the window."""
    return _item(precision) * (grid**2 + 3 * grid * size + size**2)


def _chirp_bytes(grid: int, size: int, precision: str) -> int:
    """Pupil, its product with the chirp, its padded transform, and the window."""
    return _item(precision) * (2 * grid**2 + (grid + size) ** 2 + size**2)
