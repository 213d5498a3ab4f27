"""`labapp accuracy ...` of pictures: restored, of extended depth, simulated, merged."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from labapp.cli.accuracy import accuracy
from labapp.cli.lens_options import CameraOptions
from labapp.cli.option_groups import command_with_options, get_option_group
from labapp.cli.shared_options import (
    JsonOption,
    PeersOption,
    PictureOptions,
    PixelNoiseOption,
    RowsOutputOptions,
    file_option,
    readable_path,
    require_writable_rows,
)
from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_whole, split_list

AddedNoiseOption = Annotated[
    float, typer.Option(min=0, help="Standard deviation of the noise of a pixel; white is 1.")
]


@accuracy.command("deconvolve", cls=command_with_options(RowsOutputOptions()))
def accuracy_deconvolve_(
    context: typer.Context,
    picture: Annotated[
        Path | None,
        typer.Argument(
            metavar="[PICTURE]",
            callback=readable_path,
            help="Sharp picture to be blurred.",
            show_default="the demo's",
        ),
    ] = None,
    blur: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Blur, with lengths in pixels; an unknown name lists all of them.",
        ),
    ] = "disk of 7",
    psf: Annotated[
        Path | None, file_option("Picture or .npy of a PSF, instead of --blur.", metavar="FILE")
    ] = None,
    noise: AddedNoiseOption = 0.01,
    border: Annotated[
        str,
        typer.Option(
            help="Scene beyond the frame: unknown, as for a camera, or periodic, with one whole "
            "period in the frame."
        ),
    ] = "unknown",
    size: Annotated[
        int,
        typer.Option(
            min=32, help="Largest side in pixels; larger pictures are cut to their middle."
        ),
    ] = 512,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    peers: PeersOption = False,
) -> None:
    """Measure the quality and time of every restoration method on a blurred picture (--blur).

    The picture is blurred, and noise is added. Each method estimates noise and weights by itself.
    The table gives PSNR in dB, SSIM and processor time in ms. Rows on the front are beaten by no
    other row in both time and error; **labapp reconstruct --budget** chooses from such a front. A
    method that fails has a row, too. For instance

    **labapp accuracy deconvolve --blur "Gaussian of 1.5" --size 128**
    """
    from labapp.accuracy.option_validation import require_blur

    require_blur(blur, border)
    rows = require_writable_rows(context)
    from labapp.accuracy.blurs import photograph_from_options
    from labapp.accuracy.deconvolve import accuracy_deconvolve
    from labapp.pictures.networks import bundled_denoiser

    case = photograph_from_options(picture, blur, psf, noise, border, size, seed)
    accuracy_deconvolve(case, bundled_denoiser(), peers=peers, as_json=rows.json, plot=rows.plot)


@accuracy.command("multispectral", cls=command_with_options(RowsOutputOptions()))
def accuracy_multispectral_(
    context: typer.Context,
    cube: Annotated[
        Path | None,
        typer.Argument(
            metavar="[CUBE]",
            callback=readable_path,
            help="Spectral cube (.h5 or .hdr) in shares of white.",
            show_default="a ColorChecker in six bands",
        ),
    ] = None,
    psf: Annotated[
        str,
        typer.Option(
            metavar="SHAPE",
            help="Shape of the PSFs: ring, spiral, dots or linear dispersion.",
        ),
    ] = "ring",
    noise: AddedNoiseOption = 0.01,
    size: Annotated[
        int,
        typer.Option(min=32, help="Largest side in pixels; larger cubes are cut to their middle."),
    ] = 256,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
) -> None:
    """Measure the quality and time of spectral bands that are restored from one snapshot (CUBE).

    The snapshot is computed: each band is blurred by a PSF of its own (--psf), a colour sensor sees
    their sum, and noise is added. It is restored with a prior of typical spectra, which adapts to
    the scene or doesn't, and by the objective of the thesis, after more and more iterations. The
    table gives the mean PSNR of the bands in dB, that of the worst band, and processor time in ms.
    Rows on the front are beaten by no other row in both time and error. For instance

    **labapp accuracy multispectral --psf dots --size 128**
    """
    from labapp.accuracy.option_validation import require_psf_name

    require_psf_name(psf)
    rows = require_writable_rows(context)
    from labapp.accuracy.multispectral import accuracy_multispectral
    from labapp.accuracy.spectral_case import spectral_case_from_options

    case = spectral_case_from_options(cube, psf, noise, size, seed)
    accuracy_multispectral(case, as_json=rows.json, plot=rows.plot)


@accuracy.command("edof", cls=command_with_options(CameraOptions(), RowsOutputOptions()))
def accuracy_edof_(
    context: typer.Context,
    part: Annotated[
        str,
        typer.Option(help="What is measured: design, psf (with its gradient), or all of it."),
    ] = "all",
    panel: Annotated[
        str | None,
        typer.Option(
            metavar="ROWSxCOLUMNSxUM",
            show_default="the camera's, or 1080x1920x8",
            help="Number of panel pixels, and their pitch in micrometres.",
        ),
    ] = None,
    steps: Annotated[int, typer.Option(min=1, help="Largest number of steps of a design.")] = 100,
    noise: PixelNoiseOption = 0.008,
    size: Annotated[
        int, typer.Option(min=32, max=2048, help="Pixels along a side of a design's pictures.")
    ] = 256,
    window: Annotated[
        int, typer.Option(min=8, max=2048, help="Sensor pixels along a side of the PSFs.")
    ] = 256,
) -> None:
    """Measure what patterns for an extended depth of field reach, and the time they take (--steps).

    Each row of the first table is a design after a number of steps: how the pattern is described,
    where it starts, and the depths per step. Its error is the distance in dB from the bound that no
    pattern can pass with the depth known to the PSNR that is expected of one filter for all depths.
    It doesn't reach zero. The second table has the methods for the PSF of a pattern and its
    gradient at each tolerance, with relative L2 errors against a sum over the panel's pixels in
    double precision. Rows on the front are beaten by no other row in both time and error. For
    instance

    **labapp accuracy edof --panel 108x192x16 --size 64 --window 64 --steps 30**
    """
    from labapp.accuracy.option_validation import require_edof_part

    require_edof_part(part)
    rows = require_writable_rows(context)
    file = get_option_group(context, CameraOptions).camera
    from labapp.accuracy.edof_case import edof_case_from_options
    from labapp.files.bench_file import read_camera

    camera = None if file is None else read_camera(file)
    case = edof_case_from_options(camera, panel, noise=noise, size=size, window=window)
    from labapp.accuracy.edof import accuracy_edof

    accuracy_edof(case, part=part, most_steps=steps, as_json=rows.json, plot=rows.plot)


@accuracy.command("simulate", cls=command_with_options(PictureOptions()))
def accuracy_simulate_(
    context: typer.Context,
    bench: Annotated[
        Path | None,
        file_option("Bench file (TOML).", show_default="the bundled one, with few pixels"),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Measure what each tolerance costs a simulated picture (--target), and check that it is kept.

    One picture is simulated at each tolerance by its effect plan, and once with all effects at
    their finest. The table gives relative L2 errors of the mean picture, of its variance and of its
    standard deviation, and processor time in ms. The default bench has few pixels, because all
    effects take minutes on a bench of full size. The exit code is 1 if a tolerance is exceeded. For
    instance

    **labapp accuracy simulate --target star**
    """
    from labapp.accuracy.simulate import accuracy_simulate

    asked = get_option_group(context, PictureOptions).picture_request(bench)
    accuracy_simulate(asked, as_json=json)


@accuracy.command("hdr", cls=command_with_options(RowsOutputOptions()))
def accuracy_hdr_(
    context: typer.Context,
    frames: Annotated[
        str, typer.Option(metavar="N,N,…", help="Numbers of exposures, each from 1 to 16.")
    ] = "1,2,3,4,6,8",
    ratio: Annotated[
        float, typer.Option(min=1.1, max=64, help="Ratio of each exposure time to the one before.")
    ] = 4.0,
    shortest_ms: Annotated[
        float, typer.Option(min=1e-3, max=1e6, help="Shortest exposure time, in milliseconds.")
    ] = 1.0,
    decades: Annotated[
        float,
        typer.Option(
            min=0.5, max=8, help="Decades of light, below what nearly clips the shortest exposure."
        ),
    ] = 4.0,
    darks: Annotated[int, typer.Option(min=1, max=100, help="Dark frames of each exposure.")] = 16,
    bits: Annotated[int, typer.Option(min=8, max=16, help="Bits of a digital number.")] = 12,
    gain: Annotated[
        float, typer.Option(min=1e-3, max=1e3, help="Electrons per digital number.")
    ] = 2.6,
    read_noise: Annotated[
        float, typer.Option(min=0, max=1e4, help="Read noise in electrons.")
    ] = 2.4,
    pixels: Annotated[
        int, typer.Option(min=100, max=1_000_000, help="Pixels of each of 48 levels of light.")
    ] = 2000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
) -> None:
    """Measure the error and time of merges of brackets, by exposures and total time (--frames).

    Frames of even light at many levels are simulated with the noise of photons, reading and
    rounding, and merged by every method, and by OpenCV's methods of Debevec and Robertson. The
    table gives relative errors beside the ones that each method states, the efficiency against the
    least variance of any unbiased estimate, bias, and processor time in ms. Rows on the front are
    beaten by no other row in both time and error; **labapp merge --budget** chooses among such
    methods. A method that fails has a row, too. The diagram (--plot) shows errors by exposures with
    their total time, beside the least possible ones, and by processor time. For instance

    **labapp accuracy hdr --frames 2,4 --pixels 500**
    """
    counts = _read_counts(frames)
    rows = require_writable_rows(context)
    from labapp.accuracy.hdr import accuracy_hdr
    from labapp.accuracy.hdr_case import BracketCase

    cases = [
        BracketCase(
            count, ratio, shortest_ms * 1e-3, decades, darks, bits, gain, read_noise, pixels, seed
        )
        for count in counts
    ]
    accuracy_hdr(cases, as_json=rows.json, plot=rows.plot)


def _read_counts(text: str) -> list[int]:
    """Parse the numbers of exposures, rising; raise UserError unless all are 1 to 16."""
    try:
        counts = sorted({parse_whole(part) for part in split_list(text)})
    except ValueError:
        counts = []
    if not counts or not 1 <= counts[0] <= counts[-1] <= 16:
        raise UserError(
            f"--frames {text}: give whole numbers from 1 to 16 with commas between them, as in 2,4."
        )
    return counts
