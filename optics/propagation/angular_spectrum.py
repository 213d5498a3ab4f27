"""Transfer-function methods between planes: exact, Fresnel's, and to a tilted target."""

from __future__ import annotations

import math

import torch

from optics.accuracy import MachineSpeed
from optics.fourier import FourierGeometry, NonuniformTransform, plan_transform, unit_phasor
from optics.fourier.nonuniform import FINEST_NUFFT, nonuniform_bytes, nonuniform_seconds
from optics.plane import Plane
from optics.propagation.band import FrequencyBand, resolved_band
from optics.propagation.spectral_propagator import (
    SpectralPropagator,
    times,
    transform_error_share,
)
from optics.propagation.transfer_function import PlaneWaveRays, axial_frequency
from optics.validation import as_number, needs_gradient


class ScaledAngularSpectrum(SpectralPropagator):
    """Use the angular spectrum to reach a plane of any pitch, window and centre.

    The spectrum is computed only at frequencies whose rays reach the target, and the field only
    at the target's samples. Both transforms are the cheapest available ones (chirp-Z, matrices,
    gridding, FFTs).

    Raises ToleranceError if some rays are grazing.
    """

    name = "scaled angular spectrum"

    def _candidate_pitches(self) -> list[tuple[float, float]]:
        source, target = self._numeric_span.source.pitch, self._numeric_span.target.pitch
        y, x = (common_multiple(source[axis], target[axis]) or source[axis] for axis in (0, 1))
        return list(dict.fromkeys([source, target, (y, x)]))


class BandLimitedAngularSpectrum(SpectralPropagator):
    """Use the band-limited angular spectrum between planes of one pitch.

    Matsushima and Shimobaba (2009, 10.1364/OE.17.019662) cut the spectrum where the transfer
    function is sampled too coarsely. Here the cut follows from the target, and the period, to which
    FFTs are padded, from the cut, so that the error is bounded (optics.propagation.band).

    Raises ValueError for planes of two pitches, and ToleranceError if some rays are grazing.
    """

    name = "band-limited angular spectrum"
    commensurate = True

    def _require_applicable(self) -> None:
        super()._require_applicable()
        pitches = self.span.source.pitch, self.span.target.pitch
        if not all(abs(p - q) <= 1e-12 * p for p, q in zip(*pitches, strict=True)):
            raise ValueError(
                f"{self.name} serves planes of one pitch, and they are {pitches[0]} and "
                f"{pitches[1]} m; use the scaled angular spectrum"
            )


class AngularSpectrum(BandLimitedAngularSpectrum):
    """Use the plain angular spectrum for a smooth field (section 3.10 of Goodman).

    All frequencies that the samples resolve take part, without a taper. The FFTs are padded until
    light that wraps around misses the target, so their length grows with the lateral displacement
    of the steepest rays. The method suits planes of one pitch that are close together.

    Raises ValueError for cells, whose edges diffract light to all angles, and for planes of two
    pitches. Raises ToleranceError if some rays of the field's band are grazing.
    """

    name = "angular spectrum"

    def _require_applicable(self) -> None:
        if self.span.cells is not None:
            raise ValueError(f"{self.name} serves smooth fields; cells have sharp edges")
        super()._require_applicable()

    def _build_band(self) -> FrequencyBand:
        return resolved_band(self.span)

    def _count(self, steps: float) -> int:
        """Return the number of frequencies of the FFT; the band's two ends are one frequency."""
        return max(round(steps), 1)


def common_multiple(first: float, second: float) -> float:
    """Return the least common multiple of two pitches, or 0 if it exceeds 64 times the first."""
    for parts in range(1, 65):
        ratio = parts * first / second
        if abs(ratio - round(ratio)) < 1e-12 * ratio and round(ratio):
            return parts * first
    return 0.0


class FresnelTransfer(ScaledAngularSpectrum):
    """Use the scaled angular spectrum with Fresnel's transfer function.

    It is H = exp(-i pi wavelength z f²) (section 4.2.3 of Goodman), the product of a function of y
    and one of x, so two lines are kept instead of a plane. The method is valid for the paraxial
    model. For a scalar wave it is valid where its error is below a share of the tolerance.
    """

    name = "Fresnel transfer function"
    paraxial = True

    @property
    def _filter_size(self) -> int:
        return sum(self.frequencies.shape)

    def _build_filter(self, frequencies: Plane) -> torch.Tensor:
        """Compute the filter W along y and along x, joined in one vector."""
        y, x = (frequencies.coordinates(axis) for axis in (0, 1))
        zero = torch.zeros(1, dtype=torch.float64)
        down = self._transfer(y, zero) * self._weight(frequencies, 0)
        along = self._transfer(zero, x) * self._weight(frequencies, 1)
        return torch.cat((down, along)).to(self.dtype)

    def _apply_filter(
        self, spectrum: torch.Tensor, frequencies: Plane, *, back: bool = False
    ) -> torch.Tensor:
        w = self._filter(frequencies, spectrum.device)
        down, along = torch.split(w.conj() if back else w, list(frequencies.shape))
        return times(times(spectrum, down[:, None]), along)


# Time to find a wave's frequencies on the target, in passes over a complex number; measured.
_TOUCHES_PER_WAVE = 150

# Plane waves whose frequencies are found at once, so that they stay in the processor's caches.
_BLOCK_WAVES = 1 << 16


class TiltedAngularSpectrum(SpectralPropagator):
    """Sum plane waves on a tilted target, where each has another spatial frequency.

    A plane wave (f_y, f_x) has the axial frequency w = sqrt(1 / wavelength² - f²). On a target that
    is turned by a and b as FreeSpaceSpan describes, its frequencies are

        f'_y = f_y cos a + f_x sin a sin b + w sin a cos b,
        f'_x = f_x cos b - w sin b.

    Matsushima, Schimmel and Wyrowski (2003, 10.1364/JOSAA.20.001755) interpolate the spectrum
    at regular f'. Here the spectrum is kept at regular f, where it was computed, and the sum over
    its waves is a non-uniform Fourier transform, which needs neither interpolation nor a Jacobian.
    In the paraxial model w is 1 / wavelength - wavelength f² / 2.

    Raises ValueError for a target that intersects the source's plane, and ToleranceError if some
    rays are grazing.
    """

    name = "tilted angular spectrum"
    search_calls = 40

    def _require_applicable(self) -> None:
        # Raises ValueError where the tilt turns the target through the source's plane.
        self.span.nearest_target_distance()
        self.paraxial = self.span.paraxial

    def _plan(self) -> float:
        n = self._numeric_span
        self.frequencies = self._frequencies(n.source.pitch)
        rows, columns = self.frequencies.shape
        self._frequency_count = rows * columns
        self._require_memory(3 * self.dtype.itemsize * (float(rows) * columns))
        geometry = FourierGeometry(n.source, self.frequencies, 1.0)
        self._to_spectrum = plan_transform(
            geometry, self.dtype, n.budget, error=transform_error_share(n)
        )
        self._nufft_error = max(transform_error_share(n), FINEST_NUFFT)
        # The plane is centred at 0, because the waves' phases refer to the target's centre.
        self._image = Plane(n.target.shape, n.target.pitch)
        self._cached_nufft: NonuniformTransform | None = None
        return self._to_spectrum.error + self._nufft_error

    def _propagating_indices(self) -> torch.Tensor:
        """Return the flat indices of the frequencies whose plane waves aren't evanescent.

        Some frequencies beyond the taper may be. In the paraxial model none is.
        """
        y, x = self.frequencies.mesh()
        grazing = PlaneWaveRays(self._numeric_span.wavelength, self.paraxial).grazing_frequency
        if math.hypot(float(y.abs().max()), float(x.abs().max())) < grazing:
            return torch.arange(self._frequency_count)
        return torch.nonzero((torch.sqrt(y**2 + x**2) < grazing).flatten()).squeeze(-1)

    def _tilted_frequencies(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (f'_y, f'_x) on the tilted target, within the range that its samples resolve."""
        all_y, all_x = self._wave_frequencies()
        n, q = self._numeric_span, self._image.pitch
        a, b = n.tilt
        for first in range(0, all_y.numel(), _BLOCK_WAVES):
            block = slice(first, first + _BLOCK_WAVES)
            y, x = all_y[block], all_x[block]
            w = axial_frequency(y, x, n.wavelength, paraxial=self.paraxial)
            turned_y = y * math.cos(a) + x * (math.sin(a) * math.sin(b))
            turned_y = turned_y + w * (math.sin(a) * math.cos(b))
            turned_x = x * math.cos(b) - w * math.sin(b)
            all_y[block] = _wrap_frequency(turned_y, 1 / q[0])
            all_x[block] = _wrap_frequency(turned_x, 1 / q[1])
        return all_y, all_x

    def _wave_frequencies(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (f_y, f_x) of the plane waves that are summed on the tilted target."""
        y, x = (f.expand(self.frequencies.shape).flatten() for f in self.frequencies.mesh())
        return y[self._wave_indices], x[self._wave_indices]

    def prepare(self) -> None:
        super().prepare()
        self._wave_indices = self._propagating_indices()
        y, x = self._tilted_frequencies()
        self._cached_nufft = NonuniformTransform(y, x, self._image, 1.0, self._nufft_error)

    def _transfer(self, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """Return the transfer function to the target's centre, on or off the axis."""
        centre = self._numeric_span.target.centre
        way = unit_phasor(y * centre[0] + x * centre[1], torch.complex128)
        return super()._transfer(y, x) * way

    @property
    def bytes(self) -> int:
        points = self._frequency_count
        # Computing a frequency's position on the tilted plane takes 120 bytes.
        steps = max(self._to_spectrum.bytes, 120 * points) + nonuniform_bytes(points, self._image)
        return self._filter_bytes(self.frequencies) + steps

    def planning_seconds(self, speed: MachineSpeed) -> float:
        waves = _TOUCHES_PER_WAVE * self._frequency_count * speed.touch
        return super().planning_seconds(speed) + self._to_spectrum.planning_seconds(speed) + waves

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        points = self._frequency_count
        sums = 2 if needs_gradient(self.span.wavelength) else 1
        back = nonuniform_seconds(points, self._image, self._nufft_error, speed)
        return self._to_spectrum.cpu_seconds(speed) + self._filter_seconds(speed) + sums * back

    def forward(self, field: torch.Tensor) -> torch.Tensor:
        spectrum = self._apply_filter(self._to_spectrum(field), self.frequencies)
        points = self._target_nufft()
        waves = spectrum.flatten(-2)[..., self._wave_indices.to(field.device)]
        answer = points(waves.conj()).conj()
        if needs_gradient(self.span.wavelength):
            answer = answer + self._wavelength_gradient_term(waves)
        return answer.to(self.dtype).resolve_conj()

    def _target_nufft(self) -> NonuniformTransform:
        if self._cached_nufft is None:
            self.prepare()
        assert self._cached_nufft is not None
        return self._cached_nufft

    def _wavelength_gradient_term(self, waves: torch.Tensor) -> torch.Tensor:
        """Return a zero field that carries a derivative in the wavelength.

        The wavelength changes the axial frequency w. The phase of a wave at the depth Z behind the
        target's centre is 2 pi w Z.
        """
        n, wavelength = self._numeric_span, self.span.wavelength
        y, x = self._wave_frequencies()
        if self.paraxial:
            rate = -1 / n.wavelength**2 - (y**2 + x**2) / 2
        else:
            rate = -1 / (n.wavelength**3 * axial_frequency(y, x, n.wavelength))
        moved = self._target_nufft()(
            (waves.detach() * (2j * math.pi * rate).to(waves.device)).conj()
        ).conj()
        depth = (n.target_position(*self._image.mesh())[2] - n.distance).to(waves.device)
        return (wavelength - as_number(wavelength)) * (depth * moved)

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        points = self._target_nufft()
        waves = points.adjoint(field.to(torch.complex128).conj()).conj()
        rows, columns = self.frequencies.shape
        spectrum = waves.new_zeros((*field.shape[:-2], rows * columns))
        spectrum = spectrum.index_copy(-1, self._wave_indices.to(field.device), waves)
        spectrum = spectrum.reshape(*field.shape[:-2], rows, columns)
        return self._to_spectrum.adjoint(self._apply_filter(spectrum, self.frequencies, back=True))


def _wrap_frequency(frequency: torch.Tensor, period: float) -> torch.Tensor:
    return frequency - torch.round(frequency / period) * period
