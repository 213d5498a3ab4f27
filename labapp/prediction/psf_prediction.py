"""The command `labapp psf`: the PSF of a lens, or of a camera with a pattern on its SLM."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.console import out, print_json, print_table, terminal_progress
from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from labapp.files.bench_file import read_camera
from labapp.files.grey_table import read_grey_pattern
from labapp.files.picture.stated_encoding import mark_drawing
from labapp.files.writing import encode_image, write_atomically
from labapp.prediction.lens_options import LensCase
from optics.accuracy import Account, Budget, MachineSpeed, account_as_dict
from optics.camera import Camera
from optics.camera.pupil import share_through_stop
from optics.psf import PSFOperator
from optics.psf.behind_modulator import modulated_psf
from optics.slm import Modulator
from optics.threads import single_threaded


@dataclass(frozen=True)
class PSFRequest:
    """The options of `labapp psf`.

    tol: relative L2 error that is accepted. points: whether to compute the irradiance at pixel
    centres instead of the light on whole pixels. method: None for the best one. memory: bytes that
    may be used. pattern: grey levels of the panel. field: position (y, x) of the point's image on
    the sensor, metres from the axis. sphere: whether the object's wave is an exact sphere instead
    of a parabola. seconds: of processor time that planning and the PSF may take.
    """

    case: LensCase
    tol: float
    points: bool
    method: str | None
    memory: int
    pattern: Path | None
    field: tuple[float, float] = (0.0, 0.0)
    sphere: bool = False
    seconds: float = Budget.seconds

    @cached_property
    def camera(self) -> Camera | None:
        """The camera behind the panel; None for a lens alone.

        For a pattern without a camera it is the virtual bench's camera with the requested lens.
        """
        if self.case.camera is not None or self.pattern is None:
            return self.case.camera
        return replace(read_camera(None), lens=self.case.lens)

    @property
    def point_options(self) -> dict[str, Any]:
        """PSFOperator's options that concern the point, besides its distance, where given."""
        asked = {"field": self.field if any(self.field) else None, "sphere": self.sphere or None}
        return {name: value for name, value in asked.items() if value is not None}


@single_threaded
def predict_psf(request: PSFRequest, path: Path, picture: Path, *, as_json: bool) -> None:
    """Compute a PSF, print how, and write it to a file with a picture beside it."""
    grey = _panel_greys(request)
    with terminal_progress() as progress:
        speed = machine_speed(progress)
    started = time.process_time()
    operator, call = _plan(request, grey, speed)
    psf = call()
    planned = time.process_time() - started
    # The first call also loads libraries and allocates memory, so the second one is timed.
    started = time.process_time()
    call()
    account = operator.account.with_cpu_spent(time.process_time() - started)
    _write(path, psf)
    if picture != path:
        _write(picture, psf)
    data = (
        account_as_dict(account)
        | _light_budget(request)
        | {
            "cpu_plan_s": planned,
            "sum": float(psf.sum()),
            "peak": float(psf.max()),
            "file": str(path),
            "picture": str(picture),
        }
    )
    if as_json:
        print_json(data)
        return
    print_table("PSF", ["", "value"], _rows(account, data))
    out.print("\n".join(f"wrote {one}" for one in dict.fromkeys((path, picture))))


def _plan(
    request: PSFRequest, grey: NDArray[np.uint8] | None, speed: MachineSpeed
) -> tuple[PSFOperator, Callable[[], NDArray[Any]]]:
    """Return the planned operator and the call that computes the PSF."""
    case, camera = request.case, request.camera
    plan = partial(
        PSFOperator,
        distance=case.distance,
        wavelength=case.wavelength,
        pixels=case.pixels,
        integrate=not request.points,
        tol=request.tol,
        method=request.method,
        budget=Budget(request.memory, speed, seconds=request.seconds),
    )
    if camera is None or grey is None:
        alone = plan(case.lens)
        return alone, lambda: alone().numpy()
    operator = plan(camera, unmodulated=0.0, **request.point_options)
    modulator = Modulator(camera.panel, case.wavelength)
    exposures = modulator.still_fields(torch.from_numpy(grey))
    return operator, lambda: modulated_psf(operator, modulator, exposures).numpy()


def _panel_greys(request: PSFRequest) -> NDArray[np.uint8] | None:
    """Read the panel's grey levels from a picture, all 0 without one; None for a lens alone.

    Raises UserError for options that have no meaning for a lens without a panel.
    """
    if request.camera is not None:
        panel = request.camera.panel
        if request.pattern is None:
            return np.zeros(panel.shape, dtype=np.uint8)
        return read_grey_pattern(request.pattern, panel)
    for name in request.point_options:
        raise UserError(
            f"--{name}: a lens alone gives the same PSF all over the field, and has no panel for "
            "a wave to fall on. Give the panel before it as well: --camera FILE."
        )
    return None


def _light_budget(request: PSFRequest) -> dict[str, Any]:
    """Return, as plain data, the shares of light that pass the stop and that stay unmodulated."""
    camera = request.camera
    if camera is None:
        return {}
    return {
        "through_stop": share_through_stop(camera, request.case.distance, request.field),
        "unmodulated": Modulator(camera.panel, request.case.wavelength).unmodulated_share,
        "interference": request.case.interference,
    }


def _rows(account: Account, data: dict[str, Any]) -> list[list[str]]:
    """Return the rows of the printed table."""
    spent = 1e3 * (account.cpu_spent or 0)
    rows = [
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
    ]
    if "through_stop" in data:
        passing = f"{data['through_stop']:.2%}, by rays".replace("%", " %")
        rows.append(["light through the stop", passing])
        rows.append(["unmodulated light", f"{data['unmodulated']:.2%}".replace("%", " %")])
    strength = data.get("interference")
    if strength is not None:
        # Strengths up to 1e-9 are rounding errors.
        left_out = (
            f"{strength:.2g} √(modulated × unmodulated PSF) at most"
            if strength > 1e-9
            else "none: the two are polarised across each other"
        )
        rows.append(["interference left out", left_out])
    return [
        *rows,
        ["light in the window", f"{data['sum']:.4%}".replace("%", " %")],
        ["brightest pixel", f"{data['peak']:.4%}".replace("%", " %")],
    ]


def _write(path: Path, psf: NDArray[Any]) -> None:
    """Write a PSF to a file of the kind that its ending names.

    A picture shows five decades below the brightest pixel, which is white.
    """
    ending = path.suffix.lower()
    if ending == ".png":
        share = np.clip(psf / max(float(psf.max()), np.finfo(np.float64).tiny), 1e-5, 1)
        grey = (255 * (1 + np.log10(share) / 5)).round().astype(np.uint8)
        write_atomically(path, mark_drawing(encode_image(path, grey)))
        return
    write_atomically(path, encode_image(path, psf.astype(np.float32) if ending == ".tiff" else psf))
