"""Which ways lead through the chain of panel, space, lens and sensor."""

from __future__ import annotations

import functools
from collections.abc import Callable

from optics.accuracy import select_methods
from optics.camera import Camera
from optics.chain.collapsed import CollapsedEngine
from optics.chain.edge_scatter import StopEdgeScatter
from optics.chain.grid import GridEngine
from optics.chain.lens_grid import LensGridSearch
from optics.chain.quadrature_engine import QuadratureEngine
from optics.point.engine import PSFEngine
from optics.point.panel_engine import PANEL_METHODS
from optics.point.request import PSFRequest
from optics.pupil import numeric_camera, require_open_pupil

CHAIN_METHODS = (CollapsedEngine.name, GridEngine.name, QuadratureEngine.name)
"""A transform's name asks for the collapsed camera."""


def chain_engines(
    request: PSFRequest, camera: Camera, method: str | None
) -> dict[str, Callable[[], PSFEngine]]:
    """What makes the engines that may serve, by their names; one of them if a method is named.

    Raises ValueError for a stop that leaves the panel dark.
    """
    require_open_pupil(numeric_camera(camera))
    # What the stop's edge scatters is looked at once for all of them.
    edge = StopEdgeScatter(request, numeric_camera(camera))
    search = functools.cache(lambda: LensGridSearch(edge))
    transform = method if method in PANEL_METHODS else None
    makers: dict[str, Callable[[], PSFEngine]] = {
        GridEngine.name: lambda: GridEngine(request, camera, search()),
        QuadratureEngine.name: lambda: QuadratureEngine(request, camera, search()),
        CollapsedEngine.name: lambda: CollapsedEngine(request, camera, search(), transform),
    }
    wanted = select_methods(makers, CollapsedEngine.name if transform else method)
    return {name: makers[name] for name in wanted}
