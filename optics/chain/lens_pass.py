"""From a panel's spectrum through the stop to the sensor, a few rows of the lens at a time."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator

import torch

from optics.accuracy import Budget, MachineSpeed, cheapest
from optics.chain.lens_wave import LensWave
from optics.chain.openings import Openings
from optics.chain.relay import Relay
from optics.fourier import Geometry, transforms
from optics.fourier.separable import SeparableTransform
from optics.fourier.transform import linear

Picturewise = Callable[[torch.Tensor], torch.Tensor]


class LensPass:
    """A linear map from a panel's field to samples at the sensor, and its adjoint.

    The lens' plane never stands in memory as a whole: space to the lens, the stop, the lens and
    the Fourier integral onward all work along one axis after the other, but for the stop's
    edge and for aberrations. So each block of rows goes all the way along x before the next.

    turn_y, turn_x: the lens' wave along each axis. wave: what of it isn't their product, at the
    lens' samples, or None. geometry: of the Fourier integral from the lens.
    """

    def __init__(
        self,
        relay: Relay,
        openings: Openings,
        geometry: Geometry,
        error: float,
        budget: Budget,
    ) -> None:
        self.relay, self._openings = relay, openings
        offered = transforms(geometry, relay.dtype, error)
        separable = [one for one in offered if isinstance(one, SeparableTransform)]
        self.onward = cheapest(separable, budget, "light from the lens to the sensor")
        self._turn: tuple[torch.Tensor, torch.Tensor] | None = None
        self._wave: LensWave | None = None

    def light_up(
        self, turn: tuple[torch.Tensor, torch.Tensor], wave: LensWave | None = None
    ) -> None:
        """Set the lens' wave: its factors along y and x, and what isn't their product."""
        geometry, dtype = self.onward.geometry, self.relay.dtype
        tilts = [geometry.pupil_tilt(axis, torch.complex128) for axis in (0, 1)]
        y, x = (
            (factor if tilt is None else factor * tilt).to(dtype)[:, None]
            for factor, tilt in zip(turn, tilts, strict=True)
        )
        self._turn, self._wave = (y, x), wave
        self._after = tuple(geometry.image_tilt(axis, dtype) for axis in (0, 1))

    def behind(self, relay: Relay) -> LensPass:
        """The same behind another relay to the same samples."""
        other = copy.copy(self)
        other.relay = relay
        return other

    def _lines(self, device: torch.device) -> tuple[torch.Tensor, torch.Tensor]:
        assert self._turn is not None
        y, x = self._turn
        return y.to(device), x.to(device)

    def __call__(self, spectrum: torch.Tensor) -> torch.Tensor:
        """The field at the sensor, (rows, columns) of samples, of one panel's spectrum."""
        y_rule, x_rule = self.onward.prepared(spectrum.device)
        turn_y, _ = self._lines(spectrum.device)
        found = spectrum.new_empty((self.onward.image.shape[1], self.relay.shape[0]))
        for rows, field in self._fields(spectrum):
            found[:, rows] = x_rule.forward(field.mT.contiguous())
        if self._after[1] is not None:
            found *= self._after[1].to(found.device)[:, None]
        field = y_rule.forward(found.mT * turn_y)
        return field if self._after[0] is None else field * self._after[0].to(field.device)[:, None]

    def _fields(self, spectrum: torch.Tensor) -> Iterator[tuple[slice, torch.Tensor]]:
        """Behind the stop, block by block, (rows, columns); without the wave along y."""
        turn_x = self._lines(spectrum.device)[1][:, 0]
        arriving = self.relay.arriving(spectrum, self._openings.rows)
        for block, (rows, field) in enumerate(arriving):
            field *= turn_x
            if self._wave is not None:
                field *= self._wave.rows(rows).to(field.device)
            self._openings.apply(field, block)
            yield rows, field

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """The conjugate transpose: a panel's spectrum from a field at the sensor."""
        field = field.to(self.relay.dtype)
        y_rule, x_rule = self.onward.prepared(field.device)
        turn_y, turn_x = (line.conj().resolve_conj() for line in self._lines(field.device))
        y_axis, x_axis = self.relay.axes
        y_transfer, x_transfer = self.relay.transfers(field.device)
        if self._after[0] is not None:
            field = field * self._after[0].to(field.device).conj()[:, None]
        back = (y_rule.adjoint(field) * turn_y).mT
        if self._after[1] is not None:
            back = back * self._after[1].to(field.device).conj()[:, None]
        lines = field.new_empty((y_axis.count, x_axis.kept))
        for block, rows in enumerate(self._openings.rows):
            part = x_rule.adjoint(back[:, rows].contiguous()).mT * turn_x[:, 0]
            if self._wave is not None:
                part *= self._wave.rows(rows).to(field.device).conj()
            self._openings.apply(part, block)
            lines[rows] = x_axis.to_lens_adjoint(part, x_transfer, -1)
        return y_axis.to_lens_adjoint(lines, y_transfer, -2)

    @property
    def bytes(self) -> int:
        y, x = self.relay.axes
        rows, columns = self.onward.image.shape
        between = x.kept * y.count + columns * y.count + rows * columns
        spectrum = x.kept * (y.kept + y.length + y.fold)
        block = 6 * 16 * max(x.fold, x.count)
        return self.relay.dtype.itemsize * (2 * between + spectrum + block)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self.relay.cpu_seconds(speed) + self.onward.cpu_seconds(speed)


def spectrum_of(relay: Relay, field: torch.Tensor) -> torch.Tensor:
    """A panel's spectrum, (..., y, x); differentiable in its field."""
    return linear(relay.spectrum, relay.spectrum_adjoint, field)


def passed_through(lens_pass: LensPass, spectrum: torch.Tensor) -> torch.Tensor:
    """The field at the sensor, (..., rows, columns), of a panel's spectrum; differentiable."""
    return linear(_one_by_one(lens_pass), _one_by_one(lens_pass.adjoint), spectrum)


def _one_by_one(function: Picturewise) -> Picturewise:
    """One picture at a time: a batch takes no more memory than its answers."""

    def each(fields: torch.Tensor) -> torch.Tensor:
        if fields.ndim == 2:
            return function(fields)
        done = torch.stack([function(one) for one in fields.reshape(-1, *fields.shape[-2:])])
        return done.reshape(*fields.shape[:-2], *done.shape[-2:])

    return each
