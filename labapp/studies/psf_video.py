"""Study of a PSF that changes with time: a spiral that shrinks (thesis Fig. 3.4)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from labapp.files.plan_file import PlanFile
from labapp.pictures.analysis.brackets import Picture
from labapp.pictures.analysis.star_psf import PSFReport
from labapp.runs.record.reader import Record
from labapp.studies.catalogue.psf_video import STUDY, VideoSettings
from labapp.studies.contract import ResultRow, StudyAnimation, StudyFigure, StudyResults
from labapp.studies.figure_drawing import draw_linear, draw_log, encode_gif
from labapp.studies.stars import (
    acquisition_block,
    build_study_plan,
    correlation,
    measure_psfs,
    psf_noise_variances,
    psf_pattern_table,
    requested_psf,
)
from optics import metrics
from optics.camera import Camera
from optics.progress import Progress

_WINDOW = 112
"""Side in sensor pixels of the window in which a PSF is measured."""


def plan(settings: VideoSettings, camera: Camera) -> PlanFile:
    """Plan every frame of the video by itself, and the whole video in one exposure."""
    share = (1 - settings.smallest) / (settings.moments - 1)
    frames = {
        _name(moment): psf_pattern_table(
            settings,
            "spiral",
            radius_um=settings.radius_um * (1 - share * moment),
            turns=settings.turns,
        )
        for moment in range(settings.moments)
    }
    nm = settings.wavelength_nm
    return build_study_plan(
        STUDY,
        frames | {"video": {"kind": "video", "frames": list(frames)}},
        acquisition_block(["star"], ["neutral", *frames], nm, exposures_ms=settings.exposures_ms),
        acquisition_block(["star"], ["video"], nm, periods=[1, 4]),
    )


def _name(moment: int) -> str:
    return f"frame-{moment + 1}"


def evaluate(record: Record, settings: VideoSettings, progress: Progress) -> StudyResults:
    """Compare each frame's size with the requested one.

    The exposure of the whole video is compared with the mean of the frames.
    """
    names = [_name(moment) for moment in range(settings.moments)]
    nm, all_names = settings.wavelength_nm, [*names, "video"]
    found = measure_psfs(record, all_names, nm, _WINDOW, progress.part(0, 0.8))
    # The L2 difference that noise causes between the video and its frames' mean.
    summed = psf_noise_variances(record, all_names, nm, _WINDOW, progress.part(0.8, 1))
    of_frames = sum(summed[name] for name in names) / len(names) ** 2
    noise = float(np.sqrt(of_frames + summed["video"]))
    frames, video = [found[name] for name in names], found["video"]
    asked = [rms_radius(requested_psf(one)) for one in frames]
    seen = [rms_radius(_psf_within_target(one)) for one in frames]
    mean = np.mean([one.measured for one in frames], axis=0)
    multiplexed = metrics.relative_error(video.measured, mean)
    worst = max(abs(s / a - 1) for s, a in zip(seen, asked, strict=True))
    likeness = [correlation(one.modulated_psf, requested_psf(one)) for one in frames]
    last, wanted = seen[-1] / seen[0], asked[-1] / asked[0]
    rows = [
        ResultRow(
            "size of the last frame over that of the first, root mean square radius",
            "shrinks smoothly (animation only)",
            f"{wanted:.3f}",
            f"{last:.3f}",
            last,
        ),
        ResultRow(
            "largest error of a frame's size",
            "animation only",
            "0 %",
            f"{100 * worst:.1f} %",
            worst,
        ),
        ResultRow(
            "every frame is smaller than the one before it",
            "shrinks smoothly",
            "yes",
            "yes" if all(np.diff(seen) < 0) else "no",
        ),
        ResultRow(
            "correlation with the spiral asked for, the least of the frames",
            "animation only",
            "1 without speckle",
            f"{min(likeness):.3f}",
            min(likeness),
        ),
        ResultRow(
            "the video in one exposure, against the mean of its frames, relative L2",
            "-",
            f"{noise / float(np.linalg.norm(mean)):.3f}, of the camera's noise alone",
            f"{multiplexed:.3f}",
            multiplexed,
        ),
    ]
    pitch = record.camera.sensor.pitch * 1e6
    data = {
        "radius_asked_um": [pitch * one for one in asked],
        "radius_measured_um": [pitch * one for one in seen],
        "correlation": likeness,
    }
    notes = [
        "Light of different moments doesn't interfere, so that the video in one exposure is the "
        "mean of its frames. Sizes are taken where the target exceeds 2 % of its peak, "
        "unmodulated light removed. "
        "With a slow liquid crystal (response_time_ms of the panel) the video also holds the way "
        "from each frame to the next, and differs from the mean of its frames by that.",
    ]
    plates = [_filmstrip(frames, video, mean), _sizes(asked, seen, pitch)]
    movie = StudyAnimation(
        "The video, frame by frame",
        encode_gif([one.measured for one in frames]),
        "As the thesis animates it: measured PSFs on a logarithmic scale of four decades.",
    )
    return StudyResults(rows, plates, notes, data, animations=[movie])


def _psf_within_target(report: PSFReport) -> Picture:
    """Return a measured PSF where its target has light, and zero elsewhere.

    Light elsewhere would enter the rms radius by the square of its distance.
    """
    target = requested_psf(report)
    return np.where(target > 0.02 * target.max(), report.modulated_psf, 0.0)


def rms_radius(picture: Picture) -> float:
    """Return the rms distance of a PSF's light from the axis, in pixels."""
    y, x = np.indices(picture.shape) - picture.shape[0] // 2
    light = np.clip(picture, 0, None)
    return float(np.sqrt((light * (y**2 + x**2)).sum() / light.sum()))


def _filmstrip(frames: list[PSFReport], video: PSFReport, mean: Picture) -> StudyFigure:
    """Draw the frames of the video above the whole video."""
    # The figure shows at most eight frames; the animation shows all.
    count = min(len(frames), 8)
    shown = np.linspace(0, len(frames) - 1, count).round().astype(int)
    columns = min(max(2, count), 4)
    rows = -(-count // columns)
    figure = Figure(figsize=(3.2 * columns, 3.4 * (rows + 1)), dpi=100, layout="constrained")
    axes = figure.subplots(rows + 1, columns, squeeze=False)
    for one in axes.ravel():
        one.axis("off")
    peak = max(float(one.measured.max()) for one in frames)
    for one, number in zip(axes[:rows].ravel(), shown, strict=False):
        draw_log(one, frames[number].measured, f"frame {number + 1}", peak)
    still = mean - video.unmodulated * video.neutral
    draw_linear(axes[rows][0], video.modulated_psf, "the video in one exposure")
    draw_linear(axes[rows][1], still, "mean of its frames")
    return StudyFigure(
        "PSFs frame by frame",
        figure,
        "Above, the measured PSF of each frame over four decades. Below, linear and without "
        "unmodulated light: the video in one exposure, and the mean of its frames.",
    )


def _sizes(requested_radii: list[float], measured_radii: list[float], pitch: float) -> StudyFigure:
    figure = Figure(figsize=(8, 3.8), dpi=100, layout="constrained")
    axes = figure.subplots()
    number = np.arange(1, len(requested_radii) + 1)
    axes.plot(number, np.array(requested_radii) * pitch, "-", color="0.6", label="asked for")
    axes.plot(number, np.array(measured_radii) * pitch, "o", label="measured")
    axes.set_xlabel("frame")
    axes.set_ylabel("root mean square radius, µm")
    axes.set_ylim(0, None)
    axes.grid(alpha=0.3)
    axes.legend()
    return StudyFigure("Size by frame", figure, "On the sensor, where the target has light.")
