"""A panel before a lens, computed as a panel in the lens, while the difference is small."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import torch

from optics.accuracy import ErrorEstimate, MachineSpeed, ToleranceError
from optics.camera import Camera
from optics.chain.cut_pixels import gray_share
from optics.chain.dimness import Dimness
from optics.chain.grid import GridEngine
from optics.chain.lens_grid import Search
from optics.chain.thin_camera import collapsed
from optics.edge import as_number, rounded_up
from optics.plane import Plane
from optics.point.engine import Engine
from optics.point.panel import PanelEngine
from optics.point.question import Question
from optics.pupil import LEAST_LEVER, numeric_camera, open_area, pupil_amplitude, vergence_error


class CollapsedEngine(Engine):
    """One Fourier integral from the panel, with the stop's shadow on it (see `collapsed`).

    Exact but for what the stop's edge does to light on its way to it, and for pixels that the
    shadow cuts: one covered in part passes light by its open area, as behind a panel in the
    lens, while the chain cuts it. Both are estimated (see `EdgeLight` and `gray_share`), and the
    offer is refused where they take more than their part of the tolerance. As cut pixels and the
    edge's light may be off in the same direction, their errors are added.
    """

    name = "collapsed"

    def __init__(
        self, question: Question, camera: Camera, search: Search, transform: str | None = None
    ) -> None:
        self._question, self._camera, self._search = question, camera, search
        n = question.numeric
        plain = numeric_camera(camera)
        if not collapses(plain):
            raise ValueError(
                "method is 'collapsed'; it serves thin lenses without aberrations only, whose "
                'panel isn\'t near to the plane in focus; take method="chain"'
            )
        thin = collapsed(plain, n.distance, n.field)
        if not open_area(thin) > 0:
            raise ToleranceError(
                "the shadow of the stop misses the panel, and light that is bent there doesn't go "
                'through a collapsed camera; take method="chain"'
            )
        self._require_still(question, thin)
        self._of_edge, self._of_cuts = search.edge.of_collapse(), 0.0
        if self._of_edge < n.tol:
            self._of_cuts = self._of_cut_pixels(thin)
        neglected = self._of_edge + self._of_cuts
        left = n.tol - neglected
        if not left > 0:
            raise ToleranceError(
                f"tol {n.tol:g} can't be kept by a collapsed camera: what the stop's edge does to "
                f'the light is worth about {rounded_up(neglected)}; take method="chain"'
            )
        inner = _collapsed_question(question, camera, left)
        self._panel = PanelEngine(inner, thin, transform=transform)
        self._brightness = open_area(thin) / open_area(plain)
        self.precision, self.arithmetic = self._panel.precision, self._panel.arithmetic
        self.sampling = self._panel.sampling
        inner_error = self._panel.error
        self.error = ErrorEstimate(
            inner_error.value + neglected,
            f"{inner_error.how}, and an estimate of the stop's edge for an evenly lit panel",
        )

    def _of_cut_pixels(self, thin: Camera) -> float:
        """What it costs that pixels in part are gray, whole ones."""
        inner = _collapsed_question(self._question, self._camera, self._question.tol)
        edge = self._search.edge
        return edge.of_share(gray_share(inner, thin, edge.straight / edge.spread**2))

    @staticmethod
    def _require_still(question: Question, thin: Camera) -> None:
        """The edges of the pixels that a shadow cuts don't move with any length."""
        if question.differentiable and float(pupil_amplitude(thin).min()) < 1:
            raise ToleranceError(
                "the derivatives of a stop whose shadow cuts the panel can't be kept by a "
                'collapsed camera; take method="chain"'
            )

    @property
    def bytes(self) -> int:
        return self._panel.bytes

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._panel.cpu_seconds(speed)

    def prepare(self) -> None:
        self._panel.prepare()

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self._panel.points()

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        light = self._panel.intensity(phase, amplitude) * self._brightness
        edge = self._search.edge
        dimness = Dimness(
            edge,
            self._question.inner,
            light,
            amplitude,
            lambda: edge.inside(self._leaving(phase, amplitude)),
        )
        lost = self._of_edge / dimness.ratio(edge.collapse_within) + self._of_cuts / dimness.even
        lost += self._panel.error.value + self.arithmetic
        if lost <= self._question.tol:
            return light
        return self._otherwise.intensity(phase, amplitude)

    def _leaving(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        shape = self._camera.panel.shape
        factor = self.modulation(phase, amplitude, shape, torch.complex64)
        return torch.ones(shape, dtype=torch.complex64) if factor is None else factor

    @cached_property
    def _otherwise(self) -> GridEngine:
        """The whole chain, for a window that gets less light than the stop's edge may scatter."""
        chain = GridEngine(self._question, self._camera, self._search)
        chain.prepare()
        return chain


def collapses(camera: Camera) -> bool:
    """Whether a thin lens at the panel may stand for a camera: one without aberrations, whose
    panel isn't too near to the plane in focus."""
    return camera.lens.quadratic and camera.lever >= LEAST_LEVER * camera.lens.image_distance


def _collapsed_question(question: Question, camera: Camera, tol: float) -> Question:
    """The same question of the thin lens at the panel.

    The point's image lies elsewhere behind the moved stop, if it is blurred: the chief ray
    through the panel's middle meets the sensor at field (1 - lever (d + z1) / (d z2)) off the
    one through the lens, that is -field z1 (1 + z1/d) (1/(d + z1) - 1/F).
    """
    thin = collapsed(camera, question.distance, question.numeric.field)
    # V (1 + z1/d) z1, and 1 + z1/d = (d + z1) / d.
    moved = vergence_error(question.lens, question.from_lens) * question.spread
    moved = moved * question.separation
    centre = tuple(
        c - f * moved if as_number(f) or isinstance(f, torch.Tensor) else c
        for c, f in zip(question.samples.centre, question.field, strict=True)
    )
    samples = question.samples
    plane = Plane(samples.shape, samples.pitch, (centre[0], centre[1]))
    nothing = (0.0, 0.0)
    return replace(question, lens=thin.lens, samples=plane, tol=tol, separation=0.0, field=nothing)
