"""Choose a restoration method by name, processor time and regularisation weight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from labapp.common.errors import UserError
from labapp.pictures.networks import bundled_denoiser
from optics.accuracy import MachineSpeed
from optics.inverse import choice as restoration_choice
from optics.inverse.method_names import ALIASES, AUTO, METHOD_CHOICES
from optics.inverse.observation import Observation
from optics.inverse.restored_image import RestoredImage
from optics.inverse.variance_gain import Solve
from optics.progress import Progress


@dataclass(frozen=True)
class MethodChoice:
    """The requested method and its limits; UserError for values that contradict each other.

    method: one of `METHOD_CHOICES`.
    budget: processor time for the whole picture, in seconds.
    weight: regularisation weight in the method's own unit; None to choose it from the picture.
    refine_psf: whether a PSF is scaled to the size that the picture shows.
    speed: of the machine, by which times are predicted.
    """

    method: str = AUTO
    budget: float | None = None
    weight: float | None = None
    refine_psf: bool = False
    speed: MachineSpeed = field(default_factory=MachineSpeed)

    def __post_init__(self) -> None:
        if self.method not in METHOD_CHOICES:
            raise UserError(
                f"--method {self.method}: is unknown. Take one of {', '.join(METHOD_CHOICES)}."
            )
        if self.budget is not None and not 0 < self.budget < float("inf"):
            raise UserError(f"--budget {self.budget:g}: give seconds, more than 0.")
        if self.weight is not None and not 0 < self.weight < float("inf"):
            raise UserError(f"--weight {self.weight:g}: give a number above 0.")
        if self.method == AUTO and self.weight is not None:
            raise UserError(
                f"--weight {self.weight:g}: means something else to each method. Name one as "
                "well: --method tv, for example."
            )

    def variance_solver(self, observation: Observation, share: float) -> tuple[str, Solve | None]:
        """Return the chosen method's name, and a function that restores with a variance map.

        The function is None if the method takes one noise for all pixels. `share` is the share of
        the budget that the band may take.
        """
        name = self._method_name
        count = None
        if self.budget is not None:
            denoise = bundled_denoiser() if name is None else None
            name, count = restoration_choice.choose_method(
                observation, self.budget * share, name, denoise=denoise, speed=self.speed
            )
        chosen = name or restoration_choice.DEFAULT_METHOD
        if not restoration_choice.METHODS[chosen].takes_variance:
            return chosen, None

        def solve(seen: Observation, weight: float | None) -> RestoredImage:
            used = self.weight if weight is None else weight
            return restoration_choice.restore(seen, method=chosen, count=count, weight=used)

        return chosen, solve

    @property
    def _method_name(self) -> str | None:
        """Name of the method that the user chose; None for the best one."""
        return None if self.method == AUTO else ALIASES.get(self.method, self.method)

    def restore(
        self, observation: Observation, share: float, progress: Progress, counts: Mapping[str, int]
    ) -> RestoredImage:
        """Restore one band by the chosen method; ValueError if none fits the budget or the band.

        share: share of the budget that the band may take.
        counts: planned iterations by the name of a method, used without a budget.
        """
        name = self._method_name
        learned = (
            restoration_choice.METHODS[name].needs_denoiser if name else self.budget is not None
        )
        return restoration_choice.restore(
            observation,
            None if self.budget is None else self.budget * share,
            name,
            progress,
            weight=self.weight,
            count=counts.get(name) if name and self.budget is None else None,
            denoise=bundled_denoiser() if learned else None,
            speed=self.speed,
        )
