"""Compute one PSF, whose plan is kept for the next one like it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from functools import partial
from typing import Any

import torch

from optics.accuracy import Result
from optics.caching import ByteCache
from optics.camera import Camera, Lens
from optics.plane import Plane
from optics.psf.operator import PSFOperator
from optics.pupil import Scalar


def psf(
    optics: Camera | Lens,
    phase: torch.Tensor | None = None,
    *,
    distance: Scalar,
    wavelength: Scalar,
    pixels: Plane,
    field: tuple[Scalar, Scalar] = (0.0, 0.0),
    sphere: bool = False,
    tol: float = 1e-3,
) -> Result[torch.Tensor]:
    """Compute the PSF on sensor pixels, with its account.

    It plans a PSFOperator and calls it once. See PSFOperator for the model. The plans of the last
    calls are kept for the same question, as long as none of its lengths is a tensor.

    Parameters
    ----------
    optics : Camera or Lens
        What forms the image.
    phase : torch.Tensor or numpy.ndarray, optional
        Radians, (..., rows, columns) of the panel. Zero by default. A lens alone takes none,
        because only a PSFOperator tells on which points.
    distance : float or 0-d torch.Tensor
        Metres from the object to the panel, or to a lens that stands alone; ``math.inf`` is
        allowed.
    wavelength : float or 0-d torch.Tensor
        Metres.
    pixels : Plane
        The sensor pixels whose light is computed.
    field : tuple of float or 0-d torch.Tensor, optional
        Metres (y, x) on the sensor from the axis to the point's geometric image.
    sphere : bool, optional
        Whether the wave over the panel is the exact spherical wave instead of its parabola.
    tol : float, optional
        Largest relative L2 error from sampling and arithmetic; 1e-3 by default.

    Returns
    -------
    Result of torch.Tensor
        The PSF, ``(..., *pixels.shape)``, as shares of the light leaving the pupil, and its
        account, with the processor time spent.

    Raises
    ------
    ToleranceError
        If `tol` can't be kept.
    ValueError
        For invalid arguments.
    """
    if phase is not None and not isinstance(optics, Camera):
        raise ValueError(
            "phase is given, and a lens alone has no panel; plan a PSFOperator, and give it the "
            "phase on its points"
        )
    started = time.process_time()
    plan = partial(
        PSFOperator,
        optics,
        distance,
        wavelength,
        pixels,
        field=field,
        sphere=sphere,
        tol=tol,
        calls=1,
    )
    operator, is_kept = _kept_plan(plan, (optics, distance, wavelength, pixels, field, sphere, tol))
    value = operator(phase)
    account = operator.account
    if is_kept:
        account = replace(account, planning_predicted=0.0)
    return Result(value, account.with_cpu_spent(time.process_time() - started))


_PLANS = ByteCache(256 << 20)
"""Plans of PSFs for psf(). Every thread has its own, since a call changes an operator's account."""


def _kept_plan(plan: Callable[[], PSFOperator], asked: tuple[Any, ...]) -> tuple[PSFOperator, bool]:
    """Return the plan of a PSF, made or kept from an earlier call, and whether it was kept.

    plan: makes it. asked: optics, distance, wavelength, pixels and settings. A question that holds
    tensors isn't kept, since they may change, nor one that is refused.
    """
    optics, *rest = asked
    if isinstance(optics, Camera):
        panel = optics.panel
        optics = (optics.lens, optics.separation, panel.plane, panel.fill_factor, panel.unmodulated)
    question = (threading.get_ident(), optics, *rest)
    if not _is_fixed(question):
        return plan(), False
    made: list[PSFOperator] = []

    def make() -> PSFOperator:
        made.append(plan())
        return made[0]

    return _PLANS.get(question, make), not made


def _is_fixed(value: Any) -> bool:
    """Tell whether a question for a PSF holds only numbers, names and tuples, which are fixed."""
    if isinstance(value, tuple):
        return all(map(_is_fixed, value))
    if is_dataclass(value):
        return all(_is_fixed(getattr(value, one.name)) for one in fields(value))
    return value is None or isinstance(value, (int, float, str))
