"""The light of a lens that looks the same in all directions around its axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.special
import torch

from optics.accuracy import ErrorEstimate, MachineSpeed, unkeepable
from optics.point.engine import Engine, Lit, double_arithmetic
from optics.point.question import Question
from optics.psf.rim import rim_field, rim_nodes
from optics.psf.truth import MARGIN
from optics.pupil import wave_phase
from optics.stop.quadrature import line_rule, nodes_in

_OVERSAMPLING = 2.0
"""Of the field along the radius, over its Nyquist rate."""

_PROBES = 64
_CHUNK = 1 << 23


class AxialEngine(Lit, Engine):
    """A Hankel transform, and a windowed sinc from its radii to the radius of every sample.

    Around the axis the two-dimensional integral (thesis Eq. 2.13) is

        U(s) = 2 pi integral of exp(i phase(r)) J0(2 pi r s / (wavelength z)) r dr,

    summed by Gauss-Legendre nodes on evenly spaced radii s. The field has no finer detail
    along s than the stop's diameter gives it, so a Kaiser-windowed sinc carries it further
    (Kaiser 1974). Far out of focus, where a matrix would grow without end, the field of a
    thin lens comes from an integral along the stop's rim instead.
    """

    precision = "float64"

    def __init__(self, question: Question) -> None:
        if not self.serves(question):
            raise ValueError(
                "method is 'axial'; it serves round stops and aberrations only, and no derivatives "
                "that move the light on the samples"
            )
        self._question = question
        q = question.numeric
        self.arithmetic = double_arithmetic(q)
        self._size = _Size.of(q)
        self._along_rim = not question.differentiable and _prefers_rim(q, self._size)
        self.name = "rim integral" if self._along_rim else "Hankel transform"

    @staticmethod
    def serves(question: Question) -> bool:
        """Whether stop and aberrations are round, and no derivative moves the light."""
        lens = question.lens
        round_ = all(m == 0 for _, m, _ in lens.aberrations)
        return lens.stop.rings is not None and round_ and not question.stretches

    @property
    def bytes(self) -> int:
        return self._size.bytes(self._along_rim)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self._size.cpu_seconds(speed, self._along_rim)

    def prepare(self) -> None:
        q = self._question.numeric
        y, x = q.samples.mesh()
        radius, self._place = torch.unique(torch.hypot(y, x), return_inverse=True)
        self._size.radii = radius.numel()
        spacing = self._size.spacing
        self._taps, self._weights = _interpolation(radius.numpy() / spacing, self._size.reach)
        sensor = np.arange(self._size.sums, dtype=np.float64) * spacing
        if self._along_rim:
            self._kept_field = torch.from_numpy(rim_field(q, sensor))
            self.sampling = f"{rim_nodes(q, q.tol)} nodes on the rim, {sensor.size} radii"
        else:
            self._r, self._w = _rule(q, 1.0)
            bessel = scipy.special.j0(np.outer(sensor, self._r.numpy()) * (_kernel(q)))
            self._field = torch.from_numpy(bessel) * self._w
            self.sampling = f"{self._r.numel()} radii in the stop, {sensor.size} on the sensor"
        self.error = self._probed(radius)
        if not self.error.value + self.arithmetic <= q.tol:
            raise unkeepable(q.tol, 1.2 * self.error.value + self.arithmetic)

    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Along one ray; a phase there is one around the axis."""
        if self._along_rim:
            empty = torch.zeros(0, dtype=torch.float64)
            return empty, empty
        return torch.zeros_like(self._r), self._r * self._question.numeric.radius

    def _made_wave(self) -> torch.Tensor:
        q = self._question
        phase = wave_phase(q.lens, q.distance, q.wavelength, torch.zeros_like(self._r), self._r)
        return torch.polar(torch.ones_like(phase), phase)

    def intensity(self, phase: torch.Tensor | None, amplitude: torch.Tensor | None) -> torch.Tensor:
        if self._along_rim:
            if phase is not None or amplitude is not None:
                raise ValueError(
                    "so far out of focus, a round lens takes no extra phase or amplitude; give it "
                    "aberrations, or bring the object closer to the plane in focus"
                )
            parts = torch.view_as_real(self._kept_field)
        else:
            wave = self._wave()
            factor = self.modulation(phase, amplitude, (self._r.numel(),))
            self.require_slope(phase)
            wave = wave if factor is None else wave.to(factor.device) * factor
            parts = self._summed(wave)
        return self._on_radii(parts)[..., self._place] * self._question.share

    def _summed(self, wave: torch.Tensor) -> torch.Tensor:
        """(..., sums, 2) from (..., radii)."""
        matrix = self._field.to(wave.device)
        return (torch.view_as_real(wave).mT @ matrix.mT).mT

    def _on_radii(self, parts: torch.Tensor) -> torch.Tensor:
        """Intensity on every radius of the samples, from the field's two parts."""
        taps, weights = self._taps.to(parts.device), self._weights.to(parts.device)
        near = (parts[..., taps, :] * weights[..., None]).sum(-2)
        return near[..., 0] ** 2 + near[..., 1] ** 2

    def _probed(self, radius: torch.Tensor) -> ErrorEstimate:
        """The answer against more nodes and no interpolation, on some of its radii."""
        q = self._question.numeric
        times = torch.bincount(self._place[q.inner].ravel(), minlength=radius.numel())
        seen = torch.nonzero(times).ravel()
        count = min(_PROBES, seen.numel())
        if self._along_rim:
            count = min(count, max(4, _CHUNK // rim_nodes(q, q.tol)))
        chosen = seen[torch.linspace(0, seen.numel() - 1, count).round().long()]
        if self._along_rim:
            truth = np.abs(rim_field(q, radius[chosen].numpy(), finer=1.5)) ** 2
        else:
            r, w = _rule(q, 1.5)
            bessel = scipy.special.j0(np.outer(radius[chosen].numpy(), r.numpy()) * _kernel(q))
            phase = wave_phase(q.lens, q.distance, q.wavelength, torch.zeros_like(r), r)
            truth = np.abs((bessel * w.numpy()) @ np.exp(1j * phase.numpy())) ** 2
        with torch.no_grad():
            kept = self._kept_field if self._along_rim else None
            parts = self._summed(self._wave()) if kept is None else torch.view_as_real(kept)
            value = self._on_radii(parts)[chosen].numpy()
        # Each radius counts as often as there are samples on it.
        often = times[chosen].numpy()
        error = math.sqrt(float((often * (value - truth) ** 2).sum()))
        size = math.sqrt(float((often * truth**2).sum()))
        how = f"measured on {count} radii against a finer rule"
        return ErrorEstimate(MARGIN * error / size if size > 0 else math.inf, how)


def _kernel(q: Question) -> float:
    """Radians per metre on the sensor and stop radius in the pupil."""
    return 2 * math.pi * q.radius / q.scale


def _rule(q: Question, finer: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Radii in the pupil, in stop radii, and the weights of an integral over the open area."""
    assert q.lens.stop.rings is not None
    inner, outer = q.lens.stop.rings
    t, weight = line_rule(outer - inner, finer * _slope(q), q.tol)
    radii = inner + (outer - inner) * t
    area = 2 * np.pi * (outer - inner) * weight * radii
    return torch.from_numpy(radii), torch.from_numpy(area)


def _slope(q: Question) -> float:
    return q.steepness.radial(1.0) + q.steepness.tilt


def _interpolation(position: np.ndarray, reach: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Which radii the field at each position is made of, and their weights; it is even."""
    first = np.floor(position).astype(np.int64) - reach + 1
    taps = first[:, None] + np.arange(2 * reach)
    away = position[:, None] - taps
    window = np.sqrt(np.clip(1 - (away / reach) ** 2, 0, None))
    beta = math.pi * reach * (1 - 1 / _OVERSAMPLING)
    kernel = np.sinc(away) * np.i0(beta * window) / np.i0(beta)
    return torch.from_numpy(np.abs(taps)), torch.from_numpy(kernel)


@dataclass
class _Size:
    """What a Hankel transform or a rim integral takes.

    nodes: in the pupil. spacing: metres between the radii that the field is summed on;
    sums: their number. reach: of the interpolation. radii: different ones among the samples.
    """

    question: Question
    nodes: int
    spacing: float
    sums: int
    reach: int
    radii: int

    @staticmethod
    def of(q: Question) -> _Size:
        assert q.lens.stop.rings is not None
        inner, outer = q.lens.stop.rings
        spacing = q.scale / (2 * _OVERSAMPLING * q.radius * outer)
        reach = _reach(q.tol)
        sums = math.ceil(q.farthest / spacing) + reach + 2
        nodes = nodes_in(outer - inner, _slope(q), q.tol)
        rows, columns = q.samples.shape
        different = rows * columns
        if not any(q.samples.centre):
            # A centred window shows every radius four times, eight with square pixels.
            times = 8 if q.samples.pitch[0] == q.samples.pitch[1] else 4
            different = different // times + rows + columns
        return _Size(q, nodes, spacing, sums, reach, min(different, rows * columns))

    @cached_property
    def samples(self) -> int:
        return self.question.samples.shape[0] * self.question.samples.shape[1]

    def bytes(self, along_rim: bool) -> int:
        rest = 8 * self.radii * self.reach + 6 * self.samples
        return 8 * (rest + (2 * self.sums if along_rim else self.sums * self.nodes))

    def cpu_seconds(self, speed: MachineSpeed, along_rim: bool) -> float:
        sums = 0.0 if along_rim else self.sums * self.nodes * speed.stream
        gathered = 2 * self.radii * self.reach + self.samples / 4
        return speed.call + sums + gathered * speed.gather


def _prefers_rim(q: Question, size: _Size) -> bool:
    """Where the rim has far fewer nodes than the stop has along its radius."""
    if not q.lens.quadratic:
        return False
    return size.nodes * size.sums > _CHUNK and size.nodes > 2 * rim_nodes(q, q.tol)


def _reach(tol: float) -> int:
    """Samples on either side that the interpolation needs: Kaiser's formula, in decibels."""
    attenuation = 40 - 20 * math.log10(tol)
    return math.ceil((attenuation - 8) / (2 * 2.285 * 2 * math.pi * (1 - 1 / _OVERSAMPLING))) + 2
