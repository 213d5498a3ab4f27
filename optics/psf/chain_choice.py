"""List the engines that go through the chain from panel to sensor."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from optics.accuracy import select_methods
from optics.camera import Camera
from optics.camera.pupil import numeric_camera, require_open_pupil
from optics.psf.chain_collapsed import CollapsedEngine
from optics.psf.chain_direct import DirectEngine
from optics.psf.chain_grid import GridEngine
from optics.psf.chain_nodes import QuadratureEngine
from optics.psf.edge_scatter import StopEdgeScatter
from optics.psf.engine import PSFEngine
from optics.psf.lens_grid import LensGridSearch
from optics.psf.panel_methods import PANEL_METHODS
from optics.psf.request import PSFRequest

CHAIN_METHODS = (
    CollapsedEngine.name,
    GridEngine.name,
    QuadratureEngine.name,
    DirectEngine.name,
)
"""Names of the chain's engines. A Fourier transform's name selects the collapsed camera."""


def chain_engines(
    request: PSFRequest, camera: Camera, method: str | None, *, mirrored: bool = False
) -> dict[str, Callable[[], PSFEngine]]:
    """Return, by name, functions that make the engines for a panel apart from its lens.

    method: one of CHAIN_METHODS, or the name of a transform, which selects CollapsedEngine with it;
    None for all engines.
    mirrored: whether a quarter of a mirrored pattern is given, which only CollapsedEngine takes.

    Raises ValueError for a stop that leaves the panel dark, or a method that isn't known.
    """
    plain, kinds = numeric_camera(camera), (GridEngine, QuadratureEngine, DirectEngine)
    require_open_pupil(plain)
    # All engines share one estimate of the light that the stop's edge scatters.
    search = LensGridSearch(StopEdgeScatter(request, plain))
    transform = method if method in PANEL_METHODS else None
    # One of these may stand in for another that a dark window needs to be stricter.
    allowed = [kind for kind in kinds if method in (None, kind.name)]
    makers: dict[str, Callable[[], PSFEngine]] = {
        kind.name: partial(kind, request, camera, search, kinds=allowed) for kind in kinds
    }
    makers[CollapsedEngine.name] = partial(
        CollapsedEngine, request, camera, search, transform, mirrored=mirrored
    )
    wanted = select_methods(makers, CollapsedEngine.name if transform else method)
    return {name: makers[name] for name in wanted}
