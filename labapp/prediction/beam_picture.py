"""The command `labapp beam`: draw the irradiance along the axis, from the panel to the sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labapp.common.console import out, terminal_progress
from labapp.common.errors import UserError
from labapp.common.figure_png import figure_to_png
from labapp.files.grey_table import read_grey_pattern
from labapp.files.writing import write_atomically
from optics.beam import beam_irradiance
from optics.camera import Camera
from optics.plane import Plane
from optics.progress import Progress
from optics.slm import grey_to_phase
from optics.threads import single_threaded

# All chosen.
_SAMPLES = 481  # across the beam; an odd number has one sample on the axis
_DIMMEST_RATIO = 1e-4  # lowest irradiance shown around the sensor, over the highest there
_DIMMEST = 1e-2
"""Lowest irradiance shown from panel to sensor, over that on the panel: the focus is so much
brighter that nothing else would be seen beside it."""
_ROOM = 1.15  # half height of a picture over half the widest object in it
_FOCAL_DEPTHS = 12.0  # depths shown on each side of the sensor, in depths of focus λ N²
_DEFOCUS_MARGIN = 3.0
"""Depths shown on each side of the sensor, at least, over the distance from the sensor to the plane
where the object is in focus."""
_BEYOND = 0.12  # depths shown behind the sensor, over the distance from panel to sensor


@dataclass(frozen=True)
class BeamRequest:
    """The options of `labapp beam`, in SI units.

    pattern: grey levels of the panel, which is neutral without. field: position (y, x) of the
    point's image on the sensor. slices: depths in each of the two pictures.
    """

    camera: Camera
    pattern: Path | None
    distance: float
    wavelength: float
    field: tuple[float, float]
    slices: int


@dataclass(frozen=True)
class AxialSection:
    """Irradiance in a section along the axis, (depths, places).

    Depths are from the panel, and places across the axis, both in metres.
    """

    title: str
    depths: NDArray[np.float64]
    places: NDArray[np.float64]
    light: NDArray[np.float64]


@single_threaded
def draw_beam(request: BeamRequest, path: Path) -> None:
    """Compute a beam's irradiance along the axis, and write its picture."""
    if not 2 <= request.slices <= 5000:
        raise UserError(f"--slices {request.slices}: give 2 to 5000.")
    panel, phase = request.camera.panel, None
    if request.pattern is not None:
        grey = torch.from_numpy(read_grey_pattern(request.pattern, panel))
        phase = grey_to_phase(panel, grey, request.wavelength)
    with terminal_progress() as progress:
        whole = _panel_to_sensor(request, phase, progress.part(0.0, 0.5))
        focus = _around_sensor(request, phase, progress.part(0.5, 1.0))
    write_atomically(path, figure_to_png(_picture(request, whole, focus)))
    out.print(f"wrote {path}")


def _panel_to_sensor(
    request: BeamRequest, phase: torch.Tensor | None, progress: Progress
) -> AxialSection:
    panel, lens = request.camera.panel, request.camera.lens
    wide = max(panel.shape[1] * panel.pitch, lens.stop_diameter) / 2
    way = request.camera.separation + lens.image_distance
    end = way * (1 + _BEYOND)
    depths = np.linspace(end * 1e-4, end, request.slices)
    across = _line_across(0.0, _ROOM * wide + abs(request.field[1]))
    return _section("From the panel to the sensor", request, phase, depths, across, progress)


def _around_sensor(
    request: BeamRequest, phase: torch.Tensor | None, progress: Progress
) -> AxialSection:
    """Compute some depths of focus, or more if the object is farther out of focus."""
    camera, lens = request.camera, request.camera.lens
    sensor = camera.separation + lens.image_distance
    vergence = 1 / lens.focal_length - 1 / (request.distance + camera.separation)
    image = camera.separation + 1 / vergence if vergence > 0 else math.inf
    number = lens.image_distance / lens.stop_diameter
    half = _FOCAL_DEPTHS * request.wavelength * number**2
    if math.isfinite(image):
        half = max(half, _DEFOCUS_MARGIN * abs(image - sensor))
    half = min(half, 0.5 * lens.image_distance)
    wide = max(half / number / 2, 30 * request.wavelength * number)
    depths = np.linspace(sensor - half, sensor + half, request.slices)
    across = _line_across(request.field[1], _ROOM * wide)
    return _section("Around the sensor", request, phase, depths, across, progress)


def _line_across(middle: float, half: float) -> Plane:
    """Return samples along x around `middle`, to both sides as far as `half`, in metres."""
    return Plane((1, _SAMPLES), (half, 2 * half / (_SAMPLES - 1)), (0.0, middle))


def _section(
    title: str,
    request: BeamRequest,
    phase: torch.Tensor | None,
    depths: NDArray[np.float64],
    across: Plane,
    progress: Progress,
) -> AxialSection:
    light = beam_irradiance(
        request.camera,
        phase,
        request.distance,
        request.wavelength,
        depths.tolist(),
        across,
        field=request.field,
        progress=progress,
    )
    places = across.coordinates(1).numpy()
    return AxialSection(title, depths, places, np.asarray(light, dtype=np.float64))


def _picture(request: BeamRequest, whole: AxialSection, focus: AxialSection) -> Figure:
    figure = Figure(figsize=(14, 8.5), dpi=110, layout="constrained")
    figure.suptitle(_heading(request), fontsize=12)
    top, bottom = figure.subplots(2, 1)
    _draw(top, whole, 1e3, "mm", _DIMMEST)
    _draw(bottom, focus, 1e6, "µm", _DIMMEST_RATIO * float(focus.light.max()) or _DIMMEST)
    _draw_elements(top, request, whole)
    _mark_sensor(bottom, request.camera)
    return figure


def _heading(request: BeamRequest) -> str:
    camera, lens = request.camera, request.camera.lens
    where = "at infinity" if math.isinf(request.distance) else f"{request.distance:g} m away"
    shown = request.pattern.name if request.pattern else "neutral"
    field = ""
    if any(request.field):
        field = ", image at {:g}, {:g} mm".format(*(1e3 * place for place in request.field))
    return (
        f"Light of a point {where}{field}, {request.wavelength * 1e9:g} nm; pattern: {shown}\n"
        f"{lens.focal_length * 1e3:g} mm f/{lens.f_number:g} focused at {lens.focus_distance:g} m, "
        f"panel {camera.separation * 1e3:g} mm before it"
    )


def _draw(axes: Axes, stretch: AxialSection, unit: float, name: str, dimmest: float) -> None:
    brightest = max(float(stretch.light.max()), 10 * dimmest)
    shown = np.maximum(stretch.light.T, dimmest)
    image = axes.pcolormesh(
        1e3 * stretch.depths,
        unit * stretch.places,
        shown,
        norm=LogNorm(dimmest, brightest),
        cmap="magma",
        shading="nearest",
        rasterized=True,
    )
    axes.set(title=stretch.title, xlabel="mm behind the panel", ylabel=f"x, {name}")
    assert axes.figure is not None
    axes.figure.colorbar(image, ax=axes, label="light per area, over that on the panel", pad=0.01)


def _draw_elements(axes: Axes, request: BeamRequest, stretch: AxialSection) -> None:
    """Draw panel, stop and sensor at their positions."""
    camera = request.camera
    panel, lens = camera.panel, camera.lens
    line = partial(axes.plot, color="deepskyblue", linewidth=3, solid_capstyle="butt")
    half = 1e3 * panel.shape[1] * panel.pitch / 2
    line([1e3 * stretch.depths[0]] * 2, [-half, half])
    radius, edge = 1e3 * lens.stop_diameter / 2, 1e3 * float(np.abs(stretch.places).max())
    at = 1e3 * camera.separation
    for sign in (-1, 1):
        line([at, at], [sign * radius, sign * max(edge, radius)], color="white")
    _mark_sensor(axes, camera)
    style: dict[str, Any] = {"color": "white", "fontsize": 9, "va": "bottom"}
    axes.text(1e3 * stretch.depths[0], -edge, " panel", **style)
    if camera.separation:
        axes.text(at, -edge, " lens and stop", **style)
    axes.set_ylim(-edge, edge)


def _mark_sensor(axes: Axes, camera: Camera) -> None:
    depth = 1e3 * (camera.separation + camera.lens.image_distance)
    axes.axvline(depth, color="white", linewidth=0.8, linestyle="--")
    low = axes.get_ylim()[0]
    axes.text(depth, low, " sensor", color="white", fontsize=9, va="bottom")
