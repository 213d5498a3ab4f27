"""The camera for whose depth of field `labapp accuracy edof` measures designs and PSFs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from labapp.common.errors import UserError
from labapp.edof.design_problem import EdofProblem
from labapp.edof.design_request import EdofRequest
from labapp.prediction.lens_options import read_panel
from optics.camera import Camera, Lens, Panel, Sensor
from optics.plane import Plane

THESIS_PANEL = "1080x1920x8"
"""Rows, columns and micrometres of the thesis' panel. It is its own stop at 100 mm, f/5.6."""

_WAVELENGTH, _NEAR, _PITCH = 520e-9, 2.0, 3.45e-6
"""Metres and dioptres of the thesis' chapter 5, and its sensor's pixels."""


@dataclass(frozen=True)
class EdofCase:
    """What designs and PSFs of an extended depth of field are measured for.

    noise: standard deviation of a pixel's noise, where white is 1.
    size: pixels along a side of the periodic pictures of a design.
    window: sensor pixels along a side of the PSFs.
    """

    camera: Camera
    noise: float = 0.008
    size: int = 256
    window: int = 256

    @property
    def wavelength(self) -> float:
        """Wavelength of designs and PSFs in metres."""
        return _WAVELENGTH

    @property
    def nearest_distance(self) -> float:
        """Metres to the nearest object, which is the farthest out of focus."""
        return 1 / _NEAR

    @property
    def pixels(self) -> Plane:
        """Pixels of the PSFs, around the axis."""
        return self.camera.sensor.window_plane((self.window, self.window))

    @property
    def camera_name(self) -> str:
        panel, lens = self.camera.panel, self.camera.lens
        return (
            f"{panel.shape[0]}x{panel.shape[1]} pixels of {1e6 * panel.pitch:g} µm, "
            f"{1e3 * lens.focal_length:g} mm f/{lens.f_number:g}"
        )

    def problem(self, start: str, parametrisation: str) -> EdofProblem:
        """Return what a pattern is designed for, from a start and in a parametrisation."""
        request = EdofRequest(
            None, (_WAVELENGTH,), _NEAR, 0.0, self.noise, "blind", None, start, parametrisation,
            self.size, 1, 1,
        )  # fmt: skip
        return EdofProblem(request, self.camera)


def panel_camera(panel: str) -> Camera:
    """Return the camera of the thesis' chapter 5 with a panel "ROWSxCOLUMNSxMICROMETRES"."""
    shape, pitch = read_panel(panel)
    lens = Lens(0.1, 5.6, math.inf)
    return Camera(Panel(shape, pitch, unmodulated=0.0), lens, Sensor(pitch=_PITCH))


def edof_case_from_options(
    camera: Camera | None, panel: str | None, *, noise: float, size: int, window: int
) -> EdofCase:
    """Return the case that the options of `labapp accuracy edof` describe.

    camera: from a file; None for that of the thesis' chapter 5.
    panel: "ROWSxCOLUMNSxMICROMETRES"; only where no file describes a panel.
    Raises UserError if options are wrong or contradict each other.
    """
    if camera is not None and panel is not None:
        raise UserError(f"--panel {panel}: the camera's file has a panel; leave one of them out.")
    described = panel_camera(panel or THESIS_PANEL) if camera is None else camera
    case = EdofCase(described, noise, size, window)
    # Wrong numbers are refused before anything is measured.
    case.problem("rings", "quarter")
    return case
