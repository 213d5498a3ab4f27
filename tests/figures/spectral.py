"""Spectral pictures from one frame behind colour filters, told apart by each band's own ring."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import torch
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from figures import Figure
from labapp.files.reading import bundled_path
from labapp.files.spectrum_file import read_spectrum
from optics.deconvolution.band_coupling import BandCoupling
from optics.deconvolution.observation import Observation
from optics.deconvolution.total_variation import total_variation
from optics.demosaicing import build_mosaic_observation
from optics.metrics import psnr
from optics.threads import single_threaded

Array = NDArray[np.float64]

_BESIDE = Path(__file__).parents[3] / "shared/data/ms_cubes/cave"
_MEASURED = np.arange(400, 701, 10)
"""Wavelengths in nm of the scenes that lie there."""
_SIDE = 512

_SIX = np.arange(450, 701, 50)
_GOALS = {"paints": 30.5, "feathers": 29.4, "sponges": 31.0}
"""Scenes, and the PSNR in dB that is asked of their six bands."""
_SECONDS_GOAL = 12.0
_MEMORY_GOAL = 3e9
_SCENE_OF_ALL = "paints"

_REACH = 40
"""Pixels from the middle of a PSF to its edge, and radius of the last band's ring."""

_WEIGHT = 1e-4
_ITERATIONS, _ITERATIONS_OF_ALL = 100, 20

_NO_SPECTRA = "not measured: colour-science isn't installed"


@dataclass(frozen=True, eq=False)
class _Restored:
    """Mean PSNR of the bands in dB, and processor seconds."""

    level: float
    seconds: float


@single_threaded
def spectral_figures(folder: Path) -> list[Figure]:
    """Six bands of each scene by a prior of typical spectra, without noise, dark beyond the
    frame."""
    return [_six_bands(name, goal) for name, goal in _GOALS.items()]


def _six_bands(scene: str, decibels: float) -> Figure:
    name = f"six bands of {scene} from one RGGB frame, a ring for each band"
    goal = f"≥ {decibels:g} dB in ≤ {_SECONDS_GOAL:g} s of processor time"
    picture = _read(scene, _SIX)
    if picture is None:
        return Figure(name, goal, "not measured: the scene isn't beside the checkout", None)
    spectra = _typical_spectra(_SIX)
    if spectra is None:
        return Figure(name, goal, _NO_SPECTRA, None)
    found = _restored(picture, _SIX, spectra, _ITERATIONS)
    return Figure(
        name,
        goal,
        f"{found.level:.1f} dB, mean of the bands, in {found.seconds:.1f} s",
        found.level >= decibels and found.seconds <= _SECONDS_GOAL,
    )


@single_threaded
def all_bands_figure(folder: Path) -> list[Figure]:
    """The largest memory of a process that restores 31 bands, libraries included."""
    name = f"31 bands of {_SIDE} x {_SIDE} from one RGGB frame, largest memory of the process"
    goal = f"≤ {_MEMORY_GOAL / 1e9:g} GB"
    if importlib.util.find_spec("colour") is None:
        return [Figure(name, goal, _NO_SPECTRA, None)]
    script = "from figures.spectral import print_memory; print_memory()"
    done = subprocess.run(
        [sys.executable, "-c", script],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    said = json.loads(done.stdout.splitlines()[-1])
    words = (
        f"{said['bytes'] / 1e9:.1f} GB, {said['level']:.1f} dB, mean of the bands of "
        f"{said['scene']}, in {said['seconds']:.1f} s, {_ITERATIONS_OF_ALL} iterations"
    )
    return [Figure(name, goal, words, said["bytes"] <= _MEMORY_GOAL)]


@single_threaded
def print_memory() -> None:
    """Restore all bands of a scene and print what it took, as JSON: for a process of its own."""
    picture, spectra = _read(_SCENE_OF_ALL, _MEASURED), _typical_spectra(_MEASURED)
    assert spectra is not None
    scene = f"random squares, as {_SCENE_OF_ALL} isn't beside the checkout"
    if picture is not None:
        scene = _SCENE_OF_ALL
    else:
        picture = _random_squares(spectra)
    found = _restored(picture, _MEASURED, spectra, _ITERATIONS_OF_ALL)
    taken = {"scene": scene, "level": found.level, "seconds": found.seconds}
    print(json.dumps({**taken, "bytes": _largest_memory()}))


def _largest_memory() -> int:
    """Bytes in memory at once of this process since it began.

    Its resource usage won't do: that counts the process that started it as well.
    """
    status = Path("/proc/self/status").read_text()
    found = re.search(r"^VmHWM:\s*(\d+) kB", status, re.MULTILINE)
    assert found is not None
    return 1024 * int(found[1])


def _typical_spectra(wavelengths: Array) -> torch.Tensor | None:
    """The 99 samples of CIE 224:2017 at wavelengths in nm, (samples, bands); None without
    colour-science."""
    if importlib.util.find_spec("colour") is None:
        return None
    colour: Any = importlib.import_module("colour")
    fidelity: Any = importlib.import_module("colour.quality.cfi2017")
    samples = fidelity.load_TCS_CIE2017(colour.SpectralShape(380, 780, 5))
    at = [np.interp(wavelengths, samples.wavelengths, one) for one in samples.values.T]
    return torch.from_numpy(np.stack(at))


def _read(scene: str, wavelengths: Array) -> Array | None:
    """(bands, rows, columns), white at 1; None where the scene isn't beside the checkout."""
    file = _BESIDE / f"{scene}.mat"
    if not file.is_file():
        return None
    stored = scipy.io.loadmat(str(file))["orig"]
    chosen = stored[..., np.searchsorted(_MEASURED, wavelengths)]
    return np.ascontiguousarray(np.moveaxis(chosen, -1, 0) / 255.0)


def _random_squares(spectra: torch.Tensor) -> Array:
    """A picture of the usual size whose squares have typical spectra."""
    squares = np.random.default_rng(0).integers(len(spectra), size=(_SIDE // 32, _SIDE // 32))
    each = np.kron(squares, np.ones((32, 32), dtype=np.int64))
    return np.ascontiguousarray(np.moveaxis(np.asarray(spectra)[each], -1, 0))


def _restored(
    picture: Array, wavelengths: Array, spectra: torch.Tensor, iterations: int
) -> _Restored:
    problem = _observe(picture, wavelengths)
    begun = time.process_time()
    found = total_variation(
        problem, _WEIGHT, bands=BandCoupling.spectral(spectra), iterations=iterations
    )
    spent = time.process_time() - begun
    levels = [
        psnr(np.clip(np.asarray(band), 0, 1), truth.astype(np.float32))
        for band, truth in zip(found.image, picture, strict=True)
    ]
    return _Restored(float(np.mean(levels)), spent)


def _observe(picture: Array, wavelengths: Array) -> Observation:
    """What the thesis' colour camera sees of a scene without anything around it."""
    psfs, response = _rings(len(wavelengths)), _response(wavelengths)
    letters = np.array([[0, 1], [1, 2]])
    raw = np.zeros(picture.shape[1:])
    for band, psf, shares in zip(picture, psfs, response.T, strict=True):
        blurred = fftconvolve(band, psf, mode="same")
        for y, x in np.ndindex(2, 2):
            raw[y::2, x::2] += shares[letters[y, x]] * blurred[y::2, x::2]
    return build_mosaic_observation(
        raw.astype(np.float32), ("RG", "GB"), psfs,
        response=response, noise=0.0, border="dark",
    )  # fmt: skip


def _rings(bands: int) -> Array:
    """Rings one pixel wide, whose radius grows with the band."""
    at = np.arange(-_REACH, _REACH + 1)
    far = np.hypot(at[:, None], at)
    radii = _REACH * np.arange(1, bands + 1) / bands
    rings = np.abs(far - radii[:, None, None]) < 0.5
    return rings / rings.sum((1, 2), keepdims=True)


def _response(wavelengths: Array) -> Array:
    """Share of each band's light that red, green and blue filters of the camera see, (3, bands)."""
    file = bundled_path("sensors/dvc-4000c.csv")
    curves = [read_spectrum(file, name) for name in ("red", "green", "blue")]
    seen = np.array([curve.at(wavelengths / 1e9) for curve in curves])
    return seen / seen.sum(0)


MEASUREMENTS = {"spectral": spectral_figures, "spectral-31": all_bands_figure}
