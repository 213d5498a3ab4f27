"""The cases that the accuracy page measures: a camera's own, or ones that take little time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from labapp.accuracy import chain, edof_case, propagate, retrieval
from labapp.common.errors import UserError
from labapp.files.bench_file import read_camera
from labapp.files.reading import bundled_path
from labapp.patterns.designing.kinds import read_psf
from labapp.prediction.lens_options import LensCase, read_panel
from labapp.prediction.simulating.picture_request import (
    PictureRequest,
    prepare_bench_scene,
    small_bench_setup,
)
from optics.accuracy import Budget
from optics.camera import Camera, Lens
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval.goal import RetrievalGoal
from simulator.situation import Situation


@dataclass(frozen=True)
class OverviewSettings:
    """Set how much is measured. All values are chosen so that the page takes minutes.

    operation_s: seconds after which the rest of an operation is cut.
    least_tolerance: smallest tolerance that is asked for.
    window: sensor pixels along a side of the PSFs.
    chain_window: the same for a panel apart from its lens.
    chain_panel: that panel: rows, columns and micrometres, as for `labapp accuracy chain`. It makes
    the thesis' camera as much smaller as it is narrower.
    field_size: samples along a side of the field that propagates.
    picture_size: pixels along a side of the photograph that is restored.
    edof_panel: panel for which patterns with an extended depth of field are designed, as for
    `labapp accuracy edof`.
    edof_steps: largest number of steps of these designs.
    retrieval_s: processor seconds that one setting of phase retrieval may take.
    most_products: that an exact integral may take. The thesis' camera takes 5.4e11, which were
    measured to take two minutes.
    defocus: distance of the object over that of the plane in focus.
    far: distance of the object in focal lengths, where the plane in focus lies at infinity.
    """

    operation_s: float = 75.0
    least_tolerance: float = 1e-8
    window: int = 128
    chain_window: int = 32
    chain_panel: str = "68x120x8"
    field_size: int = 192
    picture_size: int = 128
    edof_panel: str = edof_case.THESIS_PANEL
    edof_steps: int = 100
    retrieval_s: float = 1.0
    most_products: float = 6e11
    defocus: float = 0.8
    far: float = 1000.0


@dataclass(frozen=True)
class Scope:
    """What the page is measured for.

    budget: with the machine's speed.
    camera: None for the bundled cases.
    """

    budget: Budget
    camera: Camera | None = None
    settings: OverviewSettings = field(default_factory=OverviewSettings)


_WAVELENGTH = 550e-9
_PITCH = 3.45e-6


def lens_case(scope: Scope) -> LensCase:
    """Return a lens with an object out of focus: the camera's lens, or a bundled one."""
    size = scope.settings.window
    if scope.camera is None:
        plane = Plane((size, size), (_PITCH, _PITCH))
        return LensCase(Lens(0.1, 8.0, 2.0), 2.0 * scope.settings.defocus, _WAVELENGTH, plane)
    return _camera_case(scope.camera, scope, size)


def panel_case(scope: Scope) -> chain.ChainCase:
    """Return a panel in the plane of its lens.

    Raises UserError for a camera whose panel stands apart from its lens.
    """
    if scope.camera is not None and scope.camera.separation:
        raise UserError("this camera's panel stands apart from its lens: see the chain")
    camera = replace(scope.camera or read_camera(None), separation=0.0)
    return _describe(_camera_case(camera, scope, scope.settings.window), scope)


def chain_case(scope: Scope) -> chain.ChainCase:
    """Return a panel apart from its lens, with light on whole pixels.

    Raises UserError for a camera whose panel stands in the plane of its lens.
    """
    camera = scope.camera or _small_thesis_camera(scope.settings.chain_panel)
    if not camera.separation:
        raise UserError("this camera's panel stands in the plane of its lens: see the panel")
    found = _describe(_camera_case(camera, scope, scope.settings.chain_window), scope)
    whole = replace(found.problem, integrate=True)
    return chain.ChainCase(whole, f"{found.name}, whole pixels")


def _small_thesis_camera(panel: str) -> Camera:
    """Return the thesis' camera, smaller, with its angles.

    Panel, lens and their distance shrink alike. The whole camera's exact integral takes minutes,
    and that of random phases hours.
    """
    thesis = read_camera(bundled_path("thesis-camera.toml"))
    shape, pitch = read_panel(panel)
    smaller = shape[1] * pitch / (thesis.panel.shape[1] * thesis.panel.pitch)
    lens = replace(thesis.lens, focal_length=smaller * thesis.lens.focal_length)
    cells = replace(thesis.panel, shape=shape, pitch=pitch)
    return replace(thesis, panel=cells, lens=lens, separation=smaller * thesis.separation)


def _describe(case: LensCase, scope: Scope) -> chain.ChainCase:
    """Return a camera's case with a pattern whose exact light is found soon.

    Random phases are the hardest pattern, but their exact integral through the large panel of a
    camera and a distance takes hours. A cubic phase is a product of functions of y and x.
    """
    apart = scope.camera is not None and scope.camera.separation
    return chain.chain_case_from_options(
        case,
        panel=None,
        separation_mm=None,
        pattern="cubic" if apart else "random",
        field=(0.0, 0.0),
        sphere=False,
        most_products=scope.settings.most_products,
    )


def _camera_case(camera: Camera, scope: Scope, size: int) -> LensCase:
    focus, pitch = camera.lens.focus_distance, camera.sensor.pitch
    distance = scope.settings.defocus * focus
    if math.isinf(focus):
        distance = scope.settings.far * camera.lens.focal_length
    plane = Plane((size, size), (pitch, pitch))
    return LensCase(camera.lens, distance, _WAVELENGTH, plane, camera)


def field_case(scope: Scope) -> propagate.FieldCase:
    """Return a smooth field that propagates through 50 mm of free space."""
    plane = Plane((scope.settings.field_size,) * 2, (8e-6, 8e-6))
    return propagate.field_case_from_options(
        "smooth", plane, plane, 0.05, _WAVELENGTH, paraxial=False
    )


def retrieval_goal(scope: Scope) -> tuple[RetrievalGoal, str]:
    """Return a ring as the target of phase retrieval, and its name."""
    spec = read_psf("ring", [], 1e9 * _WAVELENGTH, {})
    return retrieval.goal_for_camera(spec, scope.camera or read_camera(None))


def depth_of_field_case(scope: Scope) -> edof_case.EdofCase:
    """Return the camera whose depth of field is extended: the thesis' by default.

    Raises UserError for a panel that can't be read.
    """
    settings, camera = scope.settings, scope.camera
    panel = None if camera else settings.edof_panel
    size, window = settings.picture_size, settings.window
    return edof_case.edof_case_from_options(camera, panel, noise=0.008, size=size, window=window)


def simulated_situation(progress: Progress) -> Situation:
    """Return the situation of a simulated picture: a star, on few pixels."""
    asked = PictureRequest(target="star")
    with prepare_bench_scene(small_bench_setup(None), asked, progress) as staged:
        return staged.situation
