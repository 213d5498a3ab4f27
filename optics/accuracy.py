"""What a result cost and how far it can be trusted; the choice of the cheapest method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Protocol, TypeVar

from optics.edge import rounded_up

T = TypeVar("T")

FLOAT32_ARITHMETIC = 2e-6
"""Relative L2 error of an intensity from complex64 transforms whose phases were
prepared in float64; measured against complex128, with a margin of two."""

FLOAT64_ARITHMETIC = 1e-12


@dataclass(frozen=True)
class ErrorEstimate:
    """A relative L2 error and how it is known: "bound", "estimate", "measured"."""

    value: float
    how: str


@dataclass(frozen=True)
class Account:
    """The price and the promise of one result.

    method: how it was computed. sampling: the grid, in words. precision: dtype.
    model, sampling_error, arithmetic: relative L2 errors. Only the last two are
    bounded by `tol`; the error of the model stands beside them.
    cpu_predicted, cpu_spent: seconds of processor time. bytes: largest arrays.
    """

    method: str
    sampling: str
    precision: str
    tol: float
    model: ErrorEstimate
    sampling_error: ErrorEstimate
    arithmetic: ErrorEstimate
    cpu_predicted: float
    bytes: int
    cpu_spent: float | None = None

    @property
    def error(self) -> float:
        """Predicted relative L2 error from sampling and arithmetic."""
        return self.sampling_error.value + self.arithmetic.value

    def spent(self, cpu_seconds: float) -> Account:
        return replace(self, cpu_spent=cpu_seconds)


@dataclass(frozen=True)
class Result(Generic[T]):
    """A value and its account."""

    value: T
    account: Account


class ToleranceError(ValueError):
    """Nothing at hand keeps the promise; the message names the floor and the remedy.

    floor: the tolerance that would do, where the refusal is one of tolerance alone.
    """

    floor: float | None = None


def unkeepable(tol: float, floor: float) -> ToleranceError:
    """The refusal of a tolerance below a floor, with the one that would do."""
    if not floor < 1:
        return ToleranceError(
            f"tol {tol:g} can't be kept: hardly any light reaches the window; ask for a larger "
            "one, or one that is nearer to the light"
        )
    refusal = ToleranceError(f"tol {tol:g} can't be kept; ask for tol {rounded_up(floor)} or more")
    refusal.floor = floor
    return refusal


@dataclass(frozen=True)
class MachineSpeed:
    """Seconds per operation on the machine at hand, one thread, float32.

    call: of any function called, whatever its size. multiply_add: in a product of matrices.
    fft: a floating-point operation of one. touch: a complex number passed once; fresh: a byte
    taken beyond what caches and allocators keep. gridding: a sample spread to one point of a
    regular grid, row by row; spread: a scattered one, and point: what it costs besides.
    stream: a matrix' element used once. gather: a value fetched from a place of its own. tap:
    a fine sample's part in a whole pixel. double: how much longer double precision takes.

    The defaults come from a 2-core server; who knows better passes its own.
    """

    call: float = 5e-4
    multiply_add: float = 2e-11
    fft: float = 7.3e-11
    touch: float = 2e-10
    fresh: float = 2.5e-10
    gridding: float = 3.4e-10
    spread: float = 5e-10
    point: float = 2.1e-8
    stream: float = 1.6e-9
    gather: float = 1.1e-8
    tap: float = 3.8e-10
    double: float = 2.0


class Method(Protocol):
    """A way to compute a transform, known by its predicted cost."""

    name: str

    @property
    def bytes(self) -> int: ...

    def cpu_seconds(self, speed: MachineSpeed) -> float: ...


M = TypeVar("M", bound=Method)


@dataclass(frozen=True)
class Budget:
    """What a computation may use: memory in bytes, and the machine's speed."""

    memory: int = 4 << 30
    speed: MachineSpeed = field(default_factory=MachineSpeed)


def cheapest(methods: Sequence[M], budget: Budget, what: str) -> M:
    """The method with the least predicted processor time that fits in memory.

    Raises ToleranceError that names the memory the thriftiest method needs.
    """
    fitting = [m for m in methods if m.bytes <= budget.memory]
    if not fitting:
        least = min(m.bytes for m in methods)
        raise ToleranceError(
            f"{what} needs {least / 1e6:.0f} MB at least and {budget.memory / 1e6:.0f} MB are "
            "allowed; allow more memory, or ask for fewer samples"
        )
    return min(fitting, key=lambda m: m.cpu_seconds(budget.speed))


def describe(account: Account) -> dict[str, Any]:
    """The account as plain data, for tables and files."""
    return {
        "method": account.method,
        "sampling": account.sampling,
        "precision": account.precision,
        "tol": account.tol,
        "error_predicted": account.error,
        "error_sampling": account.sampling_error.value,
        "error_sampling_how": account.sampling_error.how,
        "error_arithmetic": account.arithmetic.value,
        "error_arithmetic_how": account.arithmetic.how,
        "error_model": account.model.value,
        "error_model_how": account.model.how,
        "cpu_predicted_s": account.cpu_predicted,
        "cpu_s": account.cpu_spent,
        "bytes": account.bytes,
    }
