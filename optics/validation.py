"""Check arguments of public functions, and convert between numpy arrays and torch tensors."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable
from dataclasses import fields, is_dataclass, replace
from typing import Any, cast

import numpy as np
import torch
from torch.autograd import forward_ad

from optics.quantity_ranges import RANGES, refuse_size


def _to_tensor(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.kind not in "biufc":
        raise TypeError(f"an array of {value.dtype} was given; give an array of numbers")
    if value.flags.writeable and value.dtype.isnative and min(value.strides, default=0) >= 0:
        return torch.from_numpy(value)
    # Arrays from files may be read-only, reversed or of another byte order. torch can't share the
    # memory of these, so they are copied.
    return torch.from_numpy(np.array(value, dtype=value.dtype.newbyteorder("="), order="C"))


def require_unmasked(*given: Any) -> None:
    """Raise ValueError for masked values in arrays, or in lists of them.

    numpy and torch pass over a mask without a word when they convert an array.
    """
    for value in given:
        if isinstance(value, list | tuple):
            require_unmasked(*value)
        if isinstance(value, np.ma.MaskedArray) and (
            masked := int(np.ma.getmaskarray(value).sum())
        ):
            raise ValueError(
                f"a masked array with {masked} masked values of {value.size} was given; say what "
                "stands there, with its method filled()"
            )


def split_mask(picture: Any, weights: Any) -> tuple[Any, Any]:
    """Take the mask off a photograph, and put it into the weights of its pixels.

    Weights of None are 1 at all pixels. Masked pixels have a weight of 0, as dead ones have, and
    other pictures come back as they are.
    """
    if not isinstance(picture, np.ma.MaskedArray):
        return picture, weights
    require_unmasked(weights)
    known = ~np.ma.getmaskarray(picture)
    kind = picture.dtype if picture.dtype.kind == "f" else np.dtype(np.float32)
    own = known.astype(kind) if weights is None else np.where(known, np.asarray(weights), 0)
    return picture.filled(0), weights if known.all() else own


def _to_numpy(value: Any) -> Any:
    if isinstance(value, torch.Tensor):
        return value.detach().cpu().numpy()
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return tuple(_to_numpy(item) for item in value)
    return value


def accepts_numpy(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a function of tensors to accept numpy arrays, and to return them then.

    Without any it is called unchanged, so that gradients propagate. Results are converted if they
    are tensors or tuples of tensors.
    """

    @functools.wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        given = [*args, *kwargs.values()]
        require_unmasked(*given)
        if not any(isinstance(value, np.ndarray) for value in given):
            return function(*args, **kwargs)
        named = {name: _to_tensor(value) for name, value in kwargs.items()}
        return _to_numpy(function(*map(_to_tensor, args), **named))

    return wrapper


def as_floating_point(value: torch.Tensor) -> torch.Tensor:
    """Return a tensor in single or double precision; integers and half precision become single."""
    kept = value.dtype in (torch.float32, torch.float64)
    return value if kept else value.to(torch.float32)


def as_number(value: Any) -> float:
    """Convert a number or 0-d tensor to a float without its derivative."""
    return float(value.detach() if isinstance(value, torch.Tensor) else value)


def to_plain_numbers(value: Any) -> Any:
    """Replace every 0-d tensor in a value by a float, also inside dataclasses and tuples."""
    if isinstance(value, (float, int, str)) or value is None:
        # Most values need nothing; np.float64 is a float too.
        return value
    if isinstance(value, (torch.Tensor, np.ndarray, np.floating)):
        return as_number(value)
    if isinstance(value, tuple):
        inner = tuple(map(to_plain_numbers, value))
        return value if all(a is b for a, b in zip(inner, value, strict=True)) else inner
    if not is_dataclass(value) or isinstance(value, type):
        return value
    changed = {}
    for one in fields(value):
        old = getattr(value, one.name)
        new = to_plain_numbers(old)
        if new is not old:
            changed[one.name] = new
    return replace(value, **changed) if changed else value


def needs_gradient(value: object) -> bool:
    """Tell whether a value is a tensor that requires a gradient."""
    if not isinstance(value, torch.Tensor):
        return False
    require_reverse_mode(value)
    return value.requires_grad


def records_gradient(*values: torch.Tensor) -> bool:
    """Tell whether an operation on these tensors must record derivatives."""
    for value in values:
        require_reverse_mode(value)
    return torch.is_grad_enabled() and any(value.requires_grad for value in values)


def require_reverse_mode(value: torch.Tensor) -> None:
    """Raise NotImplementedError inside torch.func's transforms and forward-mode derivatives.

    Optical operations have derivatives of their own, which these would pass by.
    """
    functorch, unpack = torch._C._functorch, cast(Any, forward_ad.unpack_dual)
    wrapped = functorch.is_functorch_wrapped_tensor(value)
    # No tensor has a tangent outside of a dual level.
    is_dual = forward_ad._current_level >= 0 and unpack(value).tangent is not None
    if is_dual or wrapped or functorch.is_legacy_batchedtensor(value):
        raise NotImplementedError(
            "optics computes no derivatives inside torch.func (vmap, grad, jvp, hessian), in "
            "forward mode or with vectorize=True; give a batch (..., rows, columns) in one call, "
            "and take torch.autograd.grad, or hessian, hvp or jvp of torch.autograd.functional"
        )


def require_unchanged_attributes(
    names: Iterable[str], at_planning: object, now: object, kind: str
) -> None:
    """Raise ValueError if attributes have changed since an operator of some kind was planned."""
    for name in names:
        was, is_ = getattr(at_planning, name), getattr(now, name)
        if was != is_:
            raise ValueError(
                f"{name} has changed since this {kind} was planned, from {was} to {is_}; plan "
                "another one for it"
            )


def require_number(name: str, value: Any, unit: str = "") -> None:
    """Raise TypeError for an argument that is neither a real number nor a 0-d tensor of one."""
    if type(value) is float:
        return
    scalar = isinstance(value, (torch.Tensor, np.ndarray)) and value.ndim == 0
    number = isinstance(value, (int, float, np.floating, np.integer)) or scalar
    if number and not isinstance(value, bool):
        return
    raise TypeError(
        f"{name} is {value!r}, a {type(value).__name__}; give one number{unit and ' in '}{unit}, "
        "or a 0-d tensor"
    )


def require_tensor(name: str, value: Any) -> None:
    """Raise TypeError for an argument that is neither a tensor nor None."""
    if value is None:
        return
    if not isinstance(value, torch.Tensor):
        raise TypeError(
            f"{name} is a {type(value).__name__}; give a torch tensor or a numpy array of numbers"
        )
    require_reverse_mode(value)


def require_tolerance(tol: Any) -> None:
    """Raise an error for a tolerance that is no number, or above 1; methods refuse small ones."""
    require_number("tol", tol)
    if as_number(tol) > 1:
        raise ValueError(
            f"tol is {as_number(tol):g}; it is a relative L2 error: give a number up to 1, for "
            "instance 1e-3"
        )


def require_positive(name: str, value: Any, unit: str) -> None:
    """Raise ValueError for a value that isn't positive and finite."""
    value = as_number(value)
    if not (value > 0 and math.isfinite(value)):
        raise ValueError(f"{name} is {value:g}{unit and ' '}{unit}; it must be positive and finite")


def require_amount(name: str, value: float, unit: str) -> None:
    """Raise ValueError for a number that is negative or infinite."""
    if not 0 <= value < math.inf:
        unit = unit and f" {unit}"
        raise ValueError(f"{name} is {value:g}{unit}; it can't be negative or infinite")


def require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Raise ValueError for a word that isn't among the choices, two or more."""
    if value not in choices:
        named = f"{', '.join(choices[:-1])} or {choices[-1]}"
        raise ValueError(f"{name} is {value!r}; choose {named}")


def require_wavelength(name: str, value: Any) -> None:
    """Raise ValueError for a value that is no wavelength of light in metres."""
    require_positive(name, value, "m")
    require_size("wavelength", name, value)


def require_size(quantity: str, name: str, value: Any) -> None:
    """Raise an error for a value that is no number in the range of its quantity, one of RANGES.

    The message asks about a number that would be usual in another unit.
    """
    require_number(name, value, RANGES[quantity].unit)
    value = as_number(value)
    if not math.isfinite(value):
        raise ValueError(f"{name} is {value:g}; it must be finite")
    if refusal := refuse_size(quantity, name, value):
        raise ValueError(refusal)


def require_count(name: str, value: int) -> None:
    """Raise ValueError for a count below 1."""
    if not value >= 1:
        raise ValueError(f"{name} is {value}; at least 1 is needed")


def require_same_shape(name: str, picture: torch.Tensor, **others: torch.Tensor | None) -> None:
    """Raise ValueError for arguments whose shape isn't that of a picture; None is allowed."""
    for other, given in others.items():
        if given is not None and given.shape != picture.shape:
            raise ValueError(
                f"{other} is {tuple(given.shape)} and {name} {tuple(picture.shape)}; they must be "
                "alike"
            )


def require_share(name: str, value: Any) -> None:
    """Raise ValueError for a value that isn't a share between 0 and 1."""
    value = as_number(value)
    if not 0 <= value <= 1:
        raise ValueError(f"{name} is {value:g}; it is a share and must lie between 0 and 1")


def rounded_up(value: float) -> str:
    """Format a positive number for "at least": three digits, rounded up."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.ceil(value / unit * (1 - 1e-12)) * unit:.3g}"


def rounded_down(value: float) -> str:
    """Format a positive number for "at most": three digits, rounded down."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.floor(value / unit * (1 + 1e-12)) * unit:.3g}"


def as_finite_array(name: str, value: Any, axes: str) -> torch.Tensor:
    """Return a finite array of any kind in double precision, or raise ValueError.

    axes: their names, as "(bands, rows, columns)".
    """
    require_unmasked(value)
    tensor = torch.as_tensor(value, dtype=torch.float64).detach()
    require_finite(name, tensor)
    if tensor.ndim != axes.count(",") + 1 or not tensor.numel():
        raise ValueError(f"{name} is {tuple(tensor.shape)}; give {axes}")
    return tensor


def require_finite(name: str, value: torch.Tensor) -> None:
    """Raise ValueError for NaN or infinite entries, with their count."""
    # A sum is quick to compute, and it isn't finite if any entry is NaN or infinite.
    if bool(torch.isfinite(value.detach().sum())):
        return
    bad = int((~torch.isfinite(value)).sum())
    if bad:
        raise ValueError(
            f"{name} has {bad} NaN or infinite values of {value.numel()}; give finite numbers"
        )
