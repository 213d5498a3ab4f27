"""What a result cost and how far it can be trusted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

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

    def with_cpu_spent(self, cpu_seconds: float) -> Account:
        return replace(self, cpu_spent=cpu_seconds)


@dataclass(frozen=True)
class Result(Generic[T]):
    """A value and its account."""

    value: T
    account: Account


def account_as_dict(account: Account) -> dict[str, Any]:
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
