"""The chain of panel, space, stop, space and sensor on grids, by FFTs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import torch

from optics.accuracy import FLOAT32_ARITHMETIC, ErrorEstimate, MachineSpeed, unkeepable
from optics.chain.engine import ChainEngine
from optics.chain.lens_grid import lens_grid
from optics.chain.lens_pass import LensPass, passed_through, spectrum_of
from optics.chain.lens_wave import LensWave
from optics.chain.openings import Openings
from optics.chain.relay import Relay, RelayAxis, relayed
from optics.chain.relay_axes import lens_plane, relay_axes
from optics.fourier import Geometry, unit_phasor
from optics.fourier.gridded import FINEST_GRIDDING
from optics.point.question import Question
from optics.pupil import defocus_curvature, wave_phase
from optics.stop.coverage import coverage

_GRID_SHARE, _TRANSFORM_SHARE = 0.92, 0.02
"""Of the tolerance: what the grid may leave out, and what a transform may add in the field."""

_WAVE_ROOM = 0.25
"""Of the memory allowed, what an aberrated lens' wave may take to be kept."""


class GridEngine(ChainEngine):
    """The lens' plane on a grid: FFTs from the panel, the stop's covered area, FFTs onward.

    Light of frequencies that reach no more than the stop's edge is left out as far as the
    tolerance allows; see `lens_grid`.
    """

    name = "chain"

    def _plan(self, n: Question) -> None:
        self._set_precision(0.1 * n.tol < FLOAT32_ARITHMETIC)
        rough = self._sphere_error()
        allowed = _GRID_SHARE * n.tol - rough
        if not allowed > 0:
            raise unkeepable(n.tol, 1.1 * (rough + 0.2 * n.tol))
        self._grid = lens_grid(n, self._camera, self._search, allowed)
        self._settle(relay_axes(n, self._camera, self._grid))
        left_out = self._grid.error + rough + 2 * self._pass.onward.error
        self.error = ErrorEstimate(left_out, "estimate, for an evenly lit panel")

    def _settle(self, axes: list[RelayAxis]) -> None:
        self.relay = Relay(axes[0], axes[1], self._dtype)
        self._plane = lens_plane(self._question.numeric, axes)
        self._pass = self._planned_pass()
        self._lens_wave = self._planned_wave()
        rows, columns = self._plane.shape
        self.sampling = f"{columns}x{rows} samples at the lens"

    @property
    def takes_spectra(self) -> bool:
        """Whether a spectrum of the panel's modulation is all it needs."""
        return not self._question.differentiable and self._question.sphere is None

    def settle(self, lengths: Sequence[int], held: Sequence[tuple[float, float]]) -> None:
        """Take spectra that other engines take as well, of FFTs so long that hold frequencies
        (first, last) in cycles per metre along each axis; before prepare()."""
        axes = relay_axes(self._question.numeric, self._camera, self._grid, lengths)
        self._settle(
            [
                replace(axis, shared=(math.ceil(a * axis.period), math.floor(b * axis.period)))
                for axis, (a, b) in zip(axes, held, strict=True)
            ]
        )

    def _planned_wave(self) -> LensWave | None:
        """What of the lens' wave isn't a product along y and x; derivatives make their own."""
        n = self._question.numeric
        if n.lens.quadratic or self._question.differentiable:
            return None
        room = _WAVE_ROOM * n.budget.memory
        return LensWave(partial(_phase, n), self._plane, self._dtype, room)

    def _planned_pass(self) -> LensPass:
        n, lens = self._question.numeric, self._camera.lens
        real = torch.zeros((), dtype=self._dtype).real.dtype
        openings = Openings(lens.stop, n.radius, self._plane, real)
        error = max(_TRANSFORM_SHARE * n.tol, FINEST_GRIDDING)
        geometry = Geometry(self._plane, n.samples, n.scale)
        return LensPass(self.relay, openings, geometry, error, n.budget)

    @property
    def bytes(self) -> int:
        rows, columns = self._plane.shape
        dense = 6 * self._dtype.itemsize * rows * columns if self._question.differentiable else 0
        panel = self._camera.panel.shape
        wave = self._lens_wave.bytes if self._lens_wave else 0
        return self._pass.bytes + dense + wave + 40 * panel[0] * panel[1]

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        wave = self._lens_wave.cpu_seconds(speed) if self._lens_wave else 0.0
        return (self._pass.cpu_seconds(speed) + wave) * (3 if self._question.sphere else 1)

    def prepare(self) -> None:
        if not self.error.value + self.arithmetic <= self._question.tol:
            raise unkeepable(self._question.tol, self.error.value + self.arithmetic)
        if not self._question.differentiable:
            if self._lens_wave:
                self._lens_wave.prepare()
            self._pass.light_up(self._turns(), self._lens_wave)

    def _turns(self) -> tuple[torch.Tensor, torch.Tensor]:
        """The lens' wave along y and x, of one that is their product."""
        n = self._question.numeric
        if not n.lens.quadratic:
            y, x = (torch.ones(count, dtype=torch.complex128) for count in self._plane.shape)
            return y, x
        curvature = defocus_curvature(n.lens, n.from_lens, n.wavelength) / (2 * math.pi)
        y, x = (
            unit_phasor(curvature * self._plane.coordinates(axis) ** 2, torch.complex128)
            for axis in (0, 1)
        )
        return y, x

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        modulated = self.modulated(phase, amplitude)
        if not modulated.numel():
            return self.none(modulated)
        spectrum: Callable[[], torch.Tensor]
        if self._question.differentiable:
            field = self._moving(self.relay, modulated)
            spectrum = partial(self.relay.spectrum, modulated.detach())
        else:
            known = spectrum_of(self.relay, modulated)
            field, spectrum = passed_through(self._pass, known), known.detach
        for axis, part in self.leaning(modulated):
            field = field + self._at_sensor(self._leaning_relay(axis), part)
        return self._light(field, phase, amplitude, spectrum)

    def _leaning_relay(self, axis: int) -> Relay:
        axes = [replace(one, leaning=k == axis) for k, one in enumerate(self.relay.axes)]
        return Relay(axes[0], axes[1], self._dtype)

    def _at_sensor(self, relay: Relay, field: torch.Tensor) -> torch.Tensor:
        """The sum over the lens' samples, of a panel's field by one of the relays."""
        if self._question.differentiable:
            return self._moving(relay, field)
        return passed_through(self._pass.behind(relay), spectrum_of(relay, field))

    def of_spectrum(
        self, spectrum: torch.Tensor, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> torch.Tensor:
        """intensity() of a panel whose spectrum is known already."""
        field = passed_through(self._pass, spectrum)
        return self._light(field, phase, amplitude, spectrum.detach)

    def _moving(self, relay: Relay, field: torch.Tensor) -> torch.Tensor:
        """_at_sensor() with derivatives in all lengths."""
        q = self._question
        turns = _phase(q, *self._plane.mesh()) / (2 * math.pi)
        wave = unit_phasor(turns, self._dtype)
        wave = wave * coverage(self._camera.lens.stop, q.numeric.radius, self._plane)
        field = relayed(relay, field, self._moved()) * wave.to(self._dtype).to(field.device)
        moved = q.derivatives
        return self._pass.onward(field, moved.stretch, moved.shift)

    def _light(
        self,
        field: torch.Tensor,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        spectrum: Callable[[], torch.Tensor],
    ) -> torch.Tensor:
        """spectrum: of the panel, without derivatives; only a dim window asks for it."""
        cell = self._plane.pitch[0] * self._plane.pitch[1] / self._question.numeric.radius**2
        light = (field.real**2 + field.imag**2) * (self.strength() * cell**2)
        light = light.to(torch.float64 if self._dtype == torch.complex128 else torch.float32)

        def inside() -> tuple[float, float]:
            low, high = (end.tolist() for end in self._edge.passing)
            power = self.relay.power(spectrum(), low, high)
            rows, columns = self._camera.panel.shape
            sent: Any = rows * columns
            if amplitude is not None:
                sent = (amplitude.detach().abs() ** 2).sum(dim=(-2, -1)).clamp(min=1e-300)
            found = power / sent
            return float(found.min()), float(found.max())

        return self._kept(light, phase, amplitude, inside)

    @cached_property
    def _within(self) -> float:
        return self._search.within(self._grid)


def _phase(q: Question, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Radians of the lens' wave at places in its plane, metres."""
    radius = q.numeric.radius
    return wave_phase(q.lens, q.from_lens, q.wavelength, y / radius, x / radius)
