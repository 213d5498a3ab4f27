"""Measured scenes with spectral bands, typical spectra, and what a colour camera sees of them."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import torch
from numpy.typing import NDArray
from scipy.interpolate import interp1d
from scipy.signal import fftconvolve

from labapp.files.reading import bundled_path
from labapp.files.spectrum_file import read_spectrum
from optics.inverse import build_mosaic_observation
from optics.inverse.blur import Border
from optics.inverse.mosaics import MosaicObservation
from optics.metrics import psnr

Array = NDArray[np.float64]

SIX_BANDS = np.arange(450, 701, 50)
"""Wavelengths in nm."""

BAYER = ("RG", "GB")

_BESIDE = Path(__file__).parents[3] / "shared/data/ms_cubes"
_CAVE_BANDS = np.arange(400, 701, 10)
_CAVE_WHITE = 255.0

_LEGO_BANDS = (2, 6, 10, 14, 18, 22)
"""Of 24 whose wavelengths aren't stated, evenly spaced."""
_LEGO_CROP = (slice(40, 168), slice(64, 192))

_HDSP_BANDS = (2, 5, 7, 8, 9, 10)
"""Those around 456, 510, 562, 598, 646 and 687 nm."""

_REACH = 40
"""Pixels from the middle of a published PSF to its edge, and radius of its last band's ring."""


def cave_scene(name: str, wavelengths: Array = SIX_BANDS, *, mean_of: int = 1) -> Array | None:
    """Bands of a CAVE scene at wavelengths in nm, averaged over squares of `mean_of` pixels.

    Wavelengths between the measured ones are interpolated. None where the scene isn't.
    """
    file = _BESIDE / f"cave/{name}.mat"
    if not file.is_file():
        return None
    stored = scipy.io.loadmat(str(file))["orig"]
    chosen = interp1d(_CAVE_BANDS, stored / _CAVE_WHITE)(wavelengths)
    rows, columns, bands = chosen.shape
    squares = chosen.reshape(rows // mean_of, mean_of, columns // mean_of, mean_of, bands)
    return np.ascontiguousarray(np.moveaxis(squares.mean((1, 3)), -1, 0))


def lego_scene() -> Array | None:
    """Six bands of 128 x 128 pixels of the Lego scene; None where it isn't beside the checkout."""
    file = _BESIDE / "lego/lego.mat"
    if not file.is_file():
        return None
    stored = scipy.io.loadmat(str(file))["hyperimg"][_LEGO_CROP][..., _LEGO_BANDS]
    return np.ascontiguousarray(np.moveaxis(stored / 255.0, -1, 0))


def laboratory_scene(name: str) -> Array | None:
    """Six bands of 128 x 128 pixels of a scene of the HDSP laboratory; None where it isn't."""
    file = _BESIDE / f"hdsp/{name}.mat"
    if not file.is_file():
        return None
    stored = scipy.io.loadmat(str(file))["Ori"].astype(float)
    bright = stored[..., _HDSP_BANDS] / np.quantile(stored, 0.999)
    return np.ascontiguousarray(np.moveaxis(bright.clip(0, 1), -1, 0))


def typical_spectra(wavelengths: Array) -> torch.Tensor | None:
    """The 99 samples of CIE 224:2017 at wavelengths in nm, (samples, bands); None without
    colour-science."""
    if importlib.util.find_spec("colour") is None:
        return None
    colour: Any = importlib.import_module("colour")
    fidelity: Any = importlib.import_module("colour.quality.cfi2017")
    samples = fidelity.load_TCS_CIE2017(colour.SpectralShape(380, 780, 5))
    at = [np.interp(wavelengths, samples.wavelengths, one) for one in samples.values.T]
    return torch.from_numpy(np.stack(at))


def camera_response(wavelengths: Array) -> Array:
    """Share of each band's light that red, green and blue filters of the camera see, (3, bands)."""
    file = bundled_path("sensors/dvc-4000c.csv")
    curves = [read_spectrum(file, name) for name in ("red", "green", "blue")]
    seen = np.array([curve.at(wavelengths / 1e9) for curve in curves])
    return seen / seen.sum(0)


def published_rings(bands: int) -> Array:
    """Rings one pixel wide, whose radius grows with the band, as in the published program."""
    at = np.arange(-_REACH, _REACH + 1)
    far = np.hypot(at[:, None], at)
    radii = _REACH * np.arange(1, bands + 1) / bands
    rings = np.abs(far - radii[:, None, None]) < 0.5
    return rings / rings.sum((1, 2), keepdims=True)


def add_peak(psfs: Array, share: float) -> Array:
    """PSFs of which a share of the light stays in the middle, as unmodulated light does."""
    peaked = (1 - share) * psfs
    peaked[:, psfs.shape[1] // 2, psfs.shape[2] // 2] += share
    return peaked


def observe(
    picture: Array,
    psfs: Array,
    wavelengths: Array = SIX_BANDS,
    *,
    noise: float = 0.0,
    border: Border = "dark",
    seed: int = 0,
) -> MosaicObservation:
    """What the thesis' colour camera sees of bands at wavelengths in nm, dark around or not."""
    response = camera_response(wavelengths)
    letters = np.array([["RGB".index(letter) for letter in row] for row in BAYER])
    raw = np.zeros(picture.shape[1:])
    for band, psf, shares in zip(picture, psfs, response.T, strict=True):
        blurred = _blurred(band, psf, border)
        for y, x in np.ndindex(2, 2):
            raw[y::2, x::2] += shares[letters[y, x]] * blurred[y::2, x::2]
    raw += np.random.default_rng(seed).normal(0, noise, raw.shape)
    return build_mosaic_observation(
        raw.astype(np.float32), BAYER, psfs, response=response, noise=noise, border=border
    )


def _blurred(band: Array, psf: Array, border: Border) -> Array:
    if border == "dark":
        return fftconvolve(band, psf, mode="same")
    around = [(n // 2, n // 2) for n in psf.shape]
    return fftconvolve(np.pad(band, around, mode="wrap"), psf, mode="valid")


def mean_level(image: Any, truth: Array) -> float:
    """Mean PSNR of the bands in dB, for a peak of 1."""
    levels = [
        psnr(np.clip(np.asarray(band), 0, 1), wanted.astype(np.float32))
        for band, wanted in zip(image, truth, strict=True)
    ]
    return float(np.mean(levels))
