"""Draw the measured PSF before and after a refinement."""

from __future__ import annotations

import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from labapp.common.figure_png import figure_to_png
from labapp.refining.result import RefinementResult


def draw_refinement(title: str, notes: str, result: RefinementResult) -> bytes:
    """Draw the first and the best measured PSF, the target, and the errors as a PNG file."""
    figure = Figure(figsize=(18, 4.9), dpi=100, layout="constrained")
    figure.suptitle(f"{title}\n{notes}", fontsize=12)
    *drawn, errors = figure.subplots(1, 4)
    first, best = result.pictures[0], result.pictures[result.best]
    shown = {
        f"Seen at first: NRMSE {first.nrmse:.3f}": first.light / first.scale,
        f"Seen at best, picture {result.best + 1}: NRMSE {best.nrmse:.3f}": best.light / best.scale,
        "Target, as the camera sees it": result.view.target,
    }
    for axes, (heading, light) in zip(drawn, shown.items(), strict=True):
        _draw(axes, result, light)
        axes.set_title(heading)
    _draw_errors(errors, result)
    return figure_to_png(figure)


def _draw(axes: Axes, result: RefinementResult, light: torch.Tensor) -> None:
    """Draw a measured PSF on the design grid, in units of the target."""
    plane = result.start.goal.plane
    y, x = (plane.coordinates(axis).numpy() * 1e6 for axis in (0, 1))
    half = plane.pitch[0] * 0.5e6
    extent = (x[0] - half, x[-1] + half, y[-1] + half, y[0] - half)
    # Speckle is brighter than the target, so white lies above the target's peak.
    white = 1.5 * float(result.view.target.max())
    axes.imshow(
        light.numpy(), cmap="magma", vmin=0, vmax=white, extent=extent, interpolation="nearest"
    )
    axes.set_xlabel("µm on the sensor, in the panel's axes")


def _draw_errors(axes: Axes, result: RefinementResult) -> None:
    numbers = range(1, len(result.pictures) + 1)
    axes.plot(numbers, [seen.nrmse for seen in result.pictures], "o-", label="error of the shape")
    axes.plot(numbers, [seen.contrast for seen in result.pictures], "s--", label="speckle contrast")
    axes.plot(numbers, [seen.noise for seen in result.pictures], ":", label="noise alone")
    axes.set_ylim(0, None)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("picture")
    axes.set_title("Error of what was seen (NRMSE)")
    axes.grid(alpha=0.3)
    axes.legend()
