"""Draw the figures of a run's report, without a window."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure, FigureBase
from numpy.typing import NDArray

from labapp.files.picture.photograph_writing import encode_srgb
from labapp.pictures.analysis.brackets import Bracket, Picture
from labapp.pictures.report.record_analysis import RecordAnalysis
from labapp.pictures.report.tables import PICTURE_NAMES

_DETAIL = "detail"


def overview(analysis: RecordAnalysis) -> Figure:
    """Draw PSF, photographs and exposures in one figure."""
    if analysis.psf is None:
        return gallery(analysis)
    figure = Figure(figsize=(16, 14.6), dpi=110, layout="constrained")
    figure.suptitle(_heading(analysis), fontsize=15, fontweight="bold")
    top, middle, bottom = np.asarray(figure.subfigures(3, 1, height_ratios=[1.0, 1.95, 0.85]))
    _psf_row(top, analysis)
    _photographs(middle, analysis)
    left, right = bottom.subplots(1, 2)
    draw_profile(left, analysis)
    draw_histogram(right, _coded_brackets(analysis))
    return figure


def gallery(analysis: RecordAnalysis) -> Figure:
    """Draw the first twelve merged brackets, from their 1st to their 99.99th percentile."""
    shown = analysis.brackets[:12]
    columns = min(max(len(shown), 1), 3)
    rows = max(1, -(-len(shown) // columns))
    figure = Figure(figsize=(5.2 * columns, 3.9 * rows + 0.5), dpi=110, layout="constrained")
    left_out = len(analysis.brackets) - len(shown)
    more = f" (and {left_out} more)" if left_out else ""
    figure.suptitle(_heading(analysis) + more, fontsize=13, fontweight="bold")
    axes = np.asarray(figure.subplots(rows, columns, squeeze=False)).ravel()
    for one in axes:
        one.axis("off")
    for one, bracket in zip(axes, shown, strict=False):
        low, high = np.percentile(bracket.rate, [1, 99.99])
        span = max(high - low, np.finfo(float).tiny)
        one.imshow(encode_srgb((bracket.rate - low) / span), cmap="gray", vmin=0, vmax=255)
        one.set_title(bracket.name)
    return figure


def psf_figure(analysis: RecordAnalysis) -> Figure:
    """Draw the target, the pattern, and the measured and the predicted PSF."""
    figure = Figure(figsize=(16, 4.2), dpi=100, layout="constrained")
    _psf_row(figure, analysis)
    return figure


def profile_figure(analysis: RecordAnalysis) -> Figure:
    """Draw the radial profiles of the PSFs."""
    figure = Figure(figsize=(8, 3.8), dpi=100, layout="constrained")
    draw_profile(figure.subplots(), analysis)
    return figure


def histogram_figure(analysis: RecordAnalysis) -> Figure:
    """Draw the histogram of the recorded digital numbers."""
    figure = Figure(figsize=(8, 3.8), dpi=100, layout="constrained")
    draw_histogram(figure.subplots(), _coded_brackets(analysis) or analysis.brackets)
    return figure


def _heading(analysis: RecordAnalysis) -> str:
    heading = analysis.title
    if analysis.simulated:
        heading += "  (SIMULATED)"
    if analysis.best_method:
        gain = analysis.scores[analysis.best_method].psnr - analysis.scores["coded"].psnr
        heading += (
            f": {PICTURE_NAMES[analysis.best_method]} {gain:+.1f} dB over the coded photograph"
        )
    return heading


def _psf_row(figure: FigureBase, analysis: RecordAnalysis) -> None:
    psf, pattern = analysis.psf, analysis.pattern
    assert psf is not None
    assert pattern is not None
    axes = figure.subplots(1, 4, width_ratios=[1, 1.78, 1, 1])
    peak = float(psf.measured.max())
    _draw_psf(axes[0], psf.target, "Target PSF", None)
    axes[1].imshow(pattern, cmap="gray", interpolation="nearest")
    axes[1].set_title(f"Pattern on the SLM (grey {pattern.min()} to {pattern.max()})")
    axes[1].set(xticks=[], yticks=[])
    _draw_psf(axes[2], psf.measured, "Measured PSF", peak)
    predicted = "Predicted PSF"
    if psf.prediction_error is not None:
        predicted += f" (differs by {psf.prediction_error:.1%})"
    _draw_psf(axes[3], psf.predicted, predicted, peak)


def _draw_psf(axes: Axes, psf: Picture | None, title: str, peak: float | None) -> None:
    """Draw four decades of a PSF below `peak`, or below its own peak if that is None."""
    axes.set_title(title)
    axes.set(xticks=[], yticks=[])
    if psf is None:
        axes.text(0.5, 0.5, "not described", ha="center", va="center", transform=axes.transAxes)
        return
    peak = peak or float(psf.max())
    # Four decades show the ring beside the central peak.
    lowest = peak * 1e-4
    shown, norm = np.maximum(psf, lowest), LogNorm(lowest, peak)
    image = axes.imshow(shown, cmap="magma", norm=norm, interpolation="nearest")
    axes.figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02)


def _photographs(figure: FigureBase, analysis: RecordAnalysis) -> None:
    columns = len(analysis.images) // 2 + 1
    cells = [*analysis.images, *[_DETAIL] * (2 * columns - len(analysis.images))]
    axes = figure.subplot_mosaic([[*cells[:columns]], [*cells[columns:]]])
    _detail(axes.pop(_DETAIL), analysis)
    for name, one in axes.items():
        one.imshow(encode_srgb(analysis.images[name]), cmap="gray", vmin=0, vmax=255)
        one.set_title(caption(analysis, name))
        one.set_xticks([])
        if name == "neutral":
            one.set_xlabel(analysis.credit, fontsize=8, color="gray")
        one.set_yticks([])


def _detail(axes: Axes, analysis: RecordAnalysis) -> None:
    """Draw the middles of the neutral and of the best restored photograph side by side."""
    name = analysis.best_method or "coded"
    cuts = [_middle(encode_srgb(analysis.images[one])) for one in ("neutral", name)]
    axes.imshow(np.concatenate(cuts, axis=1), cmap="gray", vmin=0, vmax=255)
    axes.axvline(cuts[0].shape[1] - 0.5, color="white", linewidth=1)
    axes.set_title(f"Detail: neutral, and {PICTURE_NAMES[name]}")
    axes.set(xticks=[], yticks=[])


def _middle(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Cut out the middle: half the height, and 0.75 times as wide as high."""
    rows, columns = picture.shape[:2]
    tall = max(rows // 2, 1)
    wide = min(max(round(0.75 * tall), 1), columns)
    top, left = (rows - tall) // 2, (columns - wide) // 2
    return picture[top : top + tall, left : left + wide]


def caption(analysis: RecordAnalysis, name: str) -> str:
    """Return a photograph's name with its PSNR and SSIM."""
    score = analysis.scores.get(name)
    title = PICTURE_NAMES[name][0].upper() + PICTURE_NAMES[name][1:]
    return title if score is None else f"{title}: {score.psnr:.1f} dB, SSIM {score.ssim:.3f}"


def draw_profile(axes: Axes, analysis: RecordAnalysis) -> None:
    """Draw the mean of each PSF over circles around the centre, against their radius."""
    psf = analysis.psf
    assert psf is not None
    curves = {"measured": psf.measured, "predicted": psf.predicted, "neutral": psf.neutral}
    for name, picture in curves.items():
        if picture is not None:
            style = "--" if name == "predicted" else "-"
            axes.semilogy(_radial_mean(picture), style, label=name)
    axes.set_ylim(float(psf.measured.max()) * 1e-6, None)
    axes.set_xlabel("distance from the centre, pixels")
    axes.set_ylabel("share of the light per pixel")
    axes.set_title("PSF, mean over circles")
    axes.grid(alpha=0.3)
    axes.legend()


def _radial_mean(picture: Picture) -> Picture:
    """Return the mean over circles around the centre, by their radius in pixels."""
    n = picture.shape[0]
    y, x = np.indices(picture.shape) - n // 2
    radius = np.hypot(y, x).round().astype(int)
    counts = np.bincount(radius.ravel())
    sums = np.bincount(radius.ravel(), weights=picture.ravel())
    return (sums / counts)[: n // 2]


def draw_histogram(axes: Axes, brackets: list[Bracket]) -> None:
    """Draw how often each digital number occurs, a line for each of the first ten exposures."""
    listed = [
        (f"{bracket.name}, {exposure * 1e3:g} ms", counts)
        for bracket in brackets
        for exposure, counts in zip(bracket.exposures, bracket.histogram, strict=True)
    ]
    most = 10  # so many names fit into the legend
    for label, counts in listed[:most]:
        width = max(counts.size // 256, 1)
        binned = counts[: counts.size // width * width].reshape(-1, width).sum(1)
        levels = np.arange(binned.size) * width
        axes.step(levels, np.where(binned > 0, binned, np.nan), where="post", label=label)
    more = f" (the first {most} of {len(listed)})" if len(listed) > most else ""
    axes.set_yscale("log")
    axes.set_xlabel("digital number")
    axes.set_ylabel("pixels")
    axes.set_title(f"Exposures{more}")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def _coded_brackets(analysis: RecordAnalysis) -> list[Bracket]:
    if analysis.roles is None:
        return []
    shown = (analysis.roles.photograph, analysis.roles.coded)
    return [one for one in analysis.brackets if (one.target, one.pattern) == shown]
