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


@dataclass(frozen=True)
class BeamPictureSettings:
    """Tune the two pictures of a beam: from panel to sensor, and around the sensor. All chosen.

    samples: across the beam. An odd number has one sample on the axis.
    lowest_ratio: lowest irradiance shown around the sensor, over the highest there.
    dimmest: lowest irradiance shown from panel to sensor, over that on the panel. It isn't relative
    to the focus, which is so much brighter that nothing else would be seen.
    room: half height of a picture over half the widest object in it.
    focal_depths: depths shown on each side of the sensor, in depths of focus λ N².
    defocus_margin: depths shown on each side of the sensor, at least, over the distance from the
    sensor to the plane where the object is in focus.
    beyond: depths shown behind the sensor, over the distance from panel to sensor.
    """

    samples: int = 481
    lowest_ratio: float = 1e-4
    dimmest: float = 1e-2
    room: float = 1.15
    focal_depths: float = 12.0
    defocus_margin: float = 3.0
    beyond: float = 0.12


_SETTINGS = BeamPictureSettings()


@dataclass(frozen=True)
class BeamRequest:
    """The options of `labapp beam`, in SI units.

    pattern: file of grey levels for the panel; None leaves the panel neutral.
    field: position (y, x) of the point's image on the sensor.
    slices: number of depths in each of the two pictures.
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

    depths: from the panel, metres.
    places: across the axis, metres.
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
    phase = _phase(request)
    with terminal_progress() as progress:
        whole = _compute_section(
            request,
            phase,
            _panel_to_sensor_bounds(request.camera, request.field),
            progress.part(0.0, 0.5),
        )
        focus = _compute_section(
            request, phase, _near_sensor_bounds(request), progress.part(0.5, 1.0)
        )
    write_atomically(path, figure_to_png(_picture(request, whole, focus)))
    out.print(f"wrote {path}")


def _phase(request: BeamRequest) -> torch.Tensor | None:
    """Return the panel's phase; None for a neutral panel."""
    if request.pattern is None:
        return None
    panel = request.camera.panel
    grey = torch.from_numpy(read_grey_pattern(request.pattern, panel))
    phase: torch.Tensor = grey_to_phase(panel, grey, request.wavelength)
    return phase


@dataclass(frozen=True)
class _SectionBounds:
    """The extent of a picture in metres: depths from the panel, middle and half height."""

    title: str
    depths: tuple[float, float]
    middle: float
    half: float


def _panel_to_sensor_bounds(camera: Camera, field: tuple[float, float]) -> _SectionBounds:
    panel, lens = camera.panel, camera.lens
    wide = max(panel.shape[1] * panel.pitch, lens.stop_diameter) / 2
    way = camera.separation + lens.image_distance
    end = way * (1 + _SETTINGS.beyond)
    return _SectionBounds(
        "From the panel to the sensor",
        (end * 1e-4, end),
        0.0,
        _SETTINGS.room * wide + abs(field[1]),
    )


def _near_sensor_bounds(request: BeamRequest) -> _SectionBounds:
    """Return the extent of the picture around the sensor.

    The picture shows some depths of focus, or more if the object is farther out of focus.
    """
    camera, lens = request.camera, request.camera.lens
    sensor = camera.separation + lens.image_distance
    vergence = 1 / lens.focal_length - 1 / (request.distance + camera.separation)
    image = camera.separation + 1 / vergence if vergence > 0 else math.inf
    number = lens.image_distance / lens.stop_diameter
    half = _SETTINGS.focal_depths * request.wavelength * number**2
    if math.isfinite(image):
        half = max(half, _SETTINGS.defocus_margin * abs(image - sensor))
    half = min(half, 0.5 * lens.image_distance)
    wide = max(half / number / 2, 30 * request.wavelength * number)
    return _SectionBounds(
        "Around the sensor",
        (sensor - half, sensor + half),
        request.field[1],
        _SETTINGS.room * wide,
    )


def _compute_section(
    request: BeamRequest, phase: torch.Tensor | None, box: _SectionBounds, progress: Progress
) -> AxialSection:
    depths = np.linspace(*box.depths, request.slices)
    samples = _SETTINGS.samples
    across = Plane((1, samples), (box.half, 2 * box.half / (samples - 1)), (0.0, box.middle))
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
    return AxialSection(box.title, depths, places, np.asarray(light, dtype=np.float64))


def _picture(request: BeamRequest, whole: AxialSection, focus: AxialSection) -> Figure:
    figure = Figure(figsize=(14, 8.5), dpi=110, layout="constrained")
    figure.suptitle(_heading(request), fontsize=12)
    top, bottom = figure.subplots(2, 1)
    _draw(top, whole, 1e3, "mm", _SETTINGS.dimmest)
    _draw(bottom, focus, 1e6, "µm", _SETTINGS.lowest_ratio * float(focus.light.max()))
    _draw_elements(top, request, whole)
    sensor = request.camera.separation + request.camera.lens.image_distance
    _mark(bottom, sensor, "sensor")
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
    dimmest = dimmest or _SETTINGS.dimmest
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
    axes.set_title(stretch.title)
    axes.set_xlabel("mm behind the panel")
    axes.set_ylabel(f"x, {name}")
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
    _mark(axes, camera.separation + lens.image_distance, "sensor")
    style: dict[str, Any] = {"color": "white", "fontsize": 9, "va": "bottom"}
    axes.text(1e3 * stretch.depths[0], -edge, " panel", **style)
    if camera.separation:
        axes.text(at, -edge, " lens and stop", **style)
    axes.set_ylim(-edge, edge)


def _mark(axes: Axes, depth: float, name: str) -> None:
    axes.axvline(1e3 * depth, color="white", linewidth=0.8, linestyle="--")
    low = axes.get_ylim()[0]
    axes.text(1e3 * depth, low, f" {name}", color="white", fontsize=9, va="bottom")
