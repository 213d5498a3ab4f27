"""Study of deconvolution: restore a photograph blurred by a requested PSF (thesis Fig. 2.9)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from matplotlib.figure import Figure
from scipy.ndimage import shift

from labapp.files.plan_file import PlanFile, Reconstruction
from labapp.pictures.analysis.brackets import Picture, merge_all
from labapp.pictures.analysis.score import Score, score
from labapp.pictures.reconstructing.recorded_photograph import find_photograph
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.deconvolution import STUDY, DeconvolutionSettings
from labapp.studies.contract import ResultRow, StudyFigure, StudyResults
from labapp.studies.figure_drawing import draw_linear, draw_log, draw_photograph
from labapp.studies.stars import acquisition_block, build_study_plan, psf_pattern_table
from optics.camera import Camera
from optics.inverse.blind import find_kernel
from optics.inverse.gradient_statistics import fit_generalised_gaussian, fit_mixture, log_histogram
from optics.inverse.observation import Observation
from optics.inverse.restored_image import RestoredImage
from optics.inverse.richardson_lucy import richardson_lucy
from optics.inverse.total_variation import total_variation
from optics.inverse.wiener import wiener
from optics.plane import centred_crop
from optics.progress import Progress

_CODED = "heart"


def plan(settings: DeconvolutionSettings, camera: Camera) -> PlanFile:
    """Plan star and photograph, each with the neutral pattern and with the heart."""
    nm, patterns = settings.wavelength_nm, ["neutral", _CODED]
    return build_study_plan(
        STUDY,
        {_CODED: psf_pattern_table(settings, "heart", radius_um=settings.radius_um)},
        acquisition_block(["star"], patterns, nm, exposures_ms=settings.star_ms),
        acquisition_block(["photograph"], patterns, nm, exposures_ms=settings.photograph_ms),
    )


def evaluate(record: Record, settings: DeconvolutionSettings, progress: Progress) -> StudyResults:
    """Restore the photograph in several ways, and score the results.

    The reference is the photograph taken with the neutral pattern.
    """
    brackets = merge_all(record, progress.part(0, 0.3))
    # The PSF's window is wide enough for the light that falls outside the heart.
    roles = Reconstruction(coded=_CODED, wavelength_nm=settings.wavelength_nm, psf_window_px=96)
    problem = find_photograph(record, brackets, roles).build_problem()
    (seen,), sharp, white = problem.observations(), problem.reference, problem.white
    assert sharp is not None
    psf = problem.psf[0].astype(np.float64)
    ways: dict[str, Callable[[], RestoredImage]] = {
        "Wiener, one weight for all frequencies": lambda: wiener(seen, penalty_kind="flat"),
        "Wiener, gradient": lambda: wiener(seen),
        "Richardson-Lucy": lambda: richardson_lucy(seen, settings.lucy),
        "total variation": lambda: total_variation(seen),
    }
    pictures: dict[str, Picture] = {
        "sharp": sharp.light[0] / white,
        "blurred": problem.light[0].astype(np.float64) / white,
    }
    for number, (name, way) in enumerate(ways.items()):
        progress.report(0.3 + 0.4 * number / len(ways), name)
        pictures[name] = way().image.double().numpy() / white
    kernel, trust = None, ""
    if settings.blind:
        kernel, restored, trust = _restore_blindly(
            seen, settings, record.camera, progress.part(0.7, 1)
        )
        pictures["blind"] = restored / white
    scores = {name: score(one, pictures["sharp"]) for name, one in pictures.items()}
    del scores["sharp"]
    better = dict.fromkeys(scores, "better than blurred") | {"blurred": "-"}
    rows = [ResultRow.of_score(name, one, _PUBLISHED, better[name]) for name, one in scores.items()]
    notes = [
        "PSNR (peak 1) and SSIM (range 1) are against the photograph taken with a neutral pattern, "
        "over the central 90 %; its own noise and the lens' blur are in it, so that nothing comes "
        "arbitrarily near.",
        f"The noise, {seen.noise / white:.4f} of white, and all weights were found from the "
        "blurred photograph. The PSF was measured on a star.",
    ]
    plates = [_restorations_figure(pictures, scores, psf, kernel)]
    if kernel is not None:
        plates.append(_statistics(pictures["sharp"]))
        notes.append(
            f"Blind: a kernel from the middle of the photograph, {trust}. Where a blur lies nobody "
            "can tell from the photograph alone: the kernel was moved to where the star's PSF "
            "lies. Total variation undoes it."
        )
    data = {name: one.as_data for name, one in scores.items()}
    return StudyResults(rows, plates, notes, data)


def _restore_blindly(
    observation: Observation, settings: DeconvolutionSettings, camera: Camera, progress: Progress
) -> tuple[Picture, Picture, str]:
    """Return a blind restoration: its kernel, the picture, and what judges the kernel.

    Only the kernel's position is taken from the star.
    """
    radius = (settings.radius_um + 2 * settings.width_um) * 1e-6 / camera.sensor.pitch
    size = 2 * math.ceil(radius) + 1
    # The kernel is estimated from the middle of the photograph, at most 255 pixels across.
    rows, columns = (min(n, 255) for n in observation.image.shape)
    middle = centred_crop(observation.inpainted_image, (rows, columns))
    found = find_kernel(middle, size, progress=progress)
    kernel = np.asarray(found.psf, dtype=np.float64)
    away = _centroid(observation.psf.double().numpy()) - _centroid(kernel)
    room = math.ceil(float(np.abs(away).max())) + 1
    moved = np.clip(shift(np.pad(kernel, room), away, order=1), 0, None)
    again = replace(observation, psf=torch.from_numpy(moved / moved.sum()).to(observation.image))
    restored = total_variation(again).image.double().numpy()
    return moved, restored, f"score {found.score:.2f}, {found.verdict}"


def _centroid(psf: Picture) -> Picture:
    """Return a PSF's centroid (y, x) relative to the origin, in pixels.

    Light below a hundredth of the peak is left out as noise.
    """
    bright = np.where(psf > 0.01 * psf.max(), psf, 0)
    places = np.indices(psf.shape) - np.array(psf.shape)[:, None, None] // 2
    return np.asarray((places * bright).sum((1, 2)) / bright.sum())


def _statistics(sharp: Picture) -> StudyFigure:
    """Draw the distribution of the photograph's gradients with fitted models (thesis Fig. 2.10)."""
    lengths, density = log_histogram(torch.from_numpy(sharp), 161, 0.6)
    mixture, heavy = (
        fit(torch.from_numpy(sharp)) for fit in (fit_mixture, fit_generalised_gaussian)
    )
    spread = float(np.std(np.diff(sharp)))
    normal = -0.5 * (lengths / spread).square() - math.log(spread * math.sqrt(2 * math.pi))
    figure = Figure(figsize=(8, 5), dpi=100, layout="constrained")
    axes = figure.subplots()
    axes.plot(lengths, density, ".", color="gray", label="gradients of the sharp photograph")
    axes.plot(lengths, mixture.log_density(lengths), label="mixture of three Gaussians")
    axes.plot(lengths, heavy.log_density(lengths), label=f"|gradient|^{heavy.power:.2f}")
    axes.plot(lengths, normal, "--", label="one Gaussian")
    axes.set(ylim=(-8, None), xlabel="gradient, of white a pixel", ylabel="log density")
    axes.legend()
    axes.grid(alpha=0.3)
    return StudyFigure("Natural pictures' gradients", figure, "Fig. 2.10, of the same photograph.")


_PUBLISHED = {
    "blurred": "picture only, Fig. 2.9 (c)",
    "Wiener, one weight for all frequencies": "picture only, Fig. 2.9 (d)",
    "Richardson-Lucy": "picture only, Fig. 2.9 (e)",
    "blind": "picture only, Fig. 2.9 (f)",
}


def _restorations_figure(
    pictures: dict[str, Picture], scores: dict[str, Score], psf: Picture, kernel: Picture | None
) -> StudyFigure:
    figure = Figure(figsize=(17, 6.6), dpi=100, layout="constrained")
    axes = figure.subplots(2, 4).ravel()
    draw_log(axes[0], psf, "PSF, measured, 4 decades")
    for one, (name, picture) in zip(axes[1:], pictures.items(), strict=False):
        told = f"\n{scores[name].psnr:.1f} dB" if name in scores else ""
        draw_photograph(one, picture, name + told, 1.0)
    if kernel is None:
        axes[-1].set_axis_off()
    else:
        axes[0].set_title("PSF: star, 4 decades; blind", fontsize=11)
        draw_linear(axes[0].inset_axes((0.64, 0.0, 0.36, 0.36)), kernel, "")
    return StudyFigure(
        "Deconvolution", figure, "Fig. 2.9, on another photograph, through the bench."
    )
