"""Choose the method with the largest gain in a given time, and run it."""

from __future__ import annotations

from importlib import import_module

from optics.accuracy import IterationOption, MachineSpeed, best_within, select_methods
from optics.inverse.method import Denoise, RestorationCase, RestorationMethod, predicted_gain
from optics.inverse.method_names import RESTORATIONS
from optics.inverse.observation import Observation
from optics.inverse.observation_builder import without_variance
from optics.inverse.restored_image import RestoredImage
from optics.progress import Progress
from optics.validation import require_count, require_positive

DEFAULT_METHOD = "total-variation"
"""Name of the method that runs unless another is asked for."""

# `python -m figures.fit_gains` fits the gains of the methods, on photographs that `make figures
# ONLY=budget`, which checks the choice, doesn't see.
METHODS: dict[str, RestorationMethod] = {
    name: import_module(one.module).METHOD for name, one in RESTORATIONS.items()
}


def restore(
    observation: Observation,
    budget: float | None = None,
    method: str | None = None,
    progress: Progress | None = None,
    *,
    weight: float | None = None,
    count: int | None = None,
    denoise: Denoise | None = None,
    speed: MachineSpeed | None = None,
) -> RestoredImage:
    """Undo a photograph's known blur by the best method that the time allows.

    Parameters
    ----------
    observation : Observation
        Photograph and PSF: see `build_observation`.
    budget : float, optional
        Seconds of processor time, as predicted for the machine's speed: the method does as many
        iterations as there is time for. Without it, it does its default number.
    method : str, optional
        Name of a method, one of `optics.inverse.choice.METHODS`. Without it and without a budget,
        the method is total variation.
    progress : Progress, optional
        Receives reports, and can cancel the work.
    weight : float, optional
        Regularisation weight of the method's prior; the method chooses it if None. Needs `method`.
    count : int, optional
        Number of iterations or rounds, 1 or more. Needs `method`, and excludes `budget`.
    denoise : callable, optional
        Denoiser for plug-and-play, which isn't considered without one: see
        `optics.inverse.method.Denoise`.
    speed : MachineSpeed, optional
        Speed of the machine, by which times are predicted.

    Returns
    -------
    RestoredImage
        The picture in the photograph's frame, with method, residual and weight, as arrays of the
        photograph's kind.

    Raises
    ------
    ValueError
        If no method fits in the budget, if there is no such method, if `count` is below 1, if
        arguments exclude each other, or if the method raises it.
    """
    speed, progress = speed or MachineSpeed(), progress or Progress()
    if budget is not None:
        require_positive("budget", budget, "s")
    select_methods(METHODS, method)
    if method is None and not weight is count is None:
        raise ValueError("weight and count are a method's; name the method as well")
    if budget is not None and count is not None:
        raise ValueError("budget and count are both given; give one of them")
    if count is not None:
        require_count("count", count)
    if budget is not None:
        name, number = choose_method(observation, budget, method, denoise=denoise, speed=speed)
    else:
        name = method or DEFAULT_METHOD
        number = METHODS[name].default_iterations(observation) if count is None else count
    chosen = METHODS[name]
    if not chosen.takes_variance:
        observation = without_variance(observation)
    if not chosen.restores_bands and observation.relative_filters is not None:
        able = [one for one, method in METHODS.items() if method.restores_bands]
        raise ValueError(
            f"method is {name}, which knows no colour filters; take {' or '.join(able)}"
        )
    progress.report(0, chosen.description)
    own = {"denoise": denoise} if chosen.needs_denoiser else {}
    restored = chosen.solve(observation, weight, iterations=number, progress=progress, **own)
    progress.report(1, restored.method)
    return restored.to_numpy() if observation.is_numpy else restored


def choose_method(
    observation: Observation,
    budget: float,
    method: str | None = None,
    *,
    denoise: Denoise | None = None,
    speed: MachineSpeed | None = None,
) -> tuple[str, int]:
    """Return the method with the largest predicted gain in a budget, and its number of iterations.

    Raises ValueError if no method fits in the budget.

    budget: processor time, seconds.
    method: name of the only method that is considered.
    denoise: methods that need a denoiser aren't considered without it, unless named.
    """
    speed, case = speed or MachineSpeed(), RestorationCase.of(observation)
    best = best_within(
        budget,
        [
            IterationOption(
                name,
                number,
                METHODS[name].seconds(observation, number, speed),
                predicted_gain(gain, case),
            )
            for name in select_methods(METHODS, method)
            if method or METHODS[name].restores_bands or observation.relative_filters is None
            if method or denoise is not None or not METHODS[name].needs_denoiser
            for number, gain in METHODS[name].gains.items()
        ],
    )
    return best.method, best.count
