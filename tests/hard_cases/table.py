"""The kinds of rows in the catalogue, and how each is judged."""

from __future__ import annotations

import re
import resource
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from judges import Judge, relative, richardson
from judges.view import View
from numpy.typing import NDArray

from optics.accuracy import ToleranceError

SINGLE, DOUBLE = 1e-3, 1e-8
"""Tolerances that are computed in single and in double precision."""

ONCE = (0.0,)
"""Of rows that have no tolerance."""

_FINEST_DIFFERENCE = 1e-6
"""What finite differences of a judge can tell."""


@dataclass(frozen=True)
class Case(ABC):
    """A row: what is asked, and why that is hard.

    tols: tolerances at which it is tried. bug: what the library gets wrong as yet; such a row
    is expected to fail, at the tolerances `bug_at`, or at all.
    """

    name: str
    hard_because: str
    tols: tuple[float, ...] = field(default=(SINGLE, DOUBLE), kw_only=True)
    bug: str = field(default="", kw_only=True)
    bug_at: tuple[float, ...] = field(default=(), kw_only=True)

    def fails(self, tol: float) -> bool:
        """Whether it is known to."""
        return bool(self.bug) and (not self.bug_at or tol in self.bug_at)

    @abstractmethod
    def check(self, tol: float) -> None:
        """Raise AssertionError unless the library's answer is within tol of the judge's."""

    @abstractmethod
    def asked(self) -> str:
        """The parameters, in words."""

    @abstractmethod
    def judged(self) -> str:
        """Who knows the answer, in words."""


@dataclass(frozen=True)
class Seen(Case):
    """A PSF that a slow judge computes as well; its derivative in the phase is finite."""

    view: View
    judge: Judge

    @cached_property
    def truth(self) -> NDArray[Any]:
        return self.judge(self.view)

    def check(self, tol: float) -> None:
        operator = self.view.operator(tol)
        light = self.view.light(operator)
        require_close(light, self.truth, tol)
        assert float(light.min()) >= 0
        assert operator.account.error <= tol
        phase = self.view.shown(operator)
        if phase is not None:
            require_finite_gradient(lambda p: self.view.light(operator, p), phase)

    def asked(self) -> str:
        return str(self.view)

    def judged(self) -> str:
        return in_words(self.judge)


@dataclass(frozen=True)
class Agrees(Case):
    """An answer, whatever of, that a judge knows too: relative L2 error."""

    given: str
    ask: Callable[[float], Any]
    truth: Callable[[], Any]
    judge: str

    def check(self, tol: float) -> None:
        require_close(self.ask(tol), self.truth(), tol)

    def asked(self) -> str:
        return self.given

    def judged(self) -> str:
        return self.judge


@dataclass(frozen=True)
class Slope(Case):
    """A PSF's derivative in one number, against differences of a judge's pictures.

    view_of: the view for a value of the number. at: where. unit: a change of the number that
    changes the picture a lot, by which errors are weighed where the derivative is zero.
    Derivatives are judged ten times more leniently than values.
    """

    view_of: Callable[[Any], View]
    at: float
    unit: float
    judge: Judge

    def check(self, tol: float) -> None:
        number = torch.tensor(self.at, dtype=torch.float64, requires_grad=True)
        with warnings.catch_warnings():
            # A row of its own asks for silence.
            warnings.filterwarnings("ignore", "Converting a tensor with requires_grad")
            light = self.view_of(number).light(self.view_of(number).operator(tol))
        weight = torch.cos(1 + 3 * torch.arange(light.numel(), dtype=torch.float64))
        (light.ravel() * weight).sum().backward()
        assert number.grad is not None
        assert torch.isfinite(number.grad)
        change, size = self.truth
        error = float(number.grad) - float(weight.numpy() @ change.ravel())
        allowed = max(10 * tol, _FINEST_DIFFERENCE) * size * float(weight.norm())
        assert abs(error) <= allowed

    @cached_property
    def truth(self) -> tuple[NDArray[Any], float]:
        """How the picture changes with the number, and how large a change is to be expected."""
        change = richardson(lambda x: self.judge(self.view_of(x)), self.at, self.unit / 6)
        usual = np.linalg.norm(self.judge(self.view_of(self.at))) / self.unit
        return change, float(max(np.linalg.norm(change), usual))

    def asked(self) -> str:
        return f"{self.view_of(self.at)}; derivative at {self.at:.4g}"

    def judged(self) -> str:
        return f"differences of {in_words(self.judge)}"


@dataclass(frozen=True)
class Refused(Case):
    """A question without an answer: an error in words, naming the argument and the remedy.

    words: what it must say. remedy: does what it advises, and must work; it is given the
    tolerance that the error asks for, if it asks for one.
    """

    given: str
    ask: Callable[[], Any]
    words: str
    remedy: Callable[[float], Any]
    tols: tuple[float, ...] = field(default=ONCE, kw_only=True)

    def check(self, tol: float) -> None:
        with little_memory(), pytest.raises(ValueError, match=self.words) as caught:
            self.ask()
        require_finite(self.remedy(_advised(str(caught.value), caught.type)))

    def asked(self) -> str:
        return self.given

    def judged(self) -> str:
        said = re.sub(r"\.\*|\\S\+|\\d\+", "…", self.words).replace("\\", "")
        return f"refused: “{said}”; the remedy works"


@dataclass(frozen=True)
class Holds(Case):
    """A law that the answer must obey; it is asserted by `law`, which is given the tolerance."""

    given: str
    law: Callable[[float], None]
    judge: str

    def check(self, tol: float) -> None:
        self.law(tol)

    def asked(self) -> str:
        return self.given

    def judged(self) -> str:
        return self.judge


@contextmanager
def little_memory(allowed: int = 1 << 30) -> Iterator[None]:
    """Whoever allocates more bytes meets MemoryError: a refusal has to come before that."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    most = pages * resource.getpagesize() + allowed
    resource.setrlimit(resource.RLIMIT_AS, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def in_words(function: Callable[..., Any]) -> str:
    """The first line of a docstring."""
    return (function.__doc__ or function.__name__).splitlines()[0].rstrip(".")


def _advised(message: str, kind: type[BaseException]) -> float:
    found = re.search(r"ask for tol (\S+) or more", message)
    if found is None:
        return SINGLE
    assert issubclass(kind, ToleranceError)
    return float(found[1])


def require_close(value: Any, truth: Any, tol: float) -> None:
    """Finite, of the right shape, and within a relative L2 error; exactly zero where truth is."""
    require_finite(value)
    value, truth = (np.asarray(torch.as_tensor(x).detach().resolve_conj()) for x in (value, truth))
    assert value.shape == truth.shape
    if not truth.any():
        assert not value.any()
        return
    assert relative(value, truth) <= tol


def require_finite(value: Any) -> None:
    """No NaN and no infinity, in tensors, arrays and tuples of them."""
    if isinstance(value, tuple):
        for part in value:
            require_finite(part)
    elif isinstance(value, torch.Tensor | np.ndarray | float | complex):
        assert torch.isfinite(torch.as_tensor(value)).all()


def require_finite_gradient(
    function: Callable[[torch.Tensor], torch.Tensor], at: torch.Tensor
) -> torch.Tensor:
    """The gradient of the contrast of what a function makes of a tensor, demanded finite."""
    at = at.detach().clone().to(torch.promote_types(at.dtype, torch.float32)).requires_grad_()
    (function(at).abs() ** 2).sum().backward()
    assert at.grad is not None
    assert torch.isfinite(torch.view_as_real(at.grad) if at.is_complex() else at.grad).all()
    return at.grad
