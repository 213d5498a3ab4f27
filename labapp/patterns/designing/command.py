"""Compute a pattern, predict its PSF, write both, and say how good they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from labapp.bench.opening import BenchFiles
from labapp.common.console import out, print_json, table, watched
from labapp.common.errors import UserError
from labapp.files.bench_file import BenchFile, read_bench
from labapp.files.design_file import DesignContents, write_design
from labapp.files.pattern_table import Still, VideoPattern, pattern_data
from labapp.files.places import is_design
from labapp.files.writing import encoded, write_whole
from labapp.patterns.designing.asked import AskedDesign
from labapp.patterns.designing.made import Made, design
from labapp.patterns.designing.picture import picture
from labapp.patterns.grey_levels import Work
from optics.camera import Camera


def make(asked: AskedDesign, files: Sequence[Path], drawn: Path, *, as_json: bool) -> None:
    """Write a pattern to .png or .h5, and the picture of its PSF; print how good it is.

    files: of a video numbered pictures, or one .h5. UserError if something can't be.
    """
    spec, path = asked.shown, files[0]
    bench = read_bench(BenchFiles.default(asked.bench).bench)
    camera = bench.build_camera()
    try:
        with watched() as progress:
            work = Work(camera, asked.seed, progress, Path())
            made = design(
                asked.pattern,
                asked.frames,
                asked.wavelength,
                asked.side,
                work,
                keep_phases=is_design(path),
            )
    except ValueError as error:
        raise UserError(f"{spec.label}: {error}.") from error
    if is_design(path):
        write_design(path, _contents(asked, spec, bench, camera, made))
    else:
        for file, grey in zip(files, made.greys, strict=True):
            write_whole(file, encoded(file, grey))
    where = f"{bench.name}, {asked.wavelength * 1e9:g} nm"
    write_whole(drawn, picture(spec.label, where + _quality_in_words(made), made))
    data = {"pattern": spec.label, "files": [str(one) for one in (*files, drawn)], **made.figures}
    if as_json:
        print_json(data)
        return
    table(spec.label, ["", "value"], _rows(made))
    out.print(f"wrote {_named(files)}\nwrote {drawn}", markup=False, soft_wrap=True)


def _contents(
    asked: AskedDesign, spec: Still | VideoPattern, bench: BenchFile, camera: Camera, made: Made
) -> DesignContents:
    return DesignContents(
        title=spec.label,
        settings={"pattern": pattern_data(spec), "seed": asked.seed},
        bench=bench.model_dump(mode="json"),
        wavelength=asked.wavelength,
        grey=made.greys,
        phase=made.phases,
        orders=made.orders,
        frame_time=1 / camera.panel.frame_rate if asked.frames > 1 else 0.0,
        pixel_pitch=camera.panel.pitch,
        psf=made.psf,
        target=made.target,
        quality=made.figures["quality"],
    )


def _rows(made: Made) -> list[list[str]]:
    figures, quality = made.figures, made.figures["quality"]
    rows = [
        ["panel", "{1} x {0} pixels".format(*made.greys.shape[1:])],
        ["frames", f"{len(made.greys)}"],
        ["grey levels", f"{made.greys.min()} to {made.greys.max()}"],
    ]
    if quality:
        rows += [
            ["method", f"{quality['method']}, {quality['iterations']} iterations"],
            ["processor time", f"{quality['cpu_seconds']:.2f} s"],
            ["efficiency", f"{_span(quality['efficiency'])} of the light on the target"],
            ["speckle contrast", _span(quality["contrast"])],
            ["error of the shape", f"{_span(quality['nrmse'])} (NRMSE)"],
        ]
    height, width = made.psf.images.shape[1:]
    light = f"{_span(figures['light_in_window'])} in {width} x {height} sensor pixels"
    return [
        *rows,
        ["light in the window", light],
        ["brightest pixel", f"{_span(figures['brightest_pixel'])} of the light"],
    ]


def _quality_in_words(made: Made) -> str:
    quality = made.figures["quality"]
    if not quality:
        return ""
    return (
        f", efficiency {_span(quality['efficiency'])}, "
        f"speckle contrast {_span(quality['contrast'])}"
    )


def _span(values: Sequence[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"


def _named(files: Sequence[Path]) -> str:
    return str(files[0]) if len(files) == 1 else f"{files[0]} ... {files[-1].name}"
