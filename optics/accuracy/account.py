"""State what a result cost and how accurate it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

T = TypeVar("T")

FLOAT32_ARITHMETIC = 2e-6
"""Relative L2 error of an intensity from complex64 transforms whose phases are prepared in
float64; measured against complex128, with a margin of two."""

FLOAT64_ARITHMETIC = 1e-12
"""Relative L2 error of an intensity from transforms in double precision; chosen."""


@dataclass(frozen=True)
class ErrorEstimate:
    """State a relative L2 error and how it is known.

    Parameters
    ----------
    value : float
        The relative L2 error.
    how : str
        How it is known: "bound", "estimate" or "measured", with further words where they help.
    """

    value: float
    how: str


@dataclass(frozen=True)
class Account:
    """State what one result costs and how accurate it is.

    Only the errors from sampling and arithmetic are bounded by `tol`; the error of the model is
    stated beside them.

    Parameters
    ----------
    method : str
        How the result is computed.
    sampling : str
        The grid, in words.
    precision : str
        The dtype.
    tol : float
        The relative L2 error that was allowed.
    model : ErrorEstimate
        Relative L2 error of the physical model.
    sampling_error : ErrorEstimate
        Relative L2 error from sampling.
    arithmetic : ErrorEstimate
        Relative L2 error from rounding.
    cpu_predicted : float
        Predicted processor time of a call in seconds.
    bytes : int
        Size of the largest arrays.
    cpu_spent : float, optional
        Processor time that was spent, in seconds; None until it is known.
    planning_predicted : float, optional
        Predicted processor time of planning in seconds, which all calls share.
    gradient_error : ErrorEstimate, optional
        Relative L2 error of derivatives in lengths; None where none are wanted.
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
    planning_predicted: float = 0.0
    gradient_error: ErrorEstimate | None = None

    @property
    def first_answer_predicted(self) -> float:
        """The processor time until the first result, in seconds: planning and one call."""
        return self.planning_predicted + self.cpu_predicted

    @property
    def error(self) -> float:
        """The relative L2 error, predicted from sampling and arithmetic."""
        return self.sampling_error.value + self.arithmetic.value

    def with_cpu_spent(self, cpu_seconds: float) -> Account:
        """Return a copy with the processor time spent, in seconds."""
        return replace(self, cpu_spent=cpu_seconds)


@dataclass(frozen=True)
class Result(Generic[T]):
    """Pair a computed value with its account.

    Parameters
    ----------
    value : Any
        The computed value, usually a tensor.
    account : Account
        The cost and the accuracy of the value.
    """

    value: T
    account: Account


def account_as_dict(account: Account) -> dict[str, Any]:
    """Convert an account to plain data, for tables and files.

    Parameters
    ----------
    account : Account
        The account.

    Returns
    -------
    dict
        Strings and numbers. Each error estimate becomes two entries, its value and how it is known;
        times are in seconds.
    """
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
        "error_gradient": account.gradient_error.value if account.gradient_error else None,
        "planning_predicted_s": account.planning_predicted,
        "cpu_predicted_s": account.cpu_predicted,
        "cpu_s": account.cpu_spent,
        "bytes": account.bytes,
    }
