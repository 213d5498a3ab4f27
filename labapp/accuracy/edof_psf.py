"""Error and time of PSFs with gradients, which a design computes at each step."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.accuracy.edof_case import EdofCase
from labapp.accuracy.measuring_loop import measure_rows, time_answers
from labapp.accuracy.references.panel_matrices import PanelMatrices
from labapp.accuracy.row_output import Columns, format_number
from labapp.accuracy.work_precision import (
    CALLS,
    ENDLESS,
    Deadline,
    Row,
    relative_error,
    similar_wavelength,
)
from labapp.common.errors import UserError
from optics.accuracy import Budget
from optics.camera import Camera
from optics.progress import Progress
from optics.psf import PSFOperator
from optics.psf.chain_collapsed import collapse_to_thin_camera
from optics.psf.symmetry import expand_phase
from optics.quarter_symmetry import crop_quarter, mirror_quarter, quarter_shape

Array = NDArray[np.float64]

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
"""Relative L2 errors that are asked for."""

_METHODS: tuple[tuple[str, str | None], ...] = (
    ("none", "matrix DFT with curved pixels"),
    ("none", "gridded FFT"),
    ("none", "interpolated FFT with curved pixels"),
    ("quarter", None),
    ("separable", None),
)
"""Symmetries of the pattern that a method is told, and the methods' names in the engine."""

_WORDS = {
    "matrix DFT with curved pixels": "matrices",
    "gridded FFT": "gridded FFT",
    "interpolated FFT with curved pixels": "interpolated FFT",
    "quarter": "quarter, cosine transforms",
    "separable": "separable, 1-D transforms",
}

_SHORT_S = 0.4
"""Processor seconds below which a PSF or its gradient is timed several times; chosen."""

_SEED = 3
"""Seed of the pattern, and of the weights of the loss whose gradient is computed."""

ERROR_NAME = "error of the PSF, relative L2"


@dataclass(frozen=True)
class GradientRow(Row):
    """Measured error and time of a PSF with its gradient, by a method at a tolerance.

    gradient_error: relative L2 error of the gradient of a weighted sum of the PSF.
    cpu_s, forward_s: processor seconds of a PSF and its gradient together, and of a PSF alone.
    """

    gradient_error: float | None = None
    forward_s: float | None = None


COLUMNS: Columns[GradientRow] = {
    "PSF": lambda row: row.method,
    "asked ": lambda row: format_number(row.tol, ".0e"),
    "achieved ": lambda row: "failed" if row.failure else format_number(row.error_achieved, ".0e"),
    "gradient's ": lambda row: format_number(row.gradient_error, ".0e"),
    "first ms ": lambda row: format_number(row.first_answer_s, ".1f", 1e3),
    "forward ms ": lambda row: format_number(row.forward_s, ".2f", 1e3),
    "with gradient ms ": lambda row: format_number(row.cpu_s, ".2f", 1e3),
    "": lambda row: ", ".join(
        filter(None, ("front" * row.on_front, "chosen" * bool(row.chosen_for)))
    ),
}

REMARK = (
    "Relative L2 errors of the PSF and of a gradient against sums in double precision over the "
    "panel's pixels. All methods get the same pattern, which is mirrored and separable; the last "
    "two serve such patterns alone. first: planning and one PSF. chosen: by the automatic choice "
    "for all patterns. One thread."
)


def measure_gradients(
    case: EdofCase, budget: Budget, progress: Progress, deadline: Deadline = ENDLESS
) -> list[GradientRow]:
    """Measure error and time of a PSF with its gradient, by each method at each tolerance.

    The object is at the nearest distance. Raises UserError if the camera's lens isn't one that all
    these methods serve.
    """
    progress.report(0.0, "the sum over the panel's pixels")
    exact = _ExactPSF(case, budget)
    for symmetry, method in _METHODS:
        # What is loaded at first is in no row's time, and nothing that is kept serves a row.
        with suppress(ValueError, MemoryError):
            similar = similar_wavelength(case.wavelength)
            exact.plan(symmetry, method, TOLERANCES[0], similar)(exact.short_phase(symmetry))
    empty = GradientRow("edof-psf", case.camera_name, "", "float32", None)
    cases = [
        (replace(empty, method=_WORDS[method or symmetry], tol=tol), (tol, symmetry, method))
        for tol, (symmetry, method) in product(TOLERANCES, _METHODS)
    ]
    return measure_rows(
        cases,
        partial(_measure, exact),
        lambda row: f"{row.method}, tol {row.tol:g}",
        progress.part(1 / (len(cases) + 1), 1.0),
        deadline,
        refusals=(ValueError, MemoryError),
    )


class _ExactPSF:
    """A pattern, its exact PSF, and an exact gradient, with what plans the methods' PSFs."""

    def __init__(self, case: EdofCase, budget: Budget) -> None:
        self._case, self._budget = case, budget
        try:
            self.camera: Camera = collapse_to_thin_camera(case.camera, case.nearest_distance)
        except ValueError as error:
            raise UserError(f"PSFs aren't measured for this camera: {error}.") from error
        chance = torch.Generator().manual_seed(_SEED)
        self._shape = self.camera.panel.shape
        self.phase = _draw_pattern(self._shape, chance)
        self.weights = torch.rand(case.pixels.shape, generator=chance, dtype=torch.float64)
        reference = PanelMatrices(self.camera, case.nearest_distance, case.wavelength, case.pixels)
        self.light = reference.light(self.phase.numpy())
        self._gradient = torch.from_numpy(
            reference.gradient(self.phase.numpy(), self.weights.numpy())
        )

    def plan(
        self, symmetry: str, method: str | None, tol: float, wavelength: float | None = None
    ) -> PSFOperator:
        """Plan a method's PSF; without a method, that of the automatic choice."""
        case = self._case
        return PSFOperator(
            self.camera,
            case.nearest_distance,
            wavelength or case.wavelength,
            case.pixels,
            integrate=False,
            unmodulated=0.0,
            symmetry=symmetry,
            tol=tol,
            method=method,
            budget=self._budget,
        )

    def short_phase(self, symmetry: str) -> torch.Tensor:
        """Return the pattern as a method takes it that knows its symmetry."""
        if symmetry == "quarter":
            return crop_quarter(self.phase)
        if symmetry == "separable":
            # The phase is a sum; the first row holds that of the columns up to a constant.
            return torch.cat([self.phase[:, 0] - self.phase[0, 0], self.phase[0]])
        return self.phase

    def gradient(self, symmetry: str) -> Array:
        """Return the exact gradient in what `short_phase` gives: sums over what it stands for."""
        leaf = self.short_phase(symmetry).clone().requires_grad_()
        whole = expand_phase(symmetry, leaf, self._shape)
        (found,) = torch.autograd.grad(whole, leaf, self._gradient)
        return np.asarray(found.numpy())


def _draw_pattern(shape: tuple[int, int], chance: torch.Generator) -> torch.Tensor:
    """Draw a random phase that is mirrored and a sum along y and x, radians."""
    rows, columns = quarter_shape(shape)
    y, x = (torch.rand(n, generator=chance, dtype=torch.float64) for n in (rows, columns))
    return mirror_quarter(2 * np.pi * (y[:, None] + x), shape)


def _measure(
    exact: _ExactPSF, row: GradientRow, way: tuple[float, str, str | None], _: Progress
) -> GradientRow:
    """Measure error and time of one method's PSF and gradient, and mark the automatic choice.

    It is that for patterns of all kinds at this tolerance.
    """
    tol, symmetry, method = way
    phase = exact.short_phase(symmetry)
    began, wall = time.process_time(), time.perf_counter()
    operator = exact.plan(symmetry, method, tol)
    light = operator(phase)
    first = time.process_time() - began
    weights = exact.weights.to(light)

    def differentiate() -> Any:
        leaf = phase.clone().requires_grad_()
        return torch.autograd.grad((operator(leaf) * weights).sum(), leaf)[0]

    gradient = differentiate().numpy()
    forward_s = time_answers(lambda: operator(phase), _SHORT_S)[1]
    cpu_s = time_answers(differentiate, _SHORT_S)[1]
    wall, account = time.perf_counter() - wall, operator.account
    try:
        is_chosen = exact.plan("none", None, tol).account.method == account.method
    except (ValueError, MemoryError):
        is_chosen = False
    return replace(
        row,
        precision=account.precision,
        error_achieved=relative_error(light.numpy(), exact.light),
        error_predicted=account.error,
        gradient_error=relative_error(gradient, exact.gradient(symmetry)),
        forward_s=forward_s,
        cpu_s=cpu_s,
        wall_s=wall,
        first_answer_s=first,
        peak_bytes=account.bytes,
        engine=account.method,
        chosen_for=CALLS[-1:] if is_chosen else (),
    )
