"""Study of extended depth of field by a cubic phase on the SLM (thesis Fig. 2.15 to 2.17)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.files.picture.grey_picture import read_grey_picture
from labapp.files.plan_file import PlanFile, Reconstruction
from labapp.files.reading import bundled_path
from labapp.pictures.analysis.brackets import Bracket, Picture, find_bracket, merge_all
from labapp.pictures.analysis.score import Score, score
from labapp.pictures.analysis.star_psf import measure_psf
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.cubic_edof import STUDY
from labapp.studies.catalogue.cubic_edof import CubicEdofSettings as CubicEdofSettings
from labapp.studies.contract import ResultRow, StudyFigure, StudyResults
from labapp.studies.figure_drawing import draw_log, draw_pattern, draw_photograph
from labapp.studies.stars import acquisition_block, build_study_plan, correlation
from optics.camera import Camera
from optics.inverse.layered import build_layered_observation, paste_layers, restore_layers
from optics.inverse.observation_builder import build_observation
from optics.inverse.richardson_lucy import richardson_lucy
from optics.inverse.separable import separable_parts
from optics.inverse.total_variation import total_variation
from optics.otf import ambiguity_function, defocused_transfer_function
from optics.progress import Progress

STAR_DISTANCES = {"star": 2.0, "star-far": 2.2}
"""Distances of the stars in metres. The photograph's depth layers are at the same distances.

The near one is in focus.
"""

_PUBLISHED = {
    "open aperture": "far scene blurred (Fig. 2.17c)",
    "cubic, as taken": "picture only (Fig. 2.17d)",
    "one PSF, Richardson-Lucy": "picture only (Fig. 2.17e)",
}


def plan(settings: CubicEdofSettings, camera: Camera) -> PlanFile:
    """Plan stars and a scene at two depths, with the open aperture and the cubic phase.

    The scene is also taken with all of it in focus.
    """
    nm, both = settings.wavelength_nm, ["neutral", "cubic"]
    return build_study_plan(
        STUDY,
        {"cubic": {"kind": "cubic", "strength_rad": settings.strength_rad}},
        acquisition_block(list(STAR_DISTANCES), both, nm, exposures_ms=settings.star_ms),
        acquisition_block(["depths"], both, nm, exposures_ms=settings.scene_ms),
        acquisition_block(["sharp"], ["neutral"], nm, exposures_ms=settings.scene_ms)
        | {"interleave": []},
    )


def evaluate(record: Record, settings: CubicEdofSettings, progress: Progress) -> StudyResults:
    """Compare PSFs and MTFs in and out of focus, and restore the pictures."""
    brackets = merge_all(record, progress.part(0, 0.2))
    camera = record.camera
    psfs = {}
    for star in STAR_DISTANCES:
        for pattern in ("neutral", "cubic"):
            roles = Reconstruction(
                star=star, coded=pattern, wavelength_nm=settings.wavelength_nm, psf_window_px=128
            )
            psfs[star, pattern] = measure_psf(record, brackets, roles).measured
    pictures = _restore_pictures(record, brackets, psfs, settings, progress.part(0.3, 0.95))
    scores = {name: score(one, pictures["sharp"]) for name, one in pictures.items()}
    del scores["sharp"]
    waves, strength = _defocus_and_strength(camera, settings)
    rows = [
        _depth_invariance_row(psfs),
        _zeros_row(waves, strength),
        _separable_row(psfs),
        *(ResultRow.of_score(name, one, _PUBLISHED) for name, one in scores.items()),
    ]
    plates = [_pictures_figure(pictures, scores), _psfs_figure(record, psfs)]
    plates.append(_ambiguity_figure(waves, strength))
    notes = [
        "The photograph's near part is at 2 m, in focus, its far part at 2.2 m; nearer things hide "
        "farther ones. PSNR (peak 1) and SSIM are against a picture of all of it in focus, over "
        "the central 90 %.",
        "The thesis' Fig. 2.17 is a simulation on another photograph, restored by Richardson-Lucy "
        "with a known PSF; it prints no numbers. Our plate is truncated by the panel, 1920 x 1080 "
        "pixels, so that it is stronger along its longer side.",
        "Unmodulated light, 5 %, adds a peak to the plate's PSF, which then is no product of a "
        "column and a row.",
    ]
    data = {name: one.as_data for name, one in scores.items()}
    return StudyResults(rows, plates, notes, {"scores": data, "waves": waves})


PSFsByStarAndPattern = dict[tuple[str, str], Picture]


def _restore_pictures(
    record: Record,
    brackets: list[Bracket],
    psfs: PSFsByStarAndPattern,
    settings: CubicEdofSettings,
    progress: Progress,
) -> dict[str, Picture]:
    """Restore the pictures in several ways; the sharp picture's white is about 1."""
    wavelength = settings.wavelength_nm * 1e-9
    sharp, still, coded = (
        find_bracket(brackets, target, pattern, wavelength, record.path).rate
        for target, pattern in (("sharp", "neutral"), ("depths", "neutral"), ("depths", "cubic"))
    )
    white = float(np.percentile(sharp, 99.9))
    image = (coded / white).astype(np.float32)
    layers = frame_layer_indices(image.shape)
    each = [psfs[star, "cubic"].astype(np.float32) for star in STAR_DISTANCES]
    one = build_observation(image, each[0])
    seen = build_layered_observation(image, each, layers)
    progress.report(0, "one PSF for all depths")
    found = {
        "sharp": sharp / white,
        "open aperture": still / white,
        "cubic, as taken": coded / white,
        "one PSF, Richardson-Lucy": _to_numpy(richardson_lucy(one, 60).image),
        "one PSF, total variation": _to_numpy(total_variation(one).image),
        "PSF of each depth, pasted": _to_numpy(paste_layers(seen, total_variation)),
    }
    count = settings.iterations
    together = restore_layers(seen, iterations=count, progress=progress.part(0.3, 0.65))
    found["PSF of each depth, together"] = _to_numpy(together.image)
    opened = [psfs[star, "neutral"].astype(np.float32) for star in STAR_DISTANCES]
    plain = build_layered_observation((still / white).astype(np.float32), opened, layers)
    sharpened = restore_layers(plain, iterations=count, progress=progress.part(0.65, 1))
    found["open aperture, PSF of each depth"] = _to_numpy(sharpened.image)
    return found


def _to_numpy(image: torch.Tensor) -> Picture:
    found: Picture = image.double().numpy()
    return found


def frame_layer_indices(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return which depth layer of the scene each pixel of a frame sees: 0 near, 1 far."""
    depth = read_grey_picture(bundled_path("studies/cubic-edof-depth.png"), "a map of depth")
    rows, columns = shape[-2:]
    # A pixel of the photograph has this side on the sensor, in sensor pixels. The photograph is
    # 1.05 times as large as it must be to cover the frame.
    side = 1.05 * max(rows / depth.shape[0], columns / depth.shape[1])
    y = (np.arange(rows) - rows // 2) / side + depth.shape[0] // 2
    x = (np.arange(columns) - columns // 2) / side + depth.shape[1] // 2
    down, along = (
        np.clip(np.rint(at), 0, n - 1).astype(np.int64)
        for at, n in zip((y, x), depth.shape, strict=True)
    )
    # The picture of depths has the value 2 where the near layer is.
    return np.where(depth[down[:, None], along] == 2, 0, 1)


def _defocus_and_strength(camera: Camera, settings: CubicEdofSettings) -> tuple[float, float]:
    """Return the far star's defocus in waves, and the cubic phase's strength in radians.

    Both are the values at the edge of the panel on its longer axis.
    """
    half = camera.panel.shape[1] * camera.panel.pitch / 2
    near, far = STAR_DISTANCES.values()
    vergence = 1 / near - 1 / far
    return half**2 * vergence / 2 / (settings.wavelength_nm * 1e-9), settings.strength_rad


def _depth_invariance_row(psfs: PSFsByStarAndPattern) -> ResultRow:
    """Compare the PSFs of the two stars, in focus and out of focus, by correlation."""
    alike = {
        pattern: correlation(psfs["star", pattern], psfs["star-far", pattern])
        for pattern in ("neutral", "cubic")
    }
    return ResultRow(
        "PSFs in focus and out of it, correlation",
        "depth-invariant with the plate (Fig. 2.16, p. of section 2.5; no number)",
        "nearer to 1 with the plate than without",
        f"open {alike['neutral']:.2f}, plate {alike['cubic']:.2f}",
        alike["cubic"],
    )


def _zeros_row(waves: float, strength: float) -> ResultRow:
    """Compare MTFs in and out of focus, for a slit as long as the panel.

    Frequencies up to half the slit's cut-off frequency are compared.
    """
    u = np.linspace(0.02, 1.0, 200)
    least = {}
    for name, phase in (("open", None), ("plate", _cubic_phase(strength))):
        focused, defocused = (
            np.abs(np.asarray(defocused_transfer_function(phase, u, np.asarray(w))))
            for w in (0.0, waves)
        )
        least[name] = float((defocused / focused).min())
    return ResultRow(
        "least MTF out of focus over that in focus, to half the cut-off, by the ambiguity function",
        "the plate's lines don't pass through zeros (Eq. 2.40; no number)",
        "0 for the open aperture",
        f"open {least['open']:.3f}, plate {least['plate']:.2f} at {waves:.1f} waves",
        least["plate"],
    )


def _cubic_phase(strength: float) -> Any:
    """Return the cubic phase in radians as a function of the place in the pupil, -1 to 1."""
    return lambda x: strength * x**3


def _separable_row(psfs: PSFsByStarAndPattern) -> ResultRow:
    """Compare the measured PSF with a separable one, also without its unmodulated light."""
    straight, coded = psfs["star", "neutral"], psfs["star", "cubic"]
    shares = np.linspace(0, 0.1, 41)
    found = [separability_residual(coded - share * straight) for share in shares]
    best = int(np.argmin(found))
    return ResultRow(
        "plate's PSF that no product of a column and a row has, L2",
        "rectangularly separable (section 2.5)",
        "0 without unmodulated light and noise",
        f"{separability_residual(coded):.2f}; {found[best]:.2f} without {shares[best]:.1%} "
        "unmodulated light",
        found[best],
    )


def separability_residual(psf: Picture) -> float:
    """Return how far a PSF is from separable, 0 to 1.

    This is the relative L2 distance of the PSF from the nearest product of a column and a row.
    """
    down, along = separable_parts(psf, math.inf)
    return float(np.linalg.norm(psf - np.outer(down, along)) / np.linalg.norm(psf))


def _pictures_figure(pictures: dict[str, Picture], scores: dict[str, Score]) -> StudyFigure:
    figure = Figure(figsize=(17, 6.6), dpi=100, layout="constrained")
    for axes, (name, one) in zip(figure.subplots(2, 4).flat, pictures.items(), strict=True):
        told = f", {scores[name].psnr:.1f} dB" if name in scores else ""
        draw_photograph(axes, one, name + told, 1.0)
    return StudyFigure("Pictures", figure, "Fig. 2.17: near rocks in focus, the rest beyond it.")


def _psfs_figure(record: Record, psfs: PSFsByStarAndPattern) -> StudyFigure:
    figure = Figure(figsize=(17, 3.8), dpi=100, layout="constrained")
    axes = figure.subplots(1, 5)
    draw_pattern(axes[0], record.pattern("cubic"), "cubic pattern (Fig. 2.15)")
    for one, ((star, pattern), psf) in zip(axes[1:], psfs.items(), strict=True):
        name = "open" if pattern == "neutral" else "plate"
        draw_log(one, psf, f"{name}, {STAR_DISTANCES[star]:g} m")
    return StudyFigure("PSFs", figure, "Fig. 2.16: measured on a star, 4 decades.")


def _ambiguity_figure(waves: float, strength: float) -> StudyFigure:
    figure = Figure(figsize=(15, 4.6), dpi=100, layout="constrained")
    axes = figure.subplots(1, 3)
    u, steepest = np.linspace(-2, 2, 129), 4 * waves
    v = np.linspace(-steepest, steepest, len(u))
    phases = (("open", None), ("plate", _cubic_phase(strength)))
    for one, (name, phase) in zip(axes, phases, strict=False):
        shown = np.abs(np.asarray(ambiguity_function(phase, u[None, :], v[:, None], tol=1e-4)))
        one.imshow(
            shown, origin="lower", extent=(-2, 2, -steepest, steepest), aspect="auto",
            cmap="magma", vmax=0.5,
        )  # fmt: skip
        for w in (0, waves):
            one.plot(u, 2 * u * w, "w--", lw=0.8)
        one.set(ylim=(-steepest, steepest), xlabel="u", ylabel="v", title=f"|A(u, v)|, {name}")
    x = np.linspace(0, 2, 300)
    for name, phase in phases:
        for w, style in ((0.0, "-"), (waves, "--")):
            mtf = np.abs(np.asarray(defocused_transfer_function(phase, x, np.asarray(w), tol=1e-4)))
            axes[2].semilogy(x, np.maximum(mtf, 1e-4), style, label=f"{name}, {w:.1f} waves")
    axes[2].set(xlabel="frequency u", ylabel="MTF", ylim=(1e-3, 1.1))
    axes[2].legend()
    return StudyFigure(
        "Ambiguity function",
        figure,
        "Of a slit as long as the panel. Dashed: the lines on which the MTF in focus and out of it "
        "lies (Eq. 2.40).",
    )
