"""Which ways serve a question about a PSF, and which of them is the cheapest."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from optics.accuracy import Choice, ToleranceError, named, unkeepable
from optics.camera import Camera
from optics.chain import CHAIN_METHODS, chain_engines
from optics.edge import rounded_up
from optics.point.engine import Engine
from optics.point.panel import TRANSFORMS, PanelEngine
from optics.point.question import Question
from optics.psf.axial import AxialEngine
from optics.psf.sampled import SampledEngine
from optics.psf.scattered import ScatteredEngine
from optics.psf.truth import Probe

METHODS = ("axial", "scattered", "sampled")
"""For a lens; behind a panel the methods are those of the Fourier transform."""


_ROOM = 10.0
"""Between a tolerance that is advised and one that can be planned for: a twentieth to a tenth of
an even panel's light is enough then."""


def require_method(method: str | None, camera: Camera | None) -> None:
    """Raise ValueError for a name that isn't one of a lens' methods, or of a chain's."""
    if camera is None:
        named(METHODS, method, "a lens")
    elif camera.separation:
        named(CHAIN_METHODS + TRANSFORMS, method, "a panel apart from its lens")


def _choice(
    question: Question, camera: Camera | None, method: str | None, tried: Iterable[Engine] = ()
) -> Choice[Engine]:
    """The engines that offer to serve, but for those of the kinds that were tried."""
    makers = _makers(question, camera, method)
    kinds = {one.name for one in tried}
    return Choice(
        [make for name, make in makers.items() if name not in kinds],
        question.budget,
        "a PSF",
        remedy="ask for fewer pixels, or bring the object closer to the plane in focus",
    )


def _makers(
    question: Question, camera: Camera | None, method: str | None
) -> dict[str, Callable[[], Engine]]:
    """What makes every engine that may serve a question."""
    makers: dict[str, Callable[[], Engine]]
    if camera is None:
        probe = Probe(question)
        makers = {
            "axial": lambda: AxialEngine(question),
            "scattered": lambda: ScatteredEngine(question, probe),
        }
        if method or question.tol >= SampledEngine.FINEST:
            makers["sampled"] = lambda: SampledEngine(question, probe)
        return {name: makers[name] for name in named(makers, method)}
    if not camera.separation:
        return {"panel": lambda: PanelEngine(question, camera, transform=method)}
    return chain_engines(question, camera, method)


def prepared(question: Question, camera: Camera | None, method: str | None, rest: float) -> Engine:
    """The cheapest engine that fits the memory and keeps the tolerance, prepared.

    rest: what is left out of the question's tolerance. Raises ToleranceError with a tolerance
    that can be kept, or with what else would help.
    """
    choice = _choice(question, camera, method)
    for engine in choice.prepared():
        return engine
    refusal = choice.refusal(question.tol + rest)
    if isinstance(refusal, ToleranceError) and refusal.floor is not None:
        raise advice(question, camera, method, rest, refusal.floor + rest)
    raise refusal


def stand_ins(question: Question, camera: Camera, tried: Iterable[Engine]) -> Iterator[Engine]:
    """Engines of other kinds than those that were tried, which promise the tolerance too, the
    cheapest first; each is prepared when it is asked for."""
    return _choice(question, camera, None, tried).prepared()


def advice(
    question: Question, camera: Camera | None, method: str | None, rest: float, floor: float
) -> ToleranceError:
    """A refusal that names a tolerance, from `floor` upwards, which can be kept.

    An engine plans anew for another tolerance, and knows only roughly what that leaves out. So
    for a panel apart from its lens, whose engines are cheap to plan, the advice is tried out;
    with room for patterns that send less light into the window than an even one, where there is
    any. Planning takes a tenth of a second, so the tolerances are bisected: whoever keeps one
    keeps a larger one, too. rest: what is left out of the question's tolerance.
    """
    promised = question.tol + rest
    if camera is None or not camera.separation or math.isnan(promised):
        return unkeepable(promised, floor)
    candidates = list(_upwards(floor))
    for room in (_ROOM, 1.0):

        def kept(tol: float, room: float = room) -> bool:
            asked = (replace(question, tol=(tol - rest) / part) for part in (room, 1.0))
            return all(_keeps(one, camera, method) for one in asked)

        first = bisect_left(candidates, True, key=kept)
        if first < len(candidates):
            return unkeepable(promised, candidates[first])
    return unkeepable(promised, math.inf)


def _keeps(question: Question, camera: Camera, method: str | None) -> bool:
    """Whether any engine promises to."""
    offers = _choice(question, camera, method).offers
    return any(one.error.value + one.arithmetic <= question.tol for one in offers)


def _upwards(floor: float) -> Iterator[float]:
    """Tolerances as they are written in advice, in ever larger steps."""
    step = 1.0
    while floor < 1:
        yield float(rounded_up(floor))
        step = min(2.0, step + 0.125)
        floor *= step
