"""Draw a pattern for depth of field, with its PSFs, transfer and quality over depth."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from labapp.common.figure_png import figure_to_png
from labapp.edof.design_analysis import DepthPictures, FinishedDesign

_DECADES = 3.0
"""Decades of light that the pictures of PSFs show. Chosen."""


def draw_design(title: str, done: FinishedDesign) -> bytes:
    """Draw a pattern with its figures as PNG."""
    figure = Figure(figsize=(15, 8.2), dpi=100, layout="constrained")
    figure.suptitle(title, fontsize=12)
    upper, lower = np.ravel(figure.subfigures(2, 1, squeeze=False, height_ratios=(1, 1.35)))
    _draw_psfs(upper, done.pictures)
    pattern, transfer, quality = lower.subplots(1, 3, width_ratios=(1.5, 1.1, 1.1))
    pattern.imshow(done.grey, cmap="gray", interpolation="nearest")
    pattern.set_title(f"Pattern (grey {done.grey.min()} to {done.grey.max()})")
    pattern.set(xticks=[], yticks=[])
    _draw_transfer(transfer, done.pictures, done.limit[0].numpy())
    _draw_quality(quality, done)
    return figure_to_png(figure)


def _draw_psfs(figure: SubFigure, pictures: DepthPictures) -> None:
    """Draw the PSFs at some depths, all on the same logarithmic scale."""
    axes = figure.subplots(1, len(pictures.psfs), squeeze=False)[0]
    peak = max(float(pictures.psfs.max()), np.finfo(np.float64).tiny)
    y, x = (pictures.pixels.coordinates(axis).numpy() * 1e6 for axis in (0, 1))
    extent = (x[0], x[-1], y[-1], y[0])
    for axis, psf, dioptre in zip(axes, pictures.psfs, pictures.dioptres, strict=True):
        level = np.log10(np.maximum(psf / peak, 10**-_DECADES))
        axis.imshow(level, cmap="magma", vmin=-_DECADES, vmax=0, extent=extent)
        where = "infinity" if dioptre == 0 else f"{1 / dioptre:.3g} m"
        axis.set_title(f"{dioptre:.2g} D ({where})", fontsize=10)
        axis.set_yticks([])
        axis.set_xlabel("µm", fontsize=9)
    axes[0].set_ylabel(f"PSF, {_DECADES:g} decades")


def _draw_transfer(axis: Axes, pictures: DepthPictures, limit: NDArray[np.float64]) -> None:
    """Draw transfer functions along x at some depths, and the bound on their rms."""
    for number, (values, dioptre) in enumerate(
        zip(pictures.transfer, pictures.dioptres, strict=True)
    ):
        label, colour = f"{dioptre:.2g} D", f"C{number}"
        axis.semilogy(pictures.frequencies, values, lw=0.9, color=colour, label=label)
    axis.semilogy(pictures.frequencies, limit, "k--", label="limit of the rms")
    axis.set(
        title="Transfer function along x",
        xlabel="cycles per pixel",
        ylim=(1e-3, 1.2),
        xlim=(0, pictures.frequencies[-1]),
    )
    axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.legend(fontsize=8, ncols=2)
    axis.grid(alpha=0.3)


def _draw_quality(axis: Axes, done: FinishedDesign) -> None:
    """Draw the expected PSNR over depth of the design and of its start, and the bound."""
    known = done.problem.request.decoder == "known"
    for curves, style, name in ((done.start, "C1:", "start"), (done.design, "C0-", "design")):
        axis.plot(curves.dioptres, curves.known if known else curves.blind, style, label=name)
    axis.axhline(done.bound, color="k", ls="--", label="bound (mean, depth known)")
    what = "depth known" if known else "one filter for all depths"
    axis.set(title=f"Expected PSNR, {what}", xlabel="depth in dioptres", ylabel="dB")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
