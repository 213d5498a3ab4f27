"""Whether a smooth field is what its samples promise: resolved by them, and dark at their edges."""

from __future__ import annotations

import math

import torch

from optics.fourier import fft
from optics.propagation.span import Span
from optics.propagation.transfer import transfer

_SHARE = 0.5
"""Of the tolerance, that light outside the promise may be worth."""


def light_spectrum(field: torch.Tensor) -> torch.Tensor:
    """Where a field's light is among the frequencies of an FFT, real; sums to that of |u|²."""
    rows, columns = field.shape[-2:]
    spectrum = fft(fft(field.detach(), rows, -2), columns, -1)
    return (spectrum.real**2 + spectrum.imag**2) / (rows * columns)


def require_smooth(
    span: Span, field: torch.Tensor, light: torch.Tensor, spectrum: torch.Tensor
) -> None:
    """Raise ValueError for a field with light beyond its band or at the source's edges.

    field: (..., rows, columns). light: that of each field, square metres times |u|².
    spectrum: the field's light_spectrum().
    """
    field = field.detach()
    dark = light <= 0
    total = torch.where(dark, 1.0, light / span.area)
    allowed = (_SHARE * span.tol) ** 2
    edges = float((_edge_light(span, field) / total).max()) if total.numel() else 0.0
    if edges > allowed:
        raise ValueError(
            f"field doesn't vanish at the source's edges: a share of {edges:.2g} of its light "
            "stands there. Give a larger plane on which it does, or cells= if each sample is a "
            "rectangle of constant field"
        )
    outside = float((_outer_light(span, spectrum) / total).max()) if total.numel() else 0.0
    if outside > allowed:
        raise ValueError(
            f"field has a share of {outside:.2g} of its light outside carrier ± band "
            f"({_cycles(span.carrier)} ± {_cycles(span.bands)} cycles/m). Sample it finer, give "
            "the carrier= of its fringes, or cells= if each sample is a rectangle of constant "
            "field"
        )


def _cycles(pair: tuple[float, float]) -> str:
    return f"({pair[0]:.4g}, {pair[1]:.4g})"


def _edge_light(span: Span, field: torch.Tensor) -> torch.Tensor:
    """What a jump at the edges, as high as the field is there, would send beyond the band.

    Its samples' spectrum is 1 / (2 sin(pi f p)), and its square's integral from the band B to
    the Nyquist rate cot(pi B p) / (2 pi) a sample; as much is taken to be beyond the window.
    """
    power = field.real**2 + field.imag**2
    edge = torch.zeros((), dtype=torch.float64)
    for axis, (band, pitch) in enumerate(zip(span.bands, span.source.pitch, strict=True)):
        lines = power.movedim(-2 + axis, -1)
        both = (lines[..., 0] + lines[..., -1]).sum(-1, dtype=torch.float64)
        edge = edge + both * (1 + 1 / math.tan(math.pi * band * pitch)) / (2 * math.pi)
    return edge


def _outer_light(span: Span, spectrum: torch.Tensor) -> torch.Tensor:
    """Light at frequencies outside carrier ± band."""
    inside = [_inside(span, axis).to(spectrum.device) for axis in (0, 1)]
    beyond = ~(inside[0][:, None] & inside[1])
    return (spectrum * beyond).sum(dim=(-2, -1), dtype=torch.float64)


def paraxial_deviation(span: Span) -> torch.Tensor:
    """|H - H'|² of the exact and Fresnel's transfer functions, at an FFT's frequencies."""
    y, x = (_frequencies(span, axis) for axis in (0, 1))
    n = span.numeric
    exact, fresnel = (
        transfer(y[:, None], x, n.distance, n.wavelength, paraxial=paraxial)
        for paraxial in (False, True)
    )
    return ((exact - fresnel).abs() ** 2).to(torch.float32)


def paraxial_shortfall(deviation: torch.Tensor, spectrum: torch.Tensor) -> float:
    """Relative L2 error of Fresnel's transfer function, over the light of a smooth field.

    deviation: paraxial_deviation(). spectrum: the field's light_spectrum(). The largest of all
    fields' errors, 0 of a dark one.
    """
    total = spectrum.sum(dim=(-2, -1), dtype=torch.float64)
    off = deviation.to(spectrum.device)
    wrong = (spectrum * off).sum(dim=(-2, -1), dtype=torch.float64)
    share = torch.where(total > 0, wrong / torch.where(total > 0, total, 1.0), 0.0)
    return math.sqrt(float(share.max())) if share.numel() else 0.0


def _frequencies(span: Span, axis: int) -> torch.Tensor:
    """Of an FFT's samples, the aliases that are nearest to the carrier; cycles per metre."""
    return span.carrier[axis] + _away(span, axis) / span.source.pitch[axis]


def _away(span: Span, axis: int) -> torch.Tensor:
    """Turns a sample from the carrier to an FFT's frequencies, as samples alias them."""
    n, pitch = span.source.shape[axis], span.source.pitch[axis]
    turns = torch.fft.fftfreq(n, dtype=torch.float64) - span.carrier[axis] * pitch
    return turns - torch.round(turns)


def _inside(span: Span, axis: int) -> torch.Tensor:
    """Which of an FFT's frequencies are within carrier ± band."""
    return _away(span, axis).abs() <= span.bands[axis] * span.source.pitch[axis] * (1 + 1e-9)
