"""Draw PSFs of several designs, and judge each on a computed snapshot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.spectral.computed_snapshot import (
    ComputedSnapshot,
    chart_cube,
    compute_snapshot,
    filter_shares,
)
from labapp.spectral.typical_spectra import typical_reflectances
from labapp.studies.catalogue.psf_designs import PSFDesignSettings
from labapp.studies.coded_snapshots import psf_window
from optics.camera import Camera
from optics.multispectral import (
    dispersion_power,
    dot_psfs,
    fourier_coverage,
    linear_dispersion_psfs,
    predict_errors,
    restore_spectra,
    ring_psfs,
    spiral_psfs,
)
from optics.plane import Plane
from optics.progress import Progress
from optics.sensor import Mosaic
from optics.targets import ring_positions

LINEAR = "linear dispersion"
"""Name of the design in which a dot moves along a line, as behind a prism."""

_SEED = 1
"""Seed of the snapshots' noise, the same for all designs; chosen."""

Stack = NDArray[np.float64]
"""PSFs, (bands, rows, columns)."""


@dataclass(frozen=True, eq=False)
class DesignResult:
    """Hold what PSFs of one design give.

    psfs: (bands, rows, columns), each of sum 1.
    power: dispersion power (Eq. A.1); None for two bands.
    coverage: mean MTF over all frequencies and bands.
    predicted: predicted mean PSNR, dB.
    levels: PSNR of each restored band, dB.
    bands: the restored bands, (bands, rows, columns).
    """

    psfs: Stack
    power: float | None
    coverage: float
    predicted: float
    levels: tuple[float, ...]
    bands: NDArray[np.floating]

    @property
    def mean_level(self) -> float:
        """Mean PSNR of the restored bands, dB."""
        return float(np.mean(self.levels))


def draw_designs(
    settings: PSFDesignSettings, camera: Camera, wavelengths: Sequence[float]
) -> dict[str, Stack]:
    """Draw ideal PSFs of the chosen sizes: ring, spiral, dots and linear dispersion."""
    pitch, window = camera.sensor.pitch, psf_window(settings, camera)
    plane, radius = Plane((window, window), (pitch, pitch)), longest_radius(settings)
    share = settings.peak
    places = ring_positions(settings.dots, radius)
    drawn = {
        "ring": ring_psfs(plane, wavelengths, radius, unmodulated=share),
        "spiral": spiral_psfs(plane, wavelengths, radius, turns=settings.turns, unmodulated=share),
        "dots": dot_psfs(plane, wavelengths, places, unmodulated=share),
        LINEAR: linear_dispersion_psfs(plane, wavelengths, radius, unmodulated=share),
    }
    return {name: one.numpy() for name, one in drawn.items()}


def longest_radius(settings: PSFDesignSettings) -> float:
    """Return the radius of PSFs in the longest band, metres."""
    return settings.radius_um * 1e-6 * max(settings.bands_nm) / settings.wavelength_nm


def judge_design(
    psfs: Stack,
    wavelengths: tuple[float, ...],
    mosaic: Mosaic,
    settings: PSFDesignSettings,
    progress: Progress,
) -> DesignResult:
    """Restore a computed snapshot with a design's PSFs, and predict its quality."""
    spectra = typical_reflectances(wavelengths)
    snapshot = chart_snapshot(psfs, wavelengths, mosaic, settings.side_px, settings.noise)
    restored = restore_spectra(snapshot.observation, torch.from_numpy(spectra), progress=progress)
    shares, channels = filter_shares(mosaic, wavelengths), "".join(mosaic.channels)
    errors = predict_errors(
        psfs, shares, mosaic.pattern, spectra, settings.noise, channels=channels
    )
    bands = np.asarray(restored.image)
    return DesignResult(
        psfs,
        dispersion_power(psfs) if len(psfs) > 2 else None,
        float(fourier_coverage(psfs).mean_mtf.mean()),
        errors.mean_psnr,
        snapshot.band_levels(bands),
        bands,
    )


def chart_snapshot(
    psfs: Stack, wavelengths: Sequence[float], mosaic: Mosaic, side: int, noise: float
) -> ComputedSnapshot:
    """Compute a snapshot of a ColorChecker."""
    truth = chart_cube(wavelengths, side)
    return compute_snapshot(truth, psfs, mosaic, wavelengths, noise=noise, seed=_SEED)
