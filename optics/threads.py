"""How torch may compute: with how many threads, and in no less than single precision."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import torch

P = ParamSpec("P")
R = TypeVar("R")


def single_threaded(function: Callable[P, R]) -> Callable[P, R]:
    """Let an iteration of many small tensor operations run on one thread.

    torch's threads meet at the end of every operation, and spin while they wait: with
    another busy process beside them, two threads were measured to be three to forty
    times slower than one.
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
    """Keep mixed precision out: under autocast torch would multiply in half precision, and
    three digits are no optics."""

    @functools.wraps(function)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> R:
        with torch.autocast("cpu", enabled=False), torch.autocast("cuda", enabled=False):
            return function(*args, **kwargs)

    return wrapper
