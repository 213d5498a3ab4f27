"""Computes a pattern, predicts its PSF, writes both, and prints their quality."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from labapp.bench.opening import BenchFiles
from labapp.common.console import out, print_json, print_table, terminal_progress
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile, read_bench
from labapp.files.design_file import DesignContents, write_design
from labapp.files.output_paths import is_design
from labapp.files.pattern_table import StillPattern, VideoPattern, pattern_data
from labapp.files.writing import encode_image, write_atomically
from labapp.patterns.designing.design_picture import draw_design
from labapp.patterns.designing.design_request import DesignRequest
from labapp.patterns.designing.pattern_design import PatternDesign, design_pattern
from labapp.patterns.grey_levels import PatternContext
from optics.camera import Camera


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
            work = PatternContext(camera, request.seed, progress, Path())
            made = design_pattern(
                request.pattern,
                request.frames,
                request.wavelength,
                request.side,
                work,
                keep_phases=is_design(path),
            )
    except ValueError as error:
        raise UserError(f"{spec.label}: {error}.") from error
    if is_design(path):
        write_design(path, _contents(request, spec, bench, camera, made))
    else:
        for file, grey in zip(files, made.greys, strict=True):
            write_atomically(file, encode_image(file, grey))
    where = f"{bench.name}, {request.wavelength * 1e9:g} nm"
    write_atomically(picture_path, draw_design(spec.label, where + _format_quality(made), made))
    data = {
        "pattern": spec.label,
        "files": [str(one) for one in (*files, picture_path)],
        **made.figures_of_merit,
    }
    if as_json:
        print_json(data)
        return
    print_table(spec.label, ["", "value"], _rows(made))
    out.print(f"wrote {_format_file_names(files)}\nwrote {picture_path}", soft_wrap=True)


def _contents(
    request: DesignRequest,
    spec: StillPattern | VideoPattern,
    bench: BenchFile,
    camera: Camera,
    design: PatternDesign,
) -> DesignContents:
    return DesignContents(
        title=spec.label,
        settings={"pattern": pattern_data(spec), "seed": request.seed},
        bench=bench.model_dump(mode="json"),
        wavelength=request.wavelength,
        grey=design.greys,
        phase=design.phases,
        orders=design.orders,
        frame_time=1 / camera.panel.frame_rate if request.frames > 1 else 0.0,
        pixel_pitch=camera.panel.pitch,
        psf=design.psf,
        target=design.target,
        quality=design.figures_of_merit["quality"],
    )


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


def _format_quality(design: PatternDesign) -> str:
    quality = design.figures_of_merit["quality"]
    if not quality:
        return ""
    return (
        f", efficiency {_format_range(quality['efficiency'])}, "
        f"speckle contrast {_format_range(quality['contrast'])}"
    )


def _format_range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"


def _format_file_names(files: Sequence[Path]) -> str:
    return str(files[0]) if len(files) == 1 else f"{files[0]} ... {files[-1].name}"
