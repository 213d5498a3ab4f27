"""The PSF of what an exposure sees, as the sensor sees it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch

from optics.camera import Camera, Panel
from optics.plane import Plane
from optics.psf import PSFOperator, modulated_psf
from optics.slm import Modulator
from simulator.caching import Cache
from simulator.grid import Grid
from simulator.motion import Exposures, Pictures, exposures
from simulator.mount import Mount
from simulator.shown import Mixture, Procession


class Renderer:
    """From grey levels to PSFs, behind a camera's panel that sits as `mount` says.

    tol: relative L2 error of a PSF. camera: in the panel's axes; the lens stays with the sensor.
    """

    def __init__(self, camera: Camera, mount: Mount, tol: float) -> None:
        self._sensor, self._mount, self._tol = camera.sensor, mount, max(tol, 1e-5)
        self.camera = camera if mount.aligned else replace(camera, lens=mount.lens(camera.lens))
        self._operators = Cache(8)
        self._modulators = Cache(8)

    def psf(
        self,
        seen: Mixture | Procession,
        pictures: Pictures,
        band: Sequence[tuple[float, float]],
        panel: Panel,
        distance: float,
        grid: Grid,
        check: Callable[[], None],
    ) -> torch.Tensor:
        """Of a point: the mean over what is seen, and over wavelengths with their weights.

        panel: with the effects that shall be rendered. (rows, columns) of the grid's PSF.
        """
        plane = grid.psf_plane(self._sensor)
        if not self._mount.aligned:
            plane = self._mount.plane(plane)
        psf = torch.zeros(plane.shape)
        for wavelength, weight in band:
            operator = self._operator(distance, wavelength, plane)
            modulator = self._modulator(panel, wavelength)
            parts = _checked(exposures(modulator, seen, pictures, self._tol), check)
            psf += weight * modulated_psf(operator, modulator, parts).to(psf)
        if self._mount.aligned:
            return psf
        return self._mount.turned(psf, grid.psf_plane(self._sensor))

    def _operator(self, distance: float, wavelength: float, plane: Plane) -> PSFOperator:
        """Unmodulated light is the modulator's."""
        return self._operators.get(
            (distance, wavelength, plane),
            lambda: PSFOperator(
                self.camera,
                distance,
                wavelength,
                plane,
                integrate=False,
                unmodulated=0.0,
                tol=self._tol,
            ),
        )

    def _modulator(self, panel: Panel, wavelength: float) -> Modulator:
        return self._modulators.get((panel, wavelength), lambda: Modulator(panel, wavelength))


def _checked(parts: Exposures, check: Callable[[], None]) -> Exposures:
    """The same with a check before each, and after the last: they are made in between."""
    check()
    for part in parts:
        yield part
        check()
