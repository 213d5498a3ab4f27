"""A coarser panel for the first iterations, and the exact way back to all pixels."""

from __future__ import annotations

import functools
import math

import torch

from optics.retrieval.far_field import FarField
from optics.retrieval.goal import RetrievalGoal

_ROOM = 1.5
"""Samples of the coarse far field over those of the window: what a phase-only panel scatters
beyond the window must not come back into it."""

_LARGEST = 16
_LEAST_SIDE = 8
"""Superpixels along the panel's shorter side, at least."""


def superpixel_side(goal: RetrievalGoal) -> int:
    """The largest side of superpixels, in pixels, that the goal's window allows."""
    length, window = goal.far_field_samples, max(goal.plane.shape)
    shortest = min(goal.camera.panel.shape)
    sides = [
        side
        for side in range(1, _LARGEST + 1)
        if length % side == 0
        and length // side >= _ROOM * window
        and (side == 1 or shortest // side >= _LEAST_SIDE)
    ]
    return max(sides, default=1)


class Superpixels:
    """A panel of superpixels, side x side pixels each, for the same far-field window.

    The light that goes into a small window changes slowly over the panel, so that samples that
    lie `side` pixels apart describe it: the same grid in the far field, a side² of the work.
    shape: (rows, columns) of superpixels; the last ones may reach beyond the panel.
    """

    def __init__(self, goal: RetrievalGoal, side: int) -> None:
        self.goal, self.side = goal, side
        rows, columns = goal.camera.panel.shape
        self.shape = (math.ceil(rows / side), math.ceil(columns / side))
        self.far_field = FarField(self.shape, goal.far_field_samples // side, goal.plane.shape)

    @functools.cached_property
    def amplitude(self) -> torch.Tensor:
        """The mean amplitude of each superpixel's pixels, float32."""
        (rows, columns), side = self.shape, self.side
        full = self.goal.amplitude
        margins = (0, columns * side - full.shape[1], 0, rows * side - full.shape[0])
        padded = torch.nn.functional.pad(full, margins)
        return padded.reshape(rows, side, columns, side).mean(dim=(1, 3))

    @functools.cached_property
    def uneven_amplitude(self) -> torch.Tensor | None:
        """The amplitude, or None where it is the same everywhere."""
        amplitude = self.amplitude
        return None if bool((amplitude == amplitude.flatten()[0]).all()) else amplitude

    @functools.cached_property
    def target_intensity(self) -> torch.Tensor:
        """The target with all the light of the superpixels, (rows, columns), float32."""
        power = float(self.amplitude.double().square().sum()) * self.far_field.length**2
        target = self.goal.target
        return (target / target.sum() * power).to(torch.float32)

    def positions(self, axis: int) -> torch.Tensor:
        """Middles of the superpixels along an axis, in pixels from the panel's middle."""
        n = self.shape[axis]
        middle = (self.goal.camera.panel.shape[axis] - 1) / 2
        index = torch.arange(n, dtype=torch.float64) * self.side + (self.side - 1) / 2
        return index - middle

    def panel_field(self, phase: torch.Tensor) -> torch.Tensor:
        """The field of a phase (…, rows, columns), complex64."""
        return torch.polar(self.amplitude.expand(phase.shape), phase.to(torch.float32))

    def to_pixel_origin(self, window: torch.Tensor) -> torch.Tensor:
        """The field on the window, with the origin of all pixels instead of the superpixels'.

        The first superpixel's middle lies (side - 1) / 2 pixels from the first pixel.
        """
        return window * self._origin_shift_phasor(-1)

    def to_superpixel_origin(self, window: torch.Tensor) -> torch.Tensor:
        """The other way: from the origin of all pixels to that of the superpixels."""
        return window * self._origin_shift_phasor(1)

    def _origin_shift_phasor(self, sign: int) -> torch.Tensor:
        """The phase over the window by which a shift of the pupil's origin is seen."""
        turns = []
        for n in self.goal.plane.shape:
            index = torch.arange(n, dtype=torch.float64) - n // 2
            turns.append(sign * math.pi * (self.side - 1) / self.goal.far_field_samples * index)
        both = turns[0][:, None] + turns[1]
        return torch.polar(torch.ones_like(both), both).to(torch.complex64)

    def pixel_phases(self, window: torch.Tensor) -> torch.Tensor:
        """Phases of all pixels, (…, rows, columns) float32, for fields on the window.

        Exact: the window's field is band-limited, and is evaluated anew at every pixel.
        """
        fields = self.to_pixel_origin(window).reshape(-1, *self.goal.plane.shape)
        # One after the other: the padded spectra of many frames would fill the memory.
        phases = torch.stack([torch.angle(self.goal.far_field.adjoint(field)) for field in fields])
        return phases.reshape(*window.shape[:-2], *self.goal.camera.panel.shape)


def coarsest_superpixels(goal: RetrievalGoal) -> Superpixels:
    """The largest superpixels that lose nothing of the goal's window."""
    return Superpixels(goal, superpixel_side(goal))
