"""Write a lens' phase as a parabola and a short sum of products of functions of y and of x."""

from __future__ import annotations

import math
from functools import cached_property

import torch

from optics.accuracy import ToleranceError
from optics.camera.pupil import defocus_curvature, defocus_path, vergence_error
from optics.psf.request import PSFRequest
from optics.zernike import zernike

_NODES = (24, 48, 96, 192, 384)
"""Chebyshev nodes per axis that are tried for what a lens' phase has beside its parabola."""

_LEAST = 1e-15
"""Share of the strongest term below which terms are rounding errors."""

_TAIL = 1e-12
"""Coefficient of the highest orders below which an expansion counts as complete."""

_SAMPLES, _MARGIN = 33, 1.2
"""Samples per axis for the slope of a phase, and a factor, because it might be steeper between."""

_TERMS, _TERMS_PER_RADIAN = 6, 0.55
"""Terms that a phase takes, and further ones for its largest value; fitted to random lenses."""


Spans = tuple[tuple[float, float], tuple[float, float]]
"""Low and high (y, x) of a stop's opening, in stop radii."""


class SplitPhase:
    """Holds a lens' wave exp(i phase), split between y and x.

    With the parabola's curvature c in radians per square stop radius, the wave is exp(i c (y² +
    x²)) times the sum over k of g_k(y) h_k(x). The smooth remainder of aberrations, and of a
    stigmatic lens, has few terms to double precision. They are predicted when the split is planned,
    and found at its first use.

    curvature: c.
    terms: their number, predicted.
    slope: the steepest slope of the remainder's phase, radians per stop radius.
    """

    def __init__(self, n: PSFRequest, spans: Spans) -> None:
        self._n, self._spans = n, spans
        curvature = defocus_curvature(n.lens, n.object_to_lens_distance, n.wavelength)
        self.curvature, self.terms, self.slope = curvature * n.radius**2, 1, 0.0
        if n.lens.has_quadratic_phase:
            return
        y, x = (torch.linspace(*span, _SAMPLES, dtype=torch.float64) for span in spans)
        phase = _remaining_phase(n, y[:, None], x[None, :]).expand(_SAMPLES, _SAMPLES)
        down, along = (
            float(phase.diff(dim=axis).abs().max() / (place[1] - place[0]))
            for axis, place in enumerate((y, x))
        )
        self.slope = _MARGIN * max(down, along)
        self.terms = _TERMS + math.ceil(_TERMS_PER_RADIAN * float(phase.max() - phase.min()))

    def prepare(self) -> None:
        """Find the terms; raise ToleranceError for aberrations of too many waves."""
        if not self._n.lens.has_quadratic_phase:
            self.terms = self._factors[0].shape[1]

    def along(self, axis: int, place: torch.Tensor) -> torch.Tensor:
        """Return the terms g, or h, with the parabola's phase at places in stop radii, (n, terms).

        axis: 0 for y, 1 for x.
        """
        angle = torch.remainder(self.curvature * place**2, 2 * math.pi)
        wave = torch.polar(torch.ones_like(angle), angle)[:, None]
        if self._n.lens.has_quadratic_phase:
            return wave
        coefficients = self._factors[axis]
        low, high = self._spans[axis]
        t = ((2 * place - low - high) / (high - low)).clamp(-1, 1)
        order = torch.arange(coefficients.shape[0], dtype=torch.float64)
        polynomials = torch.cos(torch.acos(t)[:, None] * order).to(coefficients)
        return wave * (polynomials @ coefficients)

    @cached_property
    def _factors(self) -> tuple[torch.Tensor, torch.Tensor]:
        """The Chebyshev coefficients of all terms, (orders, terms), for y and x.

        Raises ToleranceError for aberrations of too many waves.
        """
        for nodes in _NODES:
            found = self._expansion(nodes)
            last = nodes * 3 // 4
            if max(float(found[last:].abs().max()), float(found[:, last:].abs().max())) <= _TAIL:
                left, strength, right = torch.linalg.svd(found)
                kept = int((strength > _LEAST * strength[0]).sum())
                return left[:, :kept] * strength[:kept].to(left), right[:kept].mT
        raise ToleranceError(
            "the lens' aberrations turn too fast to be split between the axes of its stop"
        )

    def _expansion(self, nodes: int) -> torch.Tensor:
        """Expand the wave, without its parabola, in Chebyshev polynomials."""
        angle = math.pi * (torch.arange(nodes, dtype=torch.float64) + 0.5) / nodes
        y, x = ((low + high) / 2 + (high - low) / 2 * torch.cos(angle) for low, high in self._spans)
        phase = _remaining_phase(self._n, y[:, None], x[None, :]).expand(nodes, nodes)
        order = torch.arange(nodes, dtype=torch.float64)
        weight = (2 - (order == 0).to(order)) / nodes
        there = (torch.cos(order[:, None] * angle) * weight[:, None]).to(torch.complex128)
        return there @ torch.polar(torch.ones_like(phase), phase) @ there.mT


def _remaining_phase(n: PSFRequest, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Return the phase of the lens beside its parabola, in radians; y, x in stop radii."""
    lens, distance = n.lens, n.object_to_lens_distance
    path = torch.zeros((), dtype=torch.float64)
    if lens.kind != "thin":
        r2 = (y**2 + x**2) * n.radius**2
        path = defocus_path(lens, distance, r2) - vergence_error(lens, distance) / 2 * r2
    for order, cycles, strength in lens.aberrations:
        path = path + strength * zernike(order, cycles, y, x)
    return 2 * math.pi / n.wavelength * path
