"""Check that a smooth field is resolved by its samples and dark at its edges, and scale it."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise

import torch

from optics.accuracy import MachineSpeed
from optics.fourier import fft
from optics.fourier.fft import fft_operations
from optics.propagation.propagator import Share
from optics.propagation.span import FreeSpaceSpan
from optics.propagation.transfer_function import free_space_transfer_function
from optics.validation import require_finite


def sum_squared_modulus(field: torch.Tensor) -> torch.Tensor:
    """Return the sum of ``|u|²`` of each field (..., rows, columns), float64.

    The squares are computed in the precision of the field.
    """
    parts = torch.view_as_real(field.detach().resolve_conj())
    return parts.square().sum(dim=(-3, -2, -1), dtype=torch.float64)


def field_power(field: torch.Tensor) -> torch.Tensor:
    """Return the sum of ``|u|²`` of each field (..., rows, columns), float64, without overflow."""
    light = sum_squared_modulus(field)
    if field.dtype == torch.complex128 or _suits_single_precision(light):
        return light
    # The squares may have exceeded the range of single precision.
    return sum_squared_modulus(field.to(torch.complex128))


def normalise_strength(
    field: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
    """Rescale fields for single precision; return them, their power, and the factor that undoes it.

    If the power of every field suits single precision, nothing is changed and the factor is None.
    Otherwise each field that isn't dark is divided by its largest real or imaginary part. Raises
    ValueError for NaN or infinite values. Any such value changes the power, so the values are
    checked only where that is unusual.
    """
    light = field_power(field)
    if _suits_single_precision(light):
        return field, light, None
    require_finite("field", field.detach())
    peak = torch.view_as_real(field.detach().resolve_conj()).abs().amax(dim=(-3, -2, -1))
    peak = torch.where(peak > 0, peak, 1.0)[..., None, None]
    even = field / peak
    return even, field_power(even), peak


def power_shares(part: torch.Tensor, light: torch.Tensor) -> list[float]:
    """Return the ratio part / light for each field that isn't dark, as a list, which is faster."""
    pairs = zip(part.flatten().tolist(), light.flatten().tolist(), strict=True)
    return [some / whole for some, whole in pairs if whole > 0]


def _suits_single_precision(light: torch.Tensor) -> bool:
    """Return whether the power of every field suits single precision."""
    # Within these limits a field's spectrum, its kernels and their squares stay far from the ends
    # of single precision, 1e-38 and 1e38.
    return all(1e-20 < one < 1e20 for one in light.flatten().tolist())


# Shares of a field's light outside its band that may be rounding errors of an FFT.
_SINGLE_ROUNDING, _DOUBLE_ROUNDING = 1e-14, 1e-27

# Time to compute how far Fresnel's transfer function is from the exact one at a frequency, in
# passes over a complex number; measured.
_TOUCHES_PER_DEVIATION = 300


class SmoothFieldCheck:
    """Check at every call that a field is smooth, as its span declares.

    The indices of the FFT's frequencies within carrier ± band are computed once.
    """

    def __init__(self, span: FreeSpaceSpan) -> None:
        self._span = span
        inside_y, inside_x = (
            _offset_from_carrier(span, axis).abs() <= half * span.source.pitch[axis] * (1 + 1e-9)
            for axis, half in enumerate(span.half_bandwidths)
        )
        self._within_x, self._beyond_x = _true_runs(inside_x), _true_runs(~inside_x)
        self._beyond_y = _true_runs(~inside_y)
        # Single precision suffices for tolerances from 1e-5 on. There, the light allowed outside
        # the band is 2.5e-11 of all light, and the rounding of an FFT is 1e-13 of it.
        self._dtype = torch.complex64 if span.tol >= 1e-5 else torch.complex128

    def checked_spectrum(
        self, field: torch.Tensor, light: torch.Tensor
    ) -> tuple[torch.Tensor, float]:
        """Check fields; return their spectra in the band along x, and the largest share of light
        beyond the band and the source's edges.

        field: (..., rows, columns), rescaled for single precision. light: the sum of |u|² of each.
        Raises ValueError for a field with light beyond its band or at the source's edges.
        """
        span, field = self._span, field.detach().to(self._dtype)
        allowed = (Share.SMOOTH_FIELD * span.tol) ** 2
        edges = max(power_shares(_edge_light(span, field), light), default=0.0)
        if edges > allowed:
            raise ValueError(
                f"field doesn't vanish at the source's edges: a share of {edges:.2g} of its "
                "light stands there. Give a larger plane on which it does, or cells= if each "
                "sample is a rectangle of constant field"
            )
        rows, columns = field.shape[-2:]
        # Light outside the band along x needn't be transformed along y (Parseval's theorem).
        lines = fft(field, columns, -1)
        spectrum = fft(_take_runs(lines, self._within_x), rows, -2)
        beyond = torch.zeros(field.shape[:-2], dtype=torch.float64, device=field.device)
        for run in self._beyond_x:
            beyond = beyond + sum_squared_modulus(lines[..., run]) / columns
        for run in self._beyond_y:
            beyond = beyond + sum_squared_modulus(spectrum[..., run, :]) / (rows * columns)
        outside = max(power_shares(beyond, light), default=0.0)
        if outside > allowed:
            (fy, fx), (by, bx) = span.carrier, span.half_bandwidths
            raise ValueError(
                f"field has a share of {outside:.2g} of its light outside carrier ± band "
                f"(({fy:.4g}, {fx:.4g}) ± ({by:.4g}, {bx:.4g}) cycles/m). "
                "Sample it finer, give the carrier= of its fringes, or cells= if each sample is a "
                "rectangle of constant field"
            )
        rounding = _SINGLE_ROUNDING if self._dtype == torch.complex64 else _DOUBLE_ROUNDING
        return spectrum, max(edges + outside - rounding, 0.0)

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor time of checking a field, in seconds."""
        rows, columns = self._span.source.shape
        operations = rows * fft_operations(columns) + columns * fft_operations(rows)
        return (operations * speed.fft + 6 * rows * columns * speed.touch) * speed.slowdown(
            self._dtype
        )

    def planning_seconds(self, speed: MachineSpeed) -> float:
        """Predict the time of what the first check of a field keeps, in seconds."""
        if not self._span.paraxial:
            return 0.0
        columns = sum(run.stop - run.start for run in self._within_x)
        return _TOUCHES_PER_DEVIATION * self._span.source.shape[0] * columns * speed.touch

    def paraxial_field_error(self, spectrum: torch.Tensor) -> float:
        """Return the largest relative L2 error that Fresnel's transfer function makes for fields.

        spectrum: of the fields, from checked_spectrum(). The error of a dark field is 0.
        """
        off = self._paraxial_deviation.to(spectrum.device)
        power = spectrum.real**2 + spectrum.imag**2
        total = power.sum(dim=(-2, -1), dtype=torch.float64)
        wrong = (power * off).sum(dim=(-2, -1), dtype=torch.float64)
        return math.sqrt(max(power_shares(wrong, total), default=0.0))

    @cached_property
    def _paraxial_deviation(self) -> torch.Tensor:
        """The ``|H - H'|²`` of exact and Fresnel's transfer functions at the kept frequencies."""
        n = self._span.numeric
        # The FFT's frequencies as aliases nearest the carrier, cycles/m.
        y, x = (
            n.carrier[axis] + _offset_from_carrier(n, axis) / n.source.pitch[axis]
            for axis in (0, 1)
        )
        x = _take_runs(x, self._within_x)
        exact, fresnel = (
            free_space_transfer_function(y[:, None], x, n.distance, n.wavelength, paraxial=paraxial)
            for paraxial in (False, True)
        )
        return ((exact - fresnel).abs() ** 2).to(torch.float32)


def _true_runs(mask: torch.Tensor) -> list[slice]:
    """Return the runs in which a mask is true, as slices, which are much faster than indices."""
    edges = torch.nonzero(torch.diff(torch.nn.functional.pad(mask.int(), (1, 1))))[:, 0].tolist()
    return [slice(first, last) for first, last in pairwise(edges)][::2]


def _take_runs(values: torch.Tensor, runs: list[slice]) -> torch.Tensor:
    """Return the values of a spectrum whose last index lies in one of the runs."""
    return torch.cat([values[..., run] for run in runs or [slice(0, 0)]], -1)


def _edge_light(span: FreeSpaceSpan, field: torch.Tensor) -> torch.Tensor:
    """Return the light beyond the band from a field's jumps at the source's edges.

    The spectrum of a sampled jump is 1 / (2 sin(pi f p)); its square from the band B to the Nyquist
    rate has the integral cot(pi B p) / (2 pi) per sample. Another 1 / (2 pi) is added for light
    beyond the window.
    """
    rows, columns = field.shape[-2:]
    y, x = (
        (1 + 1 / math.tan(math.pi * band * pitch)) / (2 * math.pi)
        for band, pitch in zip(span.half_bandwidths, span.source.pitch, strict=True)
    )
    # A single row or column of samples is both edges at once.
    y, x = y * (2 / min(rows, 2)), x * (2 / min(columns, 2))
    first_last_y, first_last_x = (slice(None, None, max(n - 1, 1)) for n in (rows, columns))
    return y * sum_squared_modulus(field[..., first_last_y, :]) + x * sum_squared_modulus(
        field[..., first_last_x]
    )


def _offset_from_carrier(span: FreeSpaceSpan, axis: int) -> torch.Tensor:
    """Return the FFT's frequencies less the carrier, in turns per sample, as aliases nearest 0."""
    n, pitch = span.source.shape[axis], span.source.pitch[axis]
    turns = torch.fft.fftfreq(n, dtype=torch.float64) - span.carrier[axis] * pitch
    return turns - torch.round(turns)
