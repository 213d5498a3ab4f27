"""Which ways lead through the chain of panel, space, lens and sensor."""

from __future__ import annotations

import functools
from collections.abc import Callable

from optics.accuracy import named
from optics.camera import Camera
from optics.chain.collapsed import CollapsedEngine
from optics.chain.edge_light import EdgeLight
from optics.chain.grid import GridEngine
from optics.chain.lens_grid import Search
from optics.chain.nodes import NodesEngine
from optics.point.engine import Engine
from optics.point.panel import TRANSFORMS
from optics.point.question import Question
from optics.pupil import numeric_camera, require_open

CHAIN_METHODS = (CollapsedEngine.name, GridEngine.name, NodesEngine.name)
"""A transform's name asks for the collapsed camera."""


def chain_engines(
    question: Question, camera: Camera, method: str | None
) -> dict[str, Callable[[], Engine]]:
    """What makes the engines that may serve, by their names; one of them if a method is named.

    Raises ValueError for a stop that leaves the panel dark.
    """
    require_open(numeric_camera(camera))
    # What the stop's edge scatters is looked at once for all of them.
    edge = EdgeLight(question, numeric_camera(camera))
    search = functools.cache(lambda: Search(edge))
    transform = method if method in TRANSFORMS else None
    makers: dict[str, Callable[[], Engine]] = {
        GridEngine.name: lambda: GridEngine(question, camera, search()),
        NodesEngine.name: lambda: NodesEngine(question, camera, search()),
        CollapsedEngine.name: lambda: CollapsedEngine(question, camera, search(), transform),
    }
    wanted = named(makers, CollapsedEngine.name if transform else method)
    return {name: makers[name] for name in wanted}
