"""Study of noise that is added to a coded snapshot before it is restored (thesis Table 4.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from matplotlib.figure import Figure

from labapp.files.plan_file import PlanFile
from labapp.runs.record.reader import Record
from labapp.spectral.band_response import mosaic_of
from labapp.spectral.computed_snapshot import bundled_mosaic, chart_cube, compute_snapshot
from labapp.spectral.lights import find_light
from labapp.spectral.problem import SpectralProblem
from labapp.spectral.restoration import restore_snapshot
from labapp.spectral.typical_spectra import typical_reflectances
from labapp.studies.catalogue.multispectral_noise import STUDY, MultispectralNoiseSettings
from labapp.studies.coded_snapshots import plan_snapshot, read_problem
from labapp.studies.contract import ResultRow, StudyFigure, StudyResults
from labapp.studies.figure_drawing import draw_photograph
from optics.camera import Camera
from optics.multispectral import restore_spectra, ring_psfs
from optics.plane import Plane
from optics.progress import Progress

PUBLISHED: Mapping[float, float] = {0.0: 22.3361, 0.01: 22.3747, 0.05: 17.797, 0.1: 14.7672}
"""Mean PSNR in dB by the noise's standard deviation, with the real camera (Table 4.2)."""

_SEED = 1000
"""First seed of the noise; chosen."""


@dataclass(frozen=True, eq=False)
class _Restored:
    """Hold mean PSNRs of restored bands in dB, one for each seed, and the bands of the first."""

    levels: tuple[float, ...]
    bands: np.ndarray

    @property
    def mean(self) -> float:
        """Mean over all seeds, dB."""
        return float(np.mean(self.levels))


_ByWay = Mapping[str, Mapping[float, _Restored]]
"""What is restored from the bench and from computed snapshots, by the noise's deviation."""


def plan(settings: MultispectralNoiseSettings, camera: Camera) -> PlanFile:
    """Plan star, scene and white sheet in all bands, without and with the ring."""
    return plan_snapshot(STUDY, settings, camera)


def evaluate(
    record: Record, settings: MultispectralNoiseSettings, progress: Progress
) -> StudyResults:
    """Restore snapshots with more and more noise, measured and computed."""
    problem = read_problem(record, progress.part(0, 0.2))
    measured = _restore_measured(problem, settings.noise, progress.part(0.2, 0.5))
    computed = _restore_computed(record, settings, progress.part(0.5, 1))
    ways = {"bench": measured, "computed": computed}
    rows = [_row(sigma, kind, one[sigma]) for sigma in settings.noise for kind, one in ways.items()]
    notes = [
        "Bench: noise is added to the snapshot of the camera, whose own noise is in it as well, "
        "and its size is estimated. White is 1. PSFs are measured on the star.",
        f"Computed: a ColorChecker of {settings.side_px} x {settings.side_px} pixels, rings of "
        f"{settings.ring_px:g} pixels in the longest band that grow with the wavelength, "
        f"{100 * settings.peak:g} % of the light in their middle. PSFs and the noise's size are "
        f"known. Means of {settings.seeds} seeds.",
        "The published snapshot is one of the real camera, so that its PSFs and true bands have "
        "errors, too: the bench's rows are nearer to it.",
    ]
    data = {
        name: {f"{sigma:g}": list(one.levels) for sigma, one in found.items()}
        for name, found in ways.items()
    }
    return StudyResults(rows, [_curves_figure(ways), _bands_figure(ways)], notes, data)


def add_noise(problem: SpectralProblem, sigma: float, seed: int) -> SpectralProblem:
    """Return a snapshot's restoration problem with Gaussian noise added.

    sigma: relative to white in the brightest channel; without a white sheet, white is the
    brightest light of the snapshot.
    """
    if sigma == 0:
        return problem
    white = problem.response.white or float(np.nanmax(problem.rate))
    added = sigma * white
    rate = problem.rate + np.random.default_rng(seed).normal(0, added, problem.rate.shape)
    return replace(problem, rate=rate, noise_floor=float(np.hypot(problem.noise_floor, added)))


def _restore_measured(
    problem: SpectralProblem, sigmas: Sequence[float], progress: Progress
) -> dict[float, _Restored]:
    """Restore the bench's snapshot with each noise."""
    light, found = find_light("E"), dict[float, _Restored]()
    for number, sigma in enumerate(sigmas):
        part = progress.part(number / len(sigmas), (number + 1) / len(sigmas))
        restored = restore_snapshot(add_noise(problem, sigma, _SEED), light, progress=part)
        assert restored.scores is not None
        found[sigma] = _Restored((restored.scores.psnr,), np.asarray(restored.cube.values))
    return found


def _restore_computed(
    record: Record, settings: MultispectralNoiseSettings, progress: Progress
) -> dict[float, _Restored]:
    """Restore computed snapshots with each noise and seed."""
    wavelengths = tuple(one * 1e-9 for one in settings.bands_nm)
    side = 2 * round(1.5 * settings.ring_px) + 1
    psfs = ring_psfs(
        Plane((side, side), (1.0, 1.0)), wavelengths, settings.ring_px, unmodulated=settings.peak
    )
    truth = chart_cube(wavelengths, settings.side_px)
    mosaic = mosaic_of(record) or bundled_mosaic()
    spectra = torch.from_numpy(typical_reflectances(wavelengths))
    found, done = dict[float, _Restored](), 0
    count = len(settings.noise) * settings.seeds
    for sigma in settings.noise:
        # Without noise, all seeds give the same.
        seeds = range(settings.seeds if sigma > 0 else 1)
        levels, first = list[float](), None
        for seed in seeds:
            snapshot = compute_snapshot(
                truth, psfs.numpy(), mosaic, wavelengths, noise=sigma, seed=_SEED + seed
            )
            part = progress.part(done / count, (done + 1) / count)
            bands = np.asarray(restore_spectra(snapshot.observation, spectra, progress=part).image)
            levels.append(snapshot.mean_level(bands))
            first, done = bands if first is None else first, done + 1
        assert first is not None
        found[sigma] = _Restored(tuple(levels), first)
    return found


def _row(sigma: float, kind: str, found: _Restored) -> ResultRow:
    """Return the row of one noise, measured or computed."""
    published = f"{PUBLISHED[sigma]:.1f} dB (Table 4.2)" if sigma in PUBLISHED else "-"
    spread = f", {min(found.levels):.1f} to {max(found.levels):.1f}" if found.levels[1:] else ""
    what = f"mean PSNR at a noise of {sigma:g}, {kind}"
    return ResultRow(what, published, "-", f"{found.mean:.1f} dB{spread}", found.mean)


def _curves_figure(ways: _ByWay) -> StudyFigure:
    """Draw PSNR against noise beside the published one."""
    figure = Figure(figsize=(7.5, 4.6), dpi=100, layout="constrained")
    axes = figure.subplots()
    for name, found in ways.items():
        axes.plot(list(found), [one.mean for one in found.values()], "o-", label=name)
    axes.plot(list(PUBLISHED), list(PUBLISHED.values()), "s--", color="gray", label="published")
    axes.set(xlabel="standard deviation of the noise, of white", ylabel="mean PSNR of bands, dB")
    axes.legend()
    axes.grid(alpha=0.3)
    return StudyFigure("Quality against noise", figure, "Table 4.2, drawn.")


def _bands_figure(ways: _ByWay) -> StudyFigure:
    """Draw the first and the last restored band at each noise."""
    sigmas = ways["bench"]
    figure = Figure(figsize=(2.9 * max(len(sigmas), 2), 10.4), dpi=100, layout="constrained")
    columns = figure.subplots(4, len(sigmas), squeeze=False).T
    for sigma, axes in zip(sigmas, columns, strict=True):
        for at, (name, found) in enumerate(ways.items()):
            bands = found[sigma].bands
            draw_photograph(axes[2 * at], bands[0], f"{name}, noise {sigma:g}, first band", 1.0)
            draw_photograph(axes[2 * at + 1], bands[-1], "last band", 1.0)
    return StudyFigure("Restored bands", figure, "The shortest and the longest wavelength.")
