"""Limit torch's threads, and keep torch from computing in half precision."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import torch

P = ParamSpec("P")
R = TypeVar("R")


def single_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function of many small tensor operations to run on one torch thread.

    torch synchronises its threads at the end of every operation, and they spin while they wait.
    With another busy process on the machine, two threads were measured to be three to forty times
    slower than one.
    """

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        before = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            return function(*args, **kwargs)
        finally:
            torch.set_num_threads(before)

    return wrapper


def in_full_precision(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function to run without torch's mixed precision (autocast).

    Under autocast torch would multiply in half precision, whose three digits are too few here.
    """

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        with torch.autocast("cpu", enabled=False), torch.autocast("cuda", enabled=False):
            return function(*args, **kwargs)

    return wrapper
