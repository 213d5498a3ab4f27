"""The light of a point behind a panel, free space, a lens with its stop, and free space again."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace

import torch

from optics.accuracy import ToleranceError, unkeepable
from optics.camera import Camera
from optics.chain.dimness import Dimness
from optics.chain.lens_grid import Search
from optics.chain.relay import Moved
from optics.edge import as_number, recorded
from optics.point.engine import Engine
from optics.point.question import Question
from optics.pupil import Scalar, numeric_camera, open_area


class ChainEngine(Engine):
    """Panel, space, stop and lens, space, sensor: thesis Eq. 5.1 to 5.7, in Fresnel's model.

    With the point's parabolic wave factored out (Sziklas and Siegman 1975,
    10.1364/AO.14.001874), the spread M = 1 + z1/d and the point's image at x_i on the sensor,
    the field at x in the lens' plane is

        exp(i pi (x - x_o)² / (lambda (d + z1))) W(x / M - z1 x_i / z2) / M,

    where W is the panel's modulation after z1 / M of free space and x_o = -x_i (d + z1) / z2
    the object: completing the square in s of (s - x_o)²/d + (x - s)²/z1 leaves
    (M / z1) (s - c)² + (x - x_o)² / (d + z1), c = x / M - z1 x_i / z2. An object at infinity is
    M = 1. Then the lens leaves the defocus and its aberrations (`wave_phase`), and a Fraunhofer
    integral about the image point goes to the sensor; the tilt by x_o is what moves it there.
    """

    def __init__(
        self,
        question: Question,
        camera: Camera,
        search: Search,
        promised: float | None = None,
    ) -> None:
        self._question, self._camera = question, numeric_camera(camera)
        self._promised = promised or question.tol
        self._search, self._edge = search, search.edge
        self._twin: ChainEngine | None = None
        self._plan(question.numeric)

    @abstractmethod
    def _plan(self, n: Question) -> None:
        """Choose what keeps the tolerance of a question in plain numbers."""

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._camera.panel.plane.mesh()

    def modulated(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        """The panel's field, without the point's parabola."""
        factor = self.modulation(phase, amplitude, self._camera.panel.shape, self._dtype)
        if factor is None:
            factor = torch.ones(self._camera.panel.shape, dtype=self._dtype)
        sphere = self._question.sphere
        if sphere is None:
            return factor
        return factor * sphere.factor(*self.points()).to(factor)

    def none(self, modulated: torch.Tensor) -> torch.Tensor:
        """The answers to no fields at all, (..., rows, columns): FFTs take none."""
        light = modulated.real.sum(dim=(-2, -1))
        return light[..., None, None].expand(*light.shape, *self._question.samples.shape)

    def leaning(self, field: torch.Tensor) -> list[tuple[int, torch.Tensor]]:
        """The panel's field times the slope of the sphere's difference from its parabola inside
        every pixel, cycles a metre along each axis; nothing where there is no sphere."""
        sphere = self._question.sphere
        if sphere is None:
            return []
        slopes = sphere.gradient(*self.points(), self._camera.panel.active_side)
        return [(axis, field * slope.to(field)) for axis, slope in enumerate(slopes)]

    def _sphere_error(self) -> float:
        """What it costs to follow the sphere's difference from its parabola inside a pixel by its
        slope: half of the square of half the turn, on average over the pixel a third of that."""
        sphere, panel = self._question.numeric.sphere, self._camera.panel
        if sphere is None:
            return 0.0
        turn = sphere.slope(math.hypot(*panel.shape) * panel.pitch / 2) * panel.pitch
        return turn**2 / 12

    def _moved(self) -> Moved | None:
        """What the field at the lens depends on, where its derivatives are wanted."""
        q = self._question
        lengths = (q.wavelength, q.separation, q.distance, q.radius, *q.sines)
        if not any(map(recorded, lengths)):
            return None
        n = q.numeric
        bend = q.wavelength * q.separation / q.spread
        stretch = (q.radius / n.radius) * (n.spread / q.spread)
        shift = tuple(
            stretch * (was * n.separation) - now * q.separation
            for was, now in zip(n.sines, q.sines, strict=True)
        )
        one = torch.ones((), dtype=torch.float64)
        return Moved(bend * one, stretch * one, (shift[0] * one, shift[1] * one))

    def _power(self) -> Scalar:
        """Square metres of pixels that panel and stop would leave open in one plane."""
        fill = self._camera.panel.fill_factor
        area, radius = open_area(self._camera) * fill, self._question.radius
        if not recorded(radius):
            return area
        # The stop's edge is smooth enough for a difference of areas.
        lens, part = self._camera.lens, 1e-5
        wider, narrower = (
            open_area(replace(self._camera, lens=replace(lens, f_number=lens.f_number / (1 + p))))
            for p in (part, -part)
        )
        growth = (wider - narrower) * fill / (2 * part)
        return area + growth * (radius / as_number(radius) - 1)

    def strength(self) -> Scalar:
        """What turns |sum over the lens' samples in stop radii|² into shares of the light."""
        q = self._question
        area = q.samples.pitch[0] * q.samples.pitch[1]
        return area * q.radius**4 / (q.scale**2 * q.spread**2 * self._power())

    @property
    def _within(self) -> float:
        """Share of the error's square that light makes whose frequencies pass the stop."""
        return 0.0

    def _kept(
        self,
        light: torch.Tensor,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        inside: Callable[[], tuple[float, float]] | None = None,
    ) -> torch.Tensor:
        """The light, if the window gets enough of it; else that of an engine planned for less.

        inside: the panel's brightness (see Dimness), where somebody knows it sooner.
        """
        look = inside or (lambda: self._edge.inside(self.modulated(phase, amplitude)))
        ratio = Dimness(self._edge, self._question.inner, light, amplitude, look).ratio(
            self._within
        )
        if self.error.value / ratio + self.arithmetic <= self._promised:
            return light
        tol = 0.7 * ratio * self._promised
        if self._twin is None or self._twin.error.value > tol:
            self._twin = self._planned_for(tol)
        return self._twin.intensity(phase, amplitude)

    def _planned_for(self, tol: float) -> ChainEngine:
        promised, budget = self._promised, self._question.budget
        try:
            if not tol < 0.9 * self._question.tol:
                raise unkeepable(promised, promised)
            question = replace(self._question, tol=tol)
            twin = type(self)(question, self._camera, self._search, promised)
            if twin.bytes <= budget.memory:
                twin.prepare()
                return twin
        except ToleranceError:
            pass
        raise ToleranceError(
            f"tol {promised:g} can't be kept: the window gets so little of the light that what the "
            "stop's edge scatters there counts; ask for a window that is nearer to the light"
        )
