"""From objects and PSFs to pictures, and transfer functions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from judges import gauss, gaussian_psf
from judges.view import WAVELENGTH
from numpy.typing import NDArray

from hard_cases.lenses import LENS, defocused
from hard_cases.table import ONCE, Agrees, Case, Holds, Refused, require_finite_gradient
from optics.formation import (
    form_coherent_image,
    form_image,
    rfft2_frequencies,
    spectrum_of_disc,
    spectrum_of_samples,
)
from optics.otf import (
    ambiguity_function,
    defocused_transfer_function,
    lens_transfer_function,
    modulation_transfer,
    transfer_function,
)
from optics.plane import Plane
from optics.psf import PSFOperator

PLANE = Plane((24, 24), (1e-6, 1e-6))
CUTOFF = LENS.stop_diameter / (WAVELENGTH * LENS.image_distance)


def dtype_for(tol: float) -> torch.dtype:
    return torch.float32 if tol > 1e-7 else torch.float64


# Formation


def one_in_the_corner(tol: float) -> None:
    """With a margin of half a PSF nothing comes back on the far side."""
    light = torch.zeros(24, 24, dtype=dtype_for(tol))
    light[4, 4] = 1
    psf = torch.from_numpy(gaussian_psf(8, 2.0)).to(light)
    image = form_image(spectrum_of_samples(light), psf, PLANE, 1, (16, 16), pixel_aperture=False)
    assert abs(float(image[0, 0] / psf.max()) - 1) <= tol
    for far in (image[-4:], image[:, -4:]):
        assert float(far.abs().max()) <= tol * float(psf.max())


def linear(field: NDArray[Any], spread: NDArray[Any]) -> NDArray[np.float64]:
    """|sum of p(x - x') U(x')|², one sample after the other."""
    (rows, columns), (height, width) = field.shape, spread.shape
    answer = np.zeros((rows + height, columns + width), dtype=complex)
    for j in range(height):
        for i in range(width):
            answer[j : j + rows, i : i + columns] += spread[j, i] * field
    y, x = height // 2, width // 2
    return np.abs(answer[y : y + rows, x : x + columns]) ** 2


def waves(rows: int, columns: int, seed: int) -> NDArray[np.complex128]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, columns)) + 1j * rng.normal(size=(rows, columns))


def coherent(
    name: str, hard_because: str, field: NDArray[Any], spread: NDArray[Any], **row: Any
) -> Agrees:
    return Agrees(
        name,
        hard_because,
        "{}x{} field, {}x{} spread".format(*field.shape, *spread.shape),
        lambda tol: form_coherent_image(
            *(torch.from_numpy(a).to(torch.complex64 if tol > 1e-7 else torch.complex128)
              for a in (field, spread))
        ),
        lambda: linear(field, spread),
        "the sum, term by term",
        **{"tols": (3e-6, 1e-12), **row},
    )  # fmt: skip


def corner(rows: int, columns: int) -> NDArray[np.complex128]:
    field = np.zeros((rows, columns), dtype=complex)
    field[0, -1] = 1
    return field


def dark_field(tol: float) -> None:
    """Darkness, and a gradient of zero."""
    spread = torch.from_numpy(waves(3, 4, 1))
    field = torch.zeros(5, 6, dtype=torch.complex128)
    gradient = require_finite_gradient(lambda f: form_coherent_image(f, spread), field)
    assert not gradient.any()


def ends_of_discs(tol: float) -> None:
    """A disc of no size is a point, one wider than the plane keeps its light."""
    point = spectrum_of_disc(PLANE, 0.0)
    assert bool((point == 1).all())
    for diameter in (1e-30, 1e-9, 1e-3, 1e3):
        spectrum = spectrum_of_disc(PLANE, diameter, 2.0)
        assert torch.isfinite(spectrum.real).all()
        assert complex(spectrum[0, 0]) == 2
        assert float(spectrum.abs().max()) <= 2 * (1 + 1e-15)


def picture(psf: torch.Tensor) -> torch.Tensor:
    return form_image(spectrum_of_samples(torch.ones(24, 24)), psf, PLANE, 1, (16, 16))


# Transfer functions

V = np.array([0.0, 1e-9, 1e-4, 0.02, 0.3, 0.77, 0.999, 1 - 1e-9, 1.0, 1.3])


def at(v: NDArray[np.float64], waves_off: float, tol: float) -> torch.Tensor:
    f = torch.from_numpy(v) * CUTOFF
    distance = defocused(LENS, waves_off)
    return lens_transfer_function(LENS, distance, WAVELENGTH, 0.6 * f, 0.8 * f, tol=tol)


def overlap(v: NDArray[np.float64], waves_off: float) -> NDArray[np.float64]:
    """The integral over two stops that overlap, line by line, with 20 000 nodes."""
    angle, weight = gauss(20_000)
    values = []
    for share in v:
        # Hopkins: along the shift the integral is a sinc; across it y = sin(angle).
        if share >= 1:
            values.append(0.0)
            continue
        widest = math.acos(share)
        a = widest * angle
        half = np.cos(a) - share
        inside = 2 * half * np.sinc(8 * waves_off * share * half)
        values.append(float(np.sum(weight * widest * np.cos(a) * inside)) / math.pi)
    return np.array(values)


def in_focus(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Goodman 6.3."""
    v = np.clip(v, 0, 1)
    return 2 / np.pi * (np.arccos(v) - v * np.sqrt(1 - v**2))


U = np.array([[-2.0], [-1.5], [0.0], [1e-9], [0.7], [2 - 1e-9], [2.5]])
FAR = np.array([[0.0, 1e-9, 0.3, 17.0, -1e3]])


def slit(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    reach = np.clip(1 - np.abs(u) / 2, 0, None)
    return reach * np.sinc(2 * v * reach)


WINDOW = Plane((150, 151), (0.4 / CUTOFF, 0.4 / CUTOFF))


def of_the_psf(tol: float) -> NDArray[Any]:
    light = PSFOperator(LENS, defocused(LENS, 2), WAVELENGTH, WINDOW, integrate=False, tol=1e-6)()
    return transfer_function(light, WINDOW).numpy()


def of_the_lens() -> NDArray[Any]:
    fy, fx = rfft2_frequencies(WINDOW)
    return lens_transfer_function(LENS, defocused(LENS, 2), WAVELENGTH, fy, fx).numpy()


def gradient_at_zero(tol: float) -> None:
    """Finite, and right beside it: 1 for 1e-30, (-3 + 4i) / 5."""
    transfer = torch.tensor([0, 1e-30j, -3 + 4j], dtype=torch.complex128, requires_grad=True)
    modulation_transfer(transfer).sum().backward()
    assert transfer.grad is not None
    assert np.allclose(transfer.grad.numpy(), [0, 1j, -0.6 + 0.8j], rtol=1e-12, atol=0)


def two_stars(tol: float) -> None:
    """A PSF that cancels at its highest frequency has a modulation of 0 and a gradient."""
    psf = torch.tensor([[0.0, 1.0, 1.0, 0.0]], requires_grad=True)
    value = modulation_transfer(transfer_function(psf, Plane((1, 4), (1e-6, 1e-6))))
    value.sum().backward()
    assert float(value[0, 2].detach()) == 0
    assert psf.grad is not None
    assert torch.isfinite(psf.grad).all()


CASES: list[Case] = [
    Holds("an object in the corner", "FFTs wrap around: its light comes out opposite",
          "24x24 samples, margin 4", one_in_the_corner, "half a PSF", tols=(1e-5, 1e-11)),
    coherent("light at the edge, coherent", "half of its spread belongs outside, not opposite",
             corner(8, 9), waves(5, 4, 1)),
    coherent("an odd spread over an even field", "the origin is n // 2 for both parities",
             waves(6, 9, 2), waves(5, 3, 3)),
    coherent("a spread larger than the field", "what is cut is most of it",
             waves(3, 4, 4), waves(11, 12, 5)),
    coherent("a single sample, coherent", "FFTs of length one",
             waves(1, 1, 6), waves(1, 1, 7)),
    Holds("a dark field", "fields of zero have no phase", "zeros", dark_field,
          "zero, in value and gradient", tols=ONCE),
    Holds("discs from nothing to a kilometre", "2 J1(v) / v at v = 0 is 0 / 0",
          "0, 1e-30 m … 1 km", ends_of_discs, "their light", tols=ONCE),
    # Transfer functions
    Agrees("a transfer function in focus", "a double integral with a root at both ends",
           "from zero frequency beyond the cut-off", lambda tol: at(V, 0.0, tol),
           lambda: in_focus(V), "the closed form (Goodman 6.3)", tols=(1e-6, 1e-11)),
    Agrees("a transfer function next to focus", "the series for defocus is 0 / 0 at zero",
           "1e-9 waves", lambda tol: at(V, 1e-9, tol), lambda: in_focus(V),
           "the limit, in focus", tols=(1e-6, 1e-8)),
    Agrees("a transfer function a thousand waves out of focus",
           "6000 rad under the integral, which is a 1e-4th of its parts",
           "1000 waves", lambda tol: at(V, 1000.0, tol), lambda: overlap(V, 1000.0),
           "20 000 nodes along the overlap", tols=(1e-6, 1e-9)),
    Agrees("the transfer function of a PSF", "light beside the window wraps around, or is missing",
           "2 waves, 150x151 points", of_the_psf, of_the_lens, "the lens' own", tols=(1e-2,)),
    Agrees("an ambiguity function at its ends", "sinc(0), an overlap of nothing, 1e3 cycles",
           "slit, |u| up to 2.5", lambda tol: ambiguity_function(None, U, FAR, tol=tol),
           lambda: slit(U, FAR), "the closed form", tols=(1e-6, 1e-11)),
    Agrees("a slit a thousand waves out of focus", "the polar display's steepest line",
           "± 1000 waves", lambda tol: defocused_transfer_function(None, U, FAR, tol=tol),
           lambda: slit(U, 2 * U * FAR), "the closed form", tols=(1e-6, 1e-11)),
    Holds("the modulus of zero", "the gradient of sqrt(re² + im²) is 0 / 0",
          "0, 1e-30 i, -3 + 4 i", gradient_at_zero, "z / |z|", tols=ONCE),
    Holds("a PSF whose transfer function is zero somewhere", "two stars a sample apart",
          "4 samples", two_stars, "0, with a finite gradient", tols=ONCE),
    # Refusals
    Refused("an ambiguity function of a hundred thousand cycles", "16 384 nodes see four a cycle",
            "1e5 cycles",
            lambda: ambiguity_function(None, np.zeros(1), np.full(1, 100000.3), tol=1e-9),
            r"can't be kept by 16384 nodes .*less steep or smoother",
            lambda tol: ambiguity_function(None, np.zeros(1), np.full(1, 1e3), tol=1e-9)),
    Refused("a PSF without light", "normalised by a sum of zero", "zeros",
            lambda: transfer_function(torch.zeros(24, 24), PLANE), "psf sums to 0; it needs light",
            lambda tol: transfer_function(torch.ones(24, 24), PLANE)),
    Refused("a PSF that is a field", "its squared modulus is meant, or its real part", "complex64",
            lambda: transfer_function(torch.ones(24, 24) + 0j, PLANE), "give the light",
            lambda tol: transfer_function(torch.ones(24, 24), PLANE)),
    Refused("NaN in a PSF", "one NaN makes a whole picture NaN", "1 of 64",
            lambda: picture(torch.full((8, 8), math.nan)), "psf has 64 NaN or infinite values",
            lambda tol: picture(torch.ones(8, 8))),
    Refused("NaN in an object", "one NaN makes a whole picture NaN", "1 of 64",
            lambda: form_image(torch.full((24, 13), math.nan) + 0j, torch.ones(8, 8), PLANE, 1,
                               (4, 4)),
            "spectrum has .* NaN or infinite values",
            lambda tol: picture(torch.ones(8, 8))),
    Refused("a PSF larger than the plane", "its wings wrap around", "25x25 on 24x24",
            lambda: picture(torch.ones(25, 25)), "cannot pad|larger",
            lambda tol: picture(torch.ones(24, 24))),
    Refused("a frequency that is no number", "NaN is neither inside the cut-off nor outside",
            "NaN", lambda: at(np.array([math.nan]), 0.0, 1e-6), "NaN or infinite",
            lambda tol: at(V, 0.0, 1e-6)),
]  # fmt: skip
