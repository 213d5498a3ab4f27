"""Computes a pattern, predicts its PSF, writes both with a picture, and prints their quality."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.bench.opening import BenchFiles
from labapp.common.console import out, print_json, print_table, terminal_progress
from labapp.common.errors import UserError
from labapp.common.figure_png import figure_to_png
from labapp.files.bench_file import read_bench
from labapp.files.design_file import DesignContents, Grid, write_design
from labapp.files.output_paths import is_design
from labapp.files.pattern_table import pattern_data
from labapp.files.writing import encode_image, write_atomically
from labapp.patterns.designing.kinds import DesignRequest
from labapp.patterns.designing.pattern_design import PatternDesign, design_pattern


def write_pattern(
    request: DesignRequest, files: Sequence[Path], picture_path: Path, *, as_json: bool
) -> None:
    """Design a pattern, write it and a picture of its PSF, and print its quality.

    files: one .png per frame, or one .h5 design file.
    Raises UserError if the pattern can't be computed or shown.
    """
    spec, path = request.plan_pattern, files[0]
    bench = read_bench(BenchFiles.with_defaults(request.bench).bench)
    camera = bench.build_camera()
    try:
        with terminal_progress() as progress:
            made = design_pattern(request, camera, progress, keep_phases=is_design(path))
    except ValueError as error:
        raise UserError(f"{spec.label}: {error}.") from error
    if is_design(path):
        contents = DesignContents(
            title=spec.label,
            settings={"pattern": pattern_data(spec), "seed": request.seed},
            bench=bench.model_dump(mode="json"),
            wavelength=request.wavelength,
            grey=made.greys,
            phase=made.phases,
            orders=made.orders,
            frame_time=1 / camera.panel.frame_rate if request.frames > 1 else 0.0,
            pixel_pitch=camera.panel.pitch,
            psf=made.psf,
            target=made.target,
            quality=made.figures_of_merit["quality"],
        )
        write_design(path, contents)
    else:
        for file, grey in zip(files, made.greys, strict=True):
            write_atomically(file, encode_image(file, grey))
    notes = f"{bench.name}, {request.wavelength * 1e9:g} nm"
    if quality := made.figures_of_merit["quality"]:
        notes += (
            f", efficiency {_format_range(quality['efficiency'])}, "
            f"speckle contrast {_format_range(quality['contrast'])}"
        )
    write_atomically(picture_path, _draw_design(spec.label, notes, made))
    data = {
        "pattern": spec.label,
        "files": [str(one) for one in (*files, picture_path)],
        **made.figures_of_merit,
    }
    if as_json:
        print_json(data)
        return
    print_table(spec.label, ["", "value"], _rows(made))
    written = f"{path}" if len(files) == 1 else f"{path} ... {files[-1].name}"
    out.print(f"wrote {written}\nwrote {picture_path}", soft_wrap=True)


def _rows(design: PatternDesign) -> list[list[str]]:
    """Return the rows to print: panel, frames, grey levels and quality."""
    figures, quality = design.figures_of_merit, design.figures_of_merit["quality"]
    rows = [
        ["panel", "{1} x {0} pixels".format(*design.greys.shape[1:])],
        ["frames", f"{len(design.greys)}"],
        ["grey levels", f"{design.greys.min()} to {design.greys.max()}"],
    ]
    if quality:
        rows += [
            ["method", f"{quality['method']}, {quality['iterations']} iterations"],
            ["processor time", f"{quality['cpu_seconds']:.2f} s"],
            [
                "efficiency",
                f"{_format_range(quality['efficiency'])} of all light on the target, "
                f"{_format_range(quality['steered_share'])} of the light that can be steered",
            ],
            ["speckle contrast", _format_range(quality["contrast"])],
            ["error of the shape", f"{_format_range(quality['nrmse'])} (NRMSE)"],
        ]
    height, width = design.psf.images.shape[1:]
    light = f"{_format_range(figures['light_in_window'])} in {width} x {height} sensor pixels"
    return [
        *rows,
        ["light in the window", light],
        ["brightest pixel", f"{_format_range(figures['brightest_pixel'])} of the light"],
    ]


def _format_range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"


def _draw_design(title: str, notes: str, design: PatternDesign) -> bytes:
    """Draw a design as PNG: pattern, target, linear and logarithmic PSF of each moment.

    Of a target that changes with time, at most 4 moments are drawn, among them first and last.
    """
    count = len(design.psf.images)
    rows = np.unique(np.linspace(0, count - 1, min(count, 4)).round().astype(int))
    widths = [1.78, 1.0, 1.0] if design.target is None else [1.78, 1.0, 1.0, 1.0]
    size = (3.9 * sum(widths), 4.0 * len(rows) + 0.9)
    figure = Figure(figsize=size, dpi=100, layout="constrained")
    figure.suptitle(f"{title}\n{notes}", fontsize=12)
    axes = figure.subplots(len(rows), len(widths), squeeze=False, width_ratios=widths)
    for row, moment in zip(axes, rows, strict=True):
        _draw_moment(list(row), design, int(moment), count)
    return figure_to_png(figure)


def _draw_moment(axes: list[Axes], design: PatternDesign, moment: int, count: int) -> None:
    grey = design.greys[moment * len(design.greys) // count]
    which = f", moment {moment + 1} of {count}" if count > 1 else ""
    axes[0].imshow(grey, cmap="gray", interpolation="nearest")
    axes[0].set_title(f"Pattern (grey {grey.min()} to {grey.max()}){which}")
    axes[0].set(xticks=[], yticks=[])
    psf, target = design.psf.images[moment], design.target
    if target is not None:
        _draw(axes[1], target, target.images[moment], "Target")
        # The target is drawn over the same part of the sensor as the PSF beside it.
        axes[1].set_xlim(*_sample_edges(design.psf.x))
        axes[1].set_ylim(*reversed(_sample_edges(design.psf.y)))
        axes[1].set_facecolor("black")
    brightest = _white_level(psf, target is not None)
    clipped = ", brighter centre clipped" if brightest < psf.max() else ""
    _draw(axes[-2], design.psf, psf, f"Predicted PSF{clipped}", Normalize(0, brightest))
    peak = max(float(psf.max()), np.finfo(np.float64).tiny)
    lowest = peak * 1e-4
    shown = np.maximum(psf, lowest)
    _draw(axes[-1], design.psf, shown, "Predicted PSF, 4 decades", LogNorm(lowest, peak))


def _white_level(psf: NDArray[np.float64], has_target: bool) -> float:
    """Return the brightness that is drawn as white: the PSF's peak.

    If the pattern has a target, the pixels within 4 of the axis, where unmodulated light falls, are
    left out.
    """
    rest = psf.copy()
    if has_target:
        middle = tuple(slice(max(n // 2 - 4, 0), n // 2 + 5) for n in psf.shape)
        rest[middle] = 0
    return float(rest.max()) or float(psf.max()) or 1.0


def _draw(
    axes: Axes, grid: Grid, values: NDArray[np.float64], title: str, norm: Normalize | None = None
) -> None:
    (left, right), (top, bottom) = _sample_edges(grid.x), _sample_edges(grid.y)
    extent = (left, right, bottom, top)
    axes.imshow(values, cmap="magma", norm=norm, extent=extent, interpolation="nearest")
    axes.set(title=title, xlabel="µm on the sensor")


def _sample_edges(place: NDArray[np.float64]) -> tuple[float, float]:
    """Return the outer edges of the first and last sample in µm, from centres in metres."""
    half = (place[-1] - place[0]) / max(len(place) - 1, 1) / 2
    return float(place[0] - half) * 1e6, float(place[-1] + half) * 1e6
