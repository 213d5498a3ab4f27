"""Which ways serve a question about a PSF, and which of them is the cheapest."""

from __future__ import annotations

import functools
import math
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from optics.accuracy import Budget, ToleranceError, unkeepable
from optics.camera import Camera
from optics.edge import rounded_up
from optics.psf.axial import AxialEngine
from optics.psf.chain import require_open
from optics.psf.chain_grid import GridEngine
from optics.psf.chain_nodes import NodesEngine
from optics.psf.edge_light import EdgeLight
from optics.psf.engine import Engine
from optics.psf.lens_grid import Search
from optics.psf.panel import TRANSFORMS, PanelEngine
from optics.psf.question import Question
from optics.psf.sampled import SampledEngine
from optics.psf.scattered import ScatteredEngine
from optics.psf.shadow import CollapsedEngine, collapses
from optics.psf.truth import Probe
from optics.pupil import numeric_camera

METHODS = ("axial", "scattered", "sampled")
"""For a lens; behind a panel the methods are those of the Fourier transform."""

CHAIN_METHODS = ("collapsed", "chain", "chain, quadrature")
"""Where a panel stands apart from its lens. A transform's name asks for the collapsed camera."""


_ROOM = 10.0
"""Between a tolerance that is advised and one that can be planned for: a twentieth to a tenth of
an even panel's light is enough then."""


def require_method(method: str | None, camera: Camera | None) -> None:
    if method is None:
        return
    if camera is None and method not in METHODS:
        raise ValueError(f"method is {method!r}; for a lens choose one of {', '.join(METHODS)}")
    if camera is not None and camera.separation and method not in CHAIN_METHODS + TRANSFORMS:
        raise ValueError(
            f"method is {method!r}; for a panel apart from its lens choose one of "
            f"{', '.join(map(repr, CHAIN_METHODS))}, or a transform's name"
        )


def _offers(
    question: Question, camera: Camera | None, method: str | None
) -> list[Callable[[], Engine]]:
    """Makers of every engine that serves a question; one that can't serve raises."""
    if camera is not None:
        return _panel_offers(question, camera, method)
    probe = Probe(question)
    offers: list[Callable[[], Engine]] = []
    if method in (None, "axial") and AxialEngine.serves(question):
        offers.append(lambda: AxialEngine(question))
    if method in (None, "scattered"):
        offers.append(lambda: ScatteredEngine(question, probe))
    if method in (None, "sampled") and (method or question.tol >= SampledEngine.FINEST):
        offers.append(lambda: SampledEngine(question, probe))
    return offers


def _panel_offers(
    question: Question, camera: Camera, method: str | None
) -> list[Callable[[], Engine]]:
    if not camera.separation:
        return [lambda: PanelEngine(question, camera, transform=method)]
    require_open(numeric_camera(camera))
    # What the stop's edge scatters is looked at once for all of them.
    edge = EdgeLight(question, numeric_camera(camera))
    search = functools.cache(lambda: Search(edge))
    offers: list[Callable[[], Engine]] = []
    if method in (None, "chain"):
        offers.append(lambda: GridEngine(question, camera, search()))
    if method in (None, "chain, quadrature"):
        offers.append(lambda: NodesEngine(question, camera, search()))
    if method in (None, "collapsed", *TRANSFORMS) and collapses(numeric_camera(camera)):
        transform = method if method in TRANSFORMS else None
        offers.append(lambda: CollapsedEngine(question, camera, search(), transform))
    return offers


def prepared(question: Question, camera: Camera | None, method: str | None, rest: float) -> Engine:
    """The cheapest engine that fits the memory and keeps the tolerance, prepared.

    rest: what is left out of the question's tolerance. Raises the ToleranceError of the one that
    came first in the offers, with a tolerance that can be kept.
    """
    engines, refusals = _accepting(question, camera, method)
    for engine in _readied(engines, question.budget, refusals):
        return engine
    floors = [error.floor for error in refusals if error.floor is not None]
    if refusals[0].floor is None or not floors:
        raise refusals[0]
    raise advice(question, camera, method, rest, min(floors) + rest)


def stand_ins(question: Question, camera: Camera, tried: Iterable[Engine]) -> Iterator[Engine]:
    """Engines of other kinds than those that were tried, which promise the tolerance too, the
    cheapest first; each is prepared when it is asked for."""
    engines, refusals = _accepting(question, camera, None)
    kinds = {type(one) for one in tried}
    others = [one for one in engines if type(one) not in kinds]
    return _readied(others, question.budget, refusals)


def _readied(
    engines: Iterable[Engine], budget: Budget, refusals: list[ToleranceError]
) -> Iterator[Engine]:
    """Prepared, the cheapest first; what the others say goes before the refusals."""
    for engine in sorted(engines, key=lambda engine: engine.cpu_seconds(budget.speed)):
        try:
            engine.prepare()
        except ToleranceError as error:
            refusals.insert(0, error)
            continue
        yield engine


def _accepting(
    question: Question, camera: Camera | None, method: str | None
) -> tuple[list[Engine], list[ToleranceError]]:
    """Engines that offer to serve, and what the others say."""
    offers = _offers(question, camera, method)
    if not offers:
        serves = "thin lenses without aberrations" if camera else "round stops and aberrations"
        raise ValueError(f"method is {method!r}; it serves {serves} only")
    refusals: list[ToleranceError] = []
    engines: list[Engine] = []
    for offer in offers:
        try:
            engine = offer()
            _require_memory(engine, question.budget)
            engines.append(engine)
        except ToleranceError as error:
            refusals.append(error)
    return engines, refusals


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
    engines, _ = _accepting(question, camera, method)
    return any(one.error.value + one.arithmetic <= question.tol for one in engines)


def _upwards(floor: float) -> Iterator[float]:
    """Tolerances as they are written in advice, in ever larger steps."""
    step = 1.0
    while floor < 1:
        yield float(rounded_up(floor))
        step = min(2.0, step + 0.125)
        floor *= step


def _require_memory(engine: Engine, budget: Budget) -> None:
    if engine.bytes > budget.memory:
        raise ToleranceError(
            f"a PSF by {engine.name} needs {engine.bytes / 1e6:.0f} MB at least and "
            f"{budget.memory / 1e6:.0f} MB are allowed; allow more memory, ask for fewer pixels, "
            "or bring the object closer to the plane in focus"
        )
