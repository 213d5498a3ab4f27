"""The methods that a person can name; another one joins by a line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from labapp.errors import UserError
from labapp.networks import packaged_denoiser
from optics.accuracy import MachineSpeed
from optics.deconvolution import choice
from optics.deconvolution.blurred import Blurred
from optics.deconvolution.restored import Restored
from optics.progress import Progress

AUTO = "auto"


@dataclass(frozen=True)
class Wish:
    """How a picture shall be restored.

    method: a name of METHODS, or AUTO. budget: seconds of processor time for the whole picture.
    weight: of what is known of pictures beforehand, in the method's own unit; chosen from the
    picture if None. speed: of the machine, by which times are predicted. UserError for what
    doesn't go together.
    """

    method: str = AUTO
    budget: float | None = None
    weight: float | None = None
    speed: MachineSpeed = field(default_factory=MachineSpeed)

    def __post_init__(self) -> None:
        if self.method != AUTO and self.method not in METHODS:
            raise UserError(f"--method {self.method}: is unknown. Take one of {listed()}.")
        if self.budget is not None and not 0 < self.budget < float("inf"):
            raise UserError(f"--budget {self.budget:g}: give seconds, more than 0.")
        if self.weight is not None and not 0 < self.weight < float("inf"):
            raise UserError(f"--weight {self.weight:g}: give a number above 0.")
        if self.method == AUTO and self.weight is not None:
            raise UserError(
                f"--weight {self.weight:g}: means something else to each method. Name one as "
                "well: --method tv, for example."
            )

    def restore(self, seen: Blurred, share: float, progress: Progress) -> Restored:
        """One band; share: of the budget, that it may take. ValueError where nothing fits."""
        mine = Wish(self.method, None, self.weight, self.speed)
        if self.budget is not None:
            mine = Wish(self.method, self.budget * share, self.weight, self.speed)
        return METHODS[self.method](seen, mine, progress)


Restore = Callable[[Blurred, Wish, Progress], Restored]


def _by_choice(name: str | None, seen: Blurred, wish: Wish, progress: Progress) -> Restored:
    learned = name is None or choice.METHODS[name].learned
    return choice.restore(
        seen,
        wish.budget,
        name,
        progress,
        weight=wish.weight,
        denoise=packaged_denoiser() if learned else None,
        speed=wish.speed,
    )


METHODS: dict[str, Restore] = {
    AUTO: partial(_by_choice, None),
    **{name: partial(_by_choice, name) for name in choice.METHODS},
    "tv": partial(_by_choice, "total-variation"),
}


def listed() -> str:
    """The methods' names, for a person."""
    return ", ".join(METHODS)
