"""Give the phase of a symmetric pattern in short, and expand it to the panel."""

from __future__ import annotations

from collections.abc import Callable

import torch

from optics.camera import Camera
from optics.chain import chain_engines
from optics.psf_engines.engine import PSFEngine
from optics.psf_engines.panel_engine import PanelEngine
from optics.psf_engines.request import PSFRequest
from optics.psf_engines.separable_engine import SeparableEngine
from optics.pupil import pupil_amplitude
from optics.quarter_symmetry import mirror_quarter, quarter_shape

SYMMETRIES = ("none", "quarter", "separable")
"""Names of the symmetries of a pattern."""


def symmetric_shape(symmetry: str, shape: tuple[int, int]) -> tuple[int, ...]:
    """Return the shape in which a symmetric pattern of a panel is given.

    Parameters
    ----------
    symmetry : str
        One of SYMMETRIES. "none": every pixel is given. "quarter": the pattern is mirrored in the
        middle of the panel's pixels, along both axes; given is its quarter right of and below it,
        with the middle row and column where their number is odd. "separable": the phase is the sum
        of one that depends on y and one on x; given are the phases of all rows, then of all
        columns.
    shape : tuple of int
        Rows and columns of the panel.

    Returns
    -------
    tuple of int
        The shape.

    Raises
    ------
    ValueError
        For another symmetry.
    """
    rows, columns = shape
    if symmetry == "quarter":
        return quarter_shape(shape)
    if symmetry == "separable":
        return (rows + columns,)
    if symmetry != "none":
        raise ValueError(f"symmetry is {symmetry!r}; choose {', '.join(SYMMETRIES)}")
    return shape


def expand_phase(symmetry: str, phase: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """Expand the phase of a symmetric pattern to all pixels of a panel; differentiable.

    Parameters
    ----------
    symmetry : str
        One of SYMMETRIES.
    phase : torch.Tensor
        Radians, ``(..., *symmetric_shape(symmetry, shape))``.
    shape : tuple of int
        Rows and columns of the panel.

    Returns
    -------
    torch.Tensor
        Radians, ``(..., *shape)``; float64 for a separable pattern.

    Raises
    ------
    ValueError
        For another symmetry, or a phase of another shape.
    """
    given = symmetric_shape(symmetry, shape)
    if tuple(phase.shape[-len(given) :]) != given:
        raise ValueError(
            f"phase is {tuple(phase.shape)}; with symmetry {symmetry!r} it is {given} for a panel "
            f"of {shape[1]}x{shape[0]} pixels"
        )
    if symmetry == "quarter":
        return mirror_quarter(phase, shape)
    if symmetry == "separable":
        # Single precision doesn't hold the sum of thousands of waves.
        y, x = torch.split(phase.to(torch.float64), list(shape), dim=-1)
        return y[..., :, None] + x[..., None, :]
    return phase


def symmetric_engine(
    symmetry: str, request: PSFRequest, camera: Camera
) -> Callable[[], PSFEngine] | None:
    """Return a function that makes the engine for a symmetric pattern's PSF, or None without one.

    The lens' wave must be quadratic and the stop must not cut the panel; otherwise the light behind
    a symmetric pattern isn't symmetric. A panel apart from its lens must be so open that the lens
    may as well stand at it. The function raises ToleranceError where it isn't.
    """
    if (
        symmetry == "none"
        or request.sphere is not None
        or request.differentiable
        or not camera.lens.has_quadratic_phase
    ):
        return None
    if camera.separation:
        if symmetry == "separable":
            return None
        collapsed = chain_engines(request, camera, "collapsed", mirrored=True)
        return collapsed["collapsed"]
    if float(pupil_amplitude(camera).min()) < 1:
        return None
    if symmetry == "separable":
        return lambda: SeparableEngine(request, camera)
    return lambda: PanelEngine(request, camera, mirrored=True)
