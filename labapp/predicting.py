"""`labapp psf`: the PSF of a lens, or of a lens with a pattern on an SLM before it."""

from __future__ import annotations

import io
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from labapp.asked import Case
from labapp.bench import BenchFiles
from labapp.console import out, print_json, table, watched
from labapp.errors import UserError
from labapp.files.bench_file import read_bench
from labapp.files.reading import read_grey
from labapp.files.writing import require_writable, write_whole
from labapp.speed import machine_speed
from optics.accuracy import Account, Budget, MachineSpeed, describe
from optics.camera import Camera
from optics.psf import PSFOperator
from optics.psf.modulated import modulated_psf
from optics.slm import Modulator, require_grey
from optics.threads import single_threaded

_SUFFIXES = (".npy", ".tiff", ".png")


@dataclass(frozen=True)
class Asked:
    """What the command line asks for.

    points: density at pixel centres, not light on whole pixels. pattern: a picture on the
    panel of the bench file. memory: bytes that may be used.
    """

    case: Case
    tol: float
    points: bool
    method: str | None
    memory: int
    pattern: Path | None
    bench: Path | None


@single_threaded
def predict(asked: Asked, path: Path, *, force: bool, as_json: bool) -> None:
    """Compute a PSF, print its account, and write it; .npy and .tiff get a picture beside."""
    if path.suffix.lower() not in _SUFFIXES:
        raise UserError(f"{path}: the ending must be one of {', '.join(_SUFFIXES)}.")
    picture = path.with_suffix(".png")
    for one in dict.fromkeys((path, picture)):
        require_writable(one, force=force)
    with watched() as progress:
        speed = machine_speed(progress)
    started = time.process_time()
    operator, call = _plan(asked, speed)
    psf = call()
    planned = time.process_time() - started
    # The first call also loads and allocates; every further one costs this.
    started = time.process_time()
    call()
    account = operator.account.spent(time.process_time() - started)
    _write(path, psf)
    if picture != path:
        _write(picture, psf)
    data = describe(account) | {
        "cpu_plan_s": planned,
        "sum": float(psf.sum()),
        "peak": float(psf.max()),
        "file": str(path),
        "picture": str(picture),
    }
    if as_json:
        print_json(data)
        return
    table("PSF", ["", "value"], _rows(account, data))
    out.print("\n".join(f"wrote {one}" for one in dict.fromkeys((path, picture))))


def _plan(asked: Asked, speed: MachineSpeed) -> tuple[PSFOperator, Callable[[], NDArray[Any]]]:
    """The operator for the question, planned, and the call that answers it."""
    case = asked.case
    plan = partial(
        PSFOperator,
        distance=case.distance,
        wavelength=case.wavelength,
        pixels=case.pixels,
        integrate=not asked.points,
        tol=asked.tol,
        method=asked.method,
        budget=Budget(asked.memory, speed),
    )
    if asked.pattern is None:
        alone = plan(case.lens)
        return alone, lambda: alone().numpy()
    camera = _camera(asked)
    grey = read_grey(asked.pattern)
    try:
        require_grey(camera.panel, grey)
    except ValueError as error:
        raise UserError(f"{asked.pattern}: {error}.") from error
    operator = plan(camera, unmodulated=0.0)
    modulator = Modulator(camera.panel, case.wavelength)
    exposures = modulator.still(torch.from_numpy(grey))
    return operator, lambda: modulated_psf(operator, modulator, exposures).numpy()


def _camera(asked: Asked) -> Camera:
    """The bench's panel behind which the asked lens stands."""
    bench = read_bench(BenchFiles.default(asked.bench).bench).build_camera()
    return replace(bench, lens=asked.case.lens)


def _rows(account: Account, data: dict[str, Any]) -> list[list[str]]:
    spent = 1e3 * (account.cpu_spent or 0)
    return [
        ["method", account.method],
        ["sampling", account.sampling],
        ["precision", account.precision],
        ["error asked for", f"{account.tol:.1g} relative L2, of sampling and arithmetic"],
        ["error of sampling", f"{account.sampling_error.value:.1g}, {account.sampling_error.how}"],
        ["error of arithmetic", f"{account.arithmetic.value:.1g}, {account.arithmetic.how}"],
        ["error of the model", f"{account.model.value:.1g}, {account.model.how}; beside the above"],
        ["planning, first call", f"{data['cpu_plan_s']:.2f} s of processor time"],
        ["every further call", f"{spent:.1f} ms (predicted {1e3 * account.cpu_predicted:.1f})"],
        ["memory", f"{account.bytes / 1e6:.1f} MB"],
        ["light in the window", f"{data['sum']:.4%}".replace("%", " %")],
        ["brightest pixel", f"{data['peak']:.4%}".replace("%", " %")],
    ]


def _write(path: Path, psf: NDArray[Any]) -> None:
    """A PSF by the file's ending; a picture shows five decades, brightest pixel white."""
    if path.suffix.lower() == ".npy":
        buffer = io.BytesIO()
        np.save(buffer, psf)
        write_whole(path, buffer.getvalue())
        return
    values = psf.astype(np.float32) if path.suffix.lower() == ".tiff" else _decades(psf)
    done, data = cv2.imencode(path.suffix, values)
    if not done:
        raise UserError(f"{path}: could not be encoded.")
    write_whole(path, data.tobytes())


def _decades(psf: NDArray[Any], decades: float = 5.0) -> NDArray[np.uint8]:
    floor = 10.0**-decades
    share = np.clip(psf / max(float(psf.max()), np.finfo(np.float64).tiny), floor, 1)
    return (255 * (1 + np.log10(share) / decades)).round().astype(np.uint8)
