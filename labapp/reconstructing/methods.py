"""The methods that a person can name; another one joins by a line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from labapp.errors import UserError
from optics.deconvolution.blurred import Blurred
from optics.deconvolution.choice import restore
from optics.deconvolution.restored import Restored
from optics.deconvolution.richardson_lucy import richardson_lucy
from optics.deconvolution.total_variation import total_variation
from optics.deconvolution.wiener import wiener
from optics.progress import Progress

Restore = Callable[[Blurred, float | None, Progress], Restored]
"""Of a problem, a weight by hand or None, and a progress."""

AUTO = "auto"


@dataclass(frozen=True)
class Wish:
    """How a picture shall be restored.

    method: a name of METHODS, or AUTO. budget: seconds of processor time for the whole picture, by
    which AUTO chooses. weight: of what is known of pictures beforehand, in the method's own unit;
    chosen from the picture if None. UserError for what doesn't go together.
    """

    method: str = AUTO
    budget: float | None = None
    weight: float | None = None

    def __post_init__(self) -> None:
        if self.method != AUTO and self.method not in METHODS:
            known = ", ".join((AUTO, *METHODS))
            raise UserError(f"--method {self.method}: is unknown. Take one of {known}.")
        if self.budget is not None and not 0 < self.budget < float("inf"):
            raise UserError(f"--budget {self.budget:g}: give seconds, more than 0.")
        if self.weight is not None and not 0 < self.weight < float("inf"):
            raise UserError(f"--weight {self.weight:g}: give a number above 0.")
        if self.method != AUTO and self.budget is not None:
            raise UserError(
                f"--budget chooses the method, and --method {self.method} has chosen it. "
                "Leave one of the two out."
            )
        if self.method == AUTO and self.weight is not None:
            raise UserError(
                f"--weight {self.weight:g}: means something else to each method. Name one as "
                "well: --method tv, for example."
            )
        if self.weight is not None and self.method in WEIGHTLESS:
            raise UserError(f"--method {self.method}: has no weight. Leave --weight out.")

    def restore(self, seen: Blurred, share: float, progress: Progress) -> Restored:
        """One band; share: of the budget, that it may take."""
        if self.method != AUTO:
            return METHODS[self.method](seen, self.weight, progress)
        return restore(seen, None if self.budget is None else self.budget * share, None, progress)


def _wiener(seen: Blurred, weight: float | None, progress: Progress) -> Restored:
    progress.report(0, "Wiener")
    return wiener(seen, weight)


def _richardson_lucy(seen: Blurred, weight: float | None, progress: Progress) -> Restored:
    return richardson_lucy(seen, 100, progress=progress)


def _gradients(**how: Any) -> Restore:
    def run(seen: Blurred, weight: float | None, progress: Progress) -> Restored:
        return total_variation(seen, weight, progress=progress, **how)

    return run


METHODS: dict[str, Restore] = {
    "wiener": _wiener,
    "richardson-lucy": _richardson_lucy,
    "tv": _gradients(),
    "hyper-laplacian": _gradients(power=0.6),
}

WEIGHTLESS = {"richardson-lucy"}
