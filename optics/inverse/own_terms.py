"""Solve in terms of the photograph itself: in its unit, and with a centred PSF.

The unit of the light and the place of the PSF's origin are conventions, on which no restored detail
may depend. Methods are therefore decorated by `in_own_unit`.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ParamSpec

import torch

from optics.inverse.observation import Observation
from optics.inverse.psf_origin import shifted_window
from optics.inverse.restored_image import RestoredImage

Given = ParamSpec("Given")

Power = float | Callable[[dict[str, Any]], float]
"""Power of the unit of light in an argument's unit: a number, or one that other arguments give."""


def in_own_unit(
    *, bounds: tuple[str, ...] = (), centred: bool = False, **powers: Power
) -> Callable[[Callable[Given, RestoredImage]], Callable[Given, RestoredImage]]:
    """Decorate a method to work in the photograph's own unit: see `Observation.in_own_unit`.

    A function's arguments and results are light, where the power is 1.

    bounds: names of arguments that are light and may be negative; other negative numbers are left
        for the method to refuse.
    centred: whether a PSF whose light is off its origin only moves the picture. The method gets a
        PSF with its light about the origin, so that the picture from which iterations start, and
        what is beyond the frame, fit the photograph. A map of bounds leaves all where it is.
    powers: which power of the light's unit the unit of each named argument is. That of `weight` is
        the restored image's weight as well.
    """

    def decorate(solve: Callable[Given, RestoredImage]) -> Callable[Given, RestoredImage]:
        signature = inspect.signature(solve)

        @functools.wraps(solve)
        def wrapper(*args: Given.args, **kwargs: Given.kwargs) -> RestoredImage:
            bound = signature.bind(*args, **kwargs)
            bound.apply_defaults()
            given = bound.arguments
            seen: Observation = given["observation"]
            if seen.records_derivatives:
                # What the observation has computed before may lack its derivatives.
                seen = replace(seen)
            unit, units = seen.unit, dict.fromkeys(bounds, seen.unit)
            for name, power in powers.items():
                units[name] = unit ** (power(given) if callable(power) else power)
            if unit != 1:
                seen = seen.in_own_unit
                for name, one in units.items():
                    refused = isinstance(given[name], (int, float)) and not given[name] > 0
                    if name in bounds or not refused:
                        given[name] = _over_unit(given[name], one)
            maps = any(torch.as_tensor(given[name]).ndim for name in bounds)
            own = seen.with_centred_psf() if centred and not maps else seen
            given["observation"] = own
            found = solve(*bound.args, **bound.kwargs)
            if own.offset != seen.offset:
                whole = shifted_window(
                    found.period_image, own.offset, seen.period_shape, seen.border == "periodic"
                )
                found = replace(found, period_image=whole)
            return found if unit == 1 else _in_given_unit(found, unit, units.get("weight", 1.0))

        return wrapper

    return decorate


def _over_unit(value: Any, unit: float) -> Any:
    """Return a value, or a function of light, in the photograph's own unit."""
    if value is None:
        return None
    if callable(value):
        return lambda light, *others: value(light * unit, *others) / unit
    return value / unit


def _in_given_unit(found: RestoredImage, unit: float, weight_unit: float) -> RestoredImage:
    """Return a restored image in the unit of its photograph.

    Raises ValueError if its light is larger than the largest number.
    """
    image, whole = found.image * unit, found.period_image
    if unit > 1 and not bool(torch.isfinite(torch.as_tensor(image).detach()).all()):
        most = torch.finfo(image.dtype).max
        raise ValueError(
            f"image restores to light above {most:.3g}, the largest number of its precision; "
            "divide the photograph by 1000, and what has its unit"
        )
    return replace(
        found,
        image=image,
        noise=found.noise * unit,
        weight=None if found.weight is None else found.weight * weight_unit,
        period_image=None if whole is None else whole * unit,
    )
