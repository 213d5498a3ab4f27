"""`labapp design edof`: design a pattern for depth of field, and tell what it gives."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labapp.bench.opening import BenchFiles
from labapp.common.console import out, print_json, print_table, terminal_progress
from labapp.common.errors import UserError
from labapp.edof.design_analysis import (
    FinishedDesign,
    analyse_depths,
    bound_level,
    compute_depth_pictures,
    rate_all_hand_made,
    rate_on_bench,
)
from labapp.edof.design_drawing import draw_design
from labapp.edof.design_problem import EdofProblem
from labapp.edof.design_request import EdofRequest
from labapp.edof.design_search import DesignStateFile, search_pattern
from labapp.files.bench_file import BenchFile, read_bench
from labapp.files.design_file import DesignContents, Grid, write_design
from labapp.files.state_file import StateFile
from labapp.files.writing import encode_image, write_atomically
from optics.edof.pattern_rating import SearchSettings, SearchState
from optics.edof.pattern_search import DesignBand
from optics.edof.pattern_transfer import PatternTransfer
from optics.slm import phase_to_grey
from optics.threads import single_threaded

_TIMED_STEPS = 3
"""Steps of which the time is measured, before minutes become a number of steps."""


@single_threaded
def design_edof(
    request: EdofRequest, files: Sequence[Path], *, steps: int | None, minutes: float, as_json: bool
) -> None:
    """Design a pattern that extends the depth of field, write it, and print what it gives.

    Raises UserError if the bench can't be designed for, or a file can't be read.

    files: the design file (.h5), and pictures (.png) of the pattern and of the design.
    steps: of the search; None for as many as `minutes` are enough for.
    minutes: time that the search may take, of which the number of steps is made once.
    """
    bench = read_bench(BenchFiles.with_defaults(request.bench).bench)
    problem = EdofProblem(request, bench.build_camera())
    try:
        done = _design(problem, files[0], steps, minutes, quiet=as_json)
    except ValueError as error:
        raise UserError(f"design edof: {error}.") from error
    _write(done, bench, files)
    if as_json:
        print_json({**_account(done), "files": [str(one) for one in files]})
        return
    print_table("Pattern for an extended depth of field", ["", "blind", "depth known"], _rows(done))
    out.print(_notes(done))
    for one in files:
        out.print(f"wrote {one}", soft_wrap=True)


def _design(
    problem: EdofProblem, path: Path, steps: int | None, minutes: float, *, quiet: bool
) -> FinishedDesign:
    """Search for a pattern, go on from a kept state if there is one, and analyse what is found."""
    request, started = problem.request, time.process_time()
    transfer = problem.transfer(request.wavelengths[0])
    start = problem.parametrisation.fit(problem.start_phase())
    file = StateFile(path.with_suffix(".design-state"), "design")
    steps = steps or file.read_steps() or _steps_in(minutes, problem, transfer, start)
    kept = DesignStateFile(file, {**request.as_data(), "steps": steps})
    state = kept.read() or SearchState()
    if not quiet:
        going_on = f" (going on after step {state.step})" if state.step else ""
        out.print(f"{steps} steps{going_on}; kept so far in {file.path}")
    with terminal_progress() as progress:
        result = search_pattern(problem, transfer, start, steps, state, kept, progress.part(0, 0.8))
        phase = problem.whole_phase(result.parameters).detach()
        pictures = compute_depth_pictures(problem, transfer, phase, progress.part(0.8, 0.85))
        grey = phase_to_grey(problem.camera.panel, phase, request.wavelengths[0], request.orders)
        count = len(request.wavelengths)
        parts = [progress.part(0.85, 1).part(k / count, (k + 1) / count) for k in range(count)]
        on_bench = {
            one: rate_on_bench(problem, grey, one, part)
            for one, part in zip(request.wavelengths, parts, strict=True)
        }
    limit = problem.limit(request.wavelengths[0])
    done = FinishedDesign(
        problem,
        result,
        phase,
        grey.numpy(),
        analyse_depths(problem, transfer, problem.phase(start)),
        analyse_depths(problem, transfer, result.phase),
        on_bench,
        rate_all_hand_made(problem),
        bound_level(problem, limit),
        limit,
        pictures,
        steps,
        time.process_time() - started,
    )
    file.delete()
    return done


def _steps_in(
    minutes: float, problem: EdofProblem, transfer: PatternTransfer, start: torch.Tensor
) -> int:
    """Return how many steps fit into some minutes, by the time of a few of them."""
    depths = tuple(np.linspace(*problem.depth_range, SearchSettings().depths))
    parameters = start.clone().requires_grad_()
    seconds = []
    for band in (DesignBand(transfer, start, problem.phase), *problem.further_bands()):
        times = []
        for _ in range(_TIMED_STEPS):
            begun = time.perf_counter()
            found = band.transfer(band.pattern(parameters), depths)
            torch.autograd.backward(found.abs().sum())
            times.append(time.perf_counter() - begun)
        seconds.append(min(times))
    # The search takes the bands in turn.
    return max(1, int(60 * minutes * len(seconds) / sum(seconds)))


def _write(done: FinishedDesign, bench: BenchFile, files: Sequence[Path]) -> None:
    """Write the design file, the pattern as the panel shows it, and the drawing."""
    request, pictures = done.problem.request, done.pictures
    lens, panel = done.problem.camera.lens, done.problem.camera.panel
    period = 2 * math.pi * request.orders
    places = (pictures.pixels.coordinates(axis).numpy() for axis in (0, 1))
    contents = DesignContents(
        title="extended depth of field",
        settings={
            "design": "edof",
            **request.as_data(),
            "fringing": done.problem.fringing,
            "focus_dioptre": 1 / lens.focus_distance,
            "orientation": "rows from the top, columns from the left, as the panel shows them",
            "lut": (
                "the panel's measured response" if panel.response else "linear to the panel's range"
            ),
        },
        bench=bench.model_dump(mode="json"),
        wavelength=request.wavelengths[0],
        grey=done.grey[None],
        phase=torch.remainder(done.phase, period).to(torch.float32).numpy()[None],
        orders=request.orders,
        frame_time=0.0,
        pixel_pitch=panel.pitch,
        psf=Grid(pictures.psfs, *places),
        target=None,
        # Lists have a value for each rated depth.
        quality={
            **_account(done)["expected_psnr"],
            "depths_dioptre": done.design.dioptres.tolist(),
            "blind_over_depth": done.design.blind.tolist(),
            "known_over_depth": done.design.known.tolist(),
            "shown_dioptre": pictures.dioptres.tolist(),
            "steps": done.steps,
            "cpu_seconds": done.cpu_seconds,
        },
    )
    design, pattern, picture = files
    write_design(design, contents)
    write_atomically(pattern, encode_image(pattern, done.grey))
    rating, names = done.design.rating, " + ".join(f"{1e9 * one:g}" for one in request.wavelengths)
    reached = rating.known_depth if request.decoder == "known" else rating.blind
    title = (
        f"Extended depth of field, {request.far:g} to {request.near:g} D, {names} nm, "
        f"{request.decoder}: {reached:.2f} dB expected, bound {done.bound:.2f} dB"
    )
    write_atomically(picture, draw_design(title, done))


def _account(done: FinishedDesign) -> dict[str, Any]:
    """Return what is told of the result, as plain data."""
    request, rating = done.problem.request, done.design.rating
    return {
        "settings": request.as_data(),
        "steps": done.steps,
        "skipped_steps": done.result.skipped,
        "cpu_seconds": done.cpu_seconds,
        "light_in_window": rating.light,
        "expected_psnr": {
            "blind": rating.blind,
            "known_depth": rating.known_depth,
            "bound": done.bound,
            "start_blind": done.start.rating.blind,
            "start_known_depth": done.start.rating.known_depth,
        },
        "on_bench": [
            {"wavelength_nm": 1e9 * one, "blind": rated.blind, "known_depth": rated.known_depth}
            for one, rated in done.on_bench.items()
        ],
        "hand_made": {
            name: {"blind": one.blind, "known_depth": one.known_depth}
            for name, one in done.hand_made.items()
        },
        "spectrum": done.problem.spectrum_source,
    }


def _rows(done: FinishedDesign) -> list[list[str]]:
    """Return the printed rows: expected PSNR in dB, beside the bound."""
    rated = [("designed", done.design.rating)]
    rated += [
        (f"designed, on this bench, {1e9 * one:g} nm", rating)
        for one, rating in done.on_bench.items()
    ]
    rated += [("start", done.start.rating)]
    rated += [(f"{name}, hand-made", one) for name, one in done.hand_made.items()]
    rows = [[name, f"{one.blind:.2f} dB", f"{one.known_depth:.2f} dB"] for name, one in rated]
    return [*rows, ["bound of any pattern", "", f"{done.bound:.2f} dB"]]


def _notes(done: FinishedDesign) -> str:
    """Return the sentences that are printed below the table."""
    request, rating = done.problem.request, done.design.rating
    worst = done.design.known if request.decoder == "known" else done.design.blind
    told = [
        f"Expected PSNR of linear restoration, {request.far:g} to {request.near:g} D, noise "
        f"{request.noise:g}, spectrum of {done.problem.spectrum_source}.",
        f"Worst depth {worst.min():.2f} dB at {done.design.dioptres[worst.argmin()]:.2f} D. "
        f"{100 * rating.light:.1f} % of the light reaches the window.",
        f"{done.steps} steps, {done.cpu_seconds:.0f} s of processor time.",
    ]
    if done.result.skipped:
        told.append(f"{done.result.skipped} steps had no finite gradient and were skipped.")
    told.append(
        "On this bench: with the panel's grey levels, gaps and unmodulated light, on whole pixels. "
        "All other rows, and the bound, are of a panel without them, at points."
    )
    if done.problem.camera.separation:
        told.append(
            "Designed for the lens at the panel that gives the same PSFs on the axis where the "
            "stop cuts nothing; the PSFs shown are those of the bench."
        )
    return "\n".join(told)
