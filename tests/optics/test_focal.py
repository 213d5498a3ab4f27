"""The field in a focal plane against Gaussian beams, direct sums and Parseval's theorem."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from judges import direct_transform, positions, relative

from optics.focal_plane import focal_field
from optics.plane import Plane

WAVELENGTH, FOCAL = 520e-9, 0.1
SCALE = WAVELENGTH * FOCAL


def full_cell(pupil: Plane) -> Plane:
    """The image samples of a DFT of the pupil's size."""
    pitch = tuple(SCALE / (n * p) for n, p in zip(pupil.shape, pupil.pitch, strict=True))
    return Plane(pupil.shape, pitch)


def random_field(rng, *shape) -> np.ndarray:
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def mesh(plane: Plane) -> tuple[np.ndarray, np.ndarray]:
    y, x = (positions(plane.shape[a], plane.pitch[a], plane.centre[a]) for a in (0, 1))
    return y[:, None], x[None, :]


def gaussian_beam(plane: Plane, q: complex) -> np.ndarray:
    """exp(i k r² / (2 q)), q being Kogelnik's complex radius (10.1364/AO.5.001550)."""
    y, x = mesh(plane)
    return np.exp(1j * np.pi / WAVELENGTH * (y**2 + x**2) / q)


@pytest.mark.parametrize("before", [0.0, 0.03, 0.1, 0.25])
@pytest.mark.parametrize("shape", [(120, 121), (121, 120)])
@pytest.mark.parametrize("image", [
    Plane((30, 31), (9e-6, 8e-6)),
    Plane((20, 21), (4e-6, 5e-6), (60e-6, -110e-6)),
])  # fmt: skip
def test_a_gaussian_beam_keeps_its_closed_form(shape, image, before):
    """Amplitude and phase by the ABCD law: 1 / (A + B / q), with A = 0 and B = f."""
    waist = 150e-6
    pupil = Plane(shape, (12e-6, 12e-6))
    q = -1j * np.pi * waist**2 / WAVELENGTH
    a, b, c, d = 0.0, FOCAL, -1 / FOCAL, 1 - before / FOCAL
    truth = gaussian_beam(image, (a * q + b) / (c * q + d)) / (a + b / q)
    value = focal_field(
        gaussian_beam(pupil, q), pupil, image, FOCAL, WAVELENGTH, distance_before_lens=before
    )
    assert value.dtype == np.complex128
    assert relative(value, truth) <= 1e-9


def test_a_converging_beam_far_from_the_lens_keeps_its_closed_form():
    """Curved by 0.3 m before it walks 0.17 m to the lens; the ABCD law again."""
    pupil, image, before = Plane((256, 256), (8e-6, 8e-6)), Plane((24, 24), (6e-6, 6e-6)), 0.17
    q = 1 / (-1 / 0.3 + 1j * WAVELENGTH / (np.pi * 200e-6**2))
    truth = gaussian_beam(image, FOCAL / (-q / FOCAL + 1 - before / FOCAL)) * q / FOCAL
    value = focal_field(
        gaussian_beam(pupil, q), pupil, image, FOCAL, WAVELENGTH, distance_before_lens=before
    )
    assert relative(value, truth) <= 1e-6


def test_with_the_field_in_the_front_focal_plane_the_phase_is_flat():
    """2f: the transform of a real and even field is -i times a real one; else it is curved."""
    pupil, image = Plane((63, 63), (20e-6, 20e-6)), Plane((40, 41), (15e-6, 15e-6))
    y, x = mesh(pupil)
    field = np.exp(-(y**2 + x**2) / (100e-6) ** 2)
    flat = focal_field(field, pupil, image, FOCAL, WAVELENGTH, distance_before_lens=FOCAL)
    assert np.abs(flat.real).max() <= 1e-12 * np.abs(flat.imag).max()
    curved = focal_field(field, pupil, image, FOCAL, WAVELENGTH, distance_before_lens=0.04)
    y, x = mesh(image)
    turn = np.pi / SCALE * (1 - 0.04 / FOCAL) * (y**2 + x**2)
    assert relative(curved, flat * np.exp(1j * turn)) <= 1e-12
    assert turn.max() > 2


@pytest.mark.parametrize("before", [0.0, 0.1, 0.31])
@pytest.mark.parametrize("shape", [(6, 8), (7, 9), (6, 9), (1, 5), (1, 1)])
def test_it_equals_the_direct_sum(shape, before, rng):
    pupil = Plane(shape, (8e-6, 9e-6), (40e-6, -700e-6))
    image = Plane((9, 6), (200e-6, 500e-6), (-800e-6, 450e-6))
    field = random_field(rng, 2, *shape)
    y, x = mesh(image)
    factor = np.exp(1j * np.pi / SCALE * (1 - before / FOCAL) * (y**2 + x**2)) / (1j * SCALE)
    truth = np.array([direct_transform(f, pupil, image, SCALE) for f in field])
    value = focal_field(field, pupil, image, FOCAL, WAVELENGTH, distance_before_lens=before)
    assert value.shape == (2, 9, 6)
    assert relative(value, truth * factor * 8e-6 * 9e-6) <= 1e-12


@pytest.mark.parametrize("shape", [(16, 18), (15, 17), (16, 17)])
def test_no_light_is_lost(shape, rng):
    """Parseval over a full cell: the integrals of |U|² are equal."""
    pupil = Plane(shape, (10e-6, 14e-6))
    image = full_cell(pupil)
    field = random_field(rng, *shape)
    value = focal_field(field, pupil, image, FOCAL, WAVELENGTH, distance_before_lens=0.02)
    light = (np.abs(field) ** 2).sum() * pupil.pitch[0] * pupil.pitch[1]
    assert (np.abs(value) ** 2).sum() * image.pitch[0] * image.pitch[1] == pytest.approx(
        light, rel=1e-12
    )


@pytest.mark.parametrize("before", [0.0, 0.1])
def test_single_precision_is_pure_and_follows_double(before, rng):
    """Hundreds of waves of curvature, reduced before they are rounded."""
    pupil = Plane((64, 65), (8e-6, 8e-6))
    image = Plane((40, 30), (20e-6, 20e-6), (2.7e-3, -2.6e-3))
    field = random_field(rng, 64, 65)
    truth = focal_field(field, pupil, image, FOCAL, WAVELENGTH, distance_before_lens=before)
    value = focal_field(
        torch.from_numpy(field).to(torch.complex64),
        pupil,
        image,
        FOCAL,
        WAVELENGTH,
        distance_before_lens=before,
    )
    assert value.dtype == torch.complex64
    assert relative(value.numpy(), truth) <= 1e-6


@pytest.mark.parametrize(
    ("given", "answered"),
    [
        (torch.float32, torch.complex64),
        (torch.float64, torch.complex128),
        (torch.uint8, torch.complex64),
    ],
)
def test_a_real_field_has_no_phase(given, answered):
    pupil = Plane((4, 4), (8e-6, 8e-6))
    value = focal_field(torch.ones(4, 4, dtype=given), pupil, pupil, FOCAL, WAVELENGTH)
    assert value.dtype == answered
    assert complex(value[2, 2]) == pytest.approx(16 * 8e-6**2 / (1j * SCALE), rel=1e-6)


def test_the_gradient_is_the_adjoint(rng):
    """<A x, y> = <x, A* y>, where autograd gives A* y; finite differences besides."""
    pupil, image = Plane((3, 4), (300e-6, 300e-6)), Plane((4, 3), (20e-6, 20e-6), (1e-5, -2e-5))

    def forward(field: torch.Tensor) -> torch.Tensor:
        return focal_field(field, pupil, image, FOCAL, WAVELENGTH, distance_before_lens=0.03)

    x = torch.from_numpy(random_field(rng, 3, 4)).requires_grad_()
    y = torch.from_numpy(random_field(rng, 4, 3))
    value = forward(x)
    (back,) = torch.autograd.grad(value, x, y)
    left = torch.sum(value.detach().conj() * y)
    right = torch.sum(x.detach().conj() * back)
    assert complex(left) == pytest.approx(complex(right), rel=1e-12)
    assert torch.autograd.gradcheck(forward, (x,))


def test_a_gradient_of_dark_light_is_finite():
    plane = Plane((4, 4), (20e-6, 20e-6))
    field = torch.zeros(4, 4, dtype=torch.complex64, requires_grad=True)
    value = focal_field(field, plane, plane, FOCAL, WAVELENGTH)
    (value.real**2 + value.imag**2).sum().backward()
    assert torch.isfinite(torch.view_as_real(field.grad)).all()


PUPIL = Plane((8, 8), (20e-6, 20e-6))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"field": torch.ones(1, 8)}, r"field is \(1, 8\); its pupil_plane has \(8, 8\) samples"),
        ({"field": torch.full((8, 8), math.nan)}, "field has 64 NaN or infinite values of 64"),
        ({"focal_length": 0.0}, "focal_length is 0 m; it must be positive"),
        ({"focal_length": -0.1}, "focal_length is -0.1 m; it must be positive"),
        ({"wavelength": math.inf}, "wavelength is inf m; it must be positive and finite"),
        (
            {"distance_before_lens": -0.01},
            "distance_before_lens is -0.01 m; the field must be in front of the lens",
        ),
        ({"distance_before_lens": math.nan}, "distance_before_lens is nan m"),
        (
            {"image_plane": Plane((8, 8), (20e-6, 400e-6))},
            r"image_plane reaches 0.0016 m in x, .* resolve light to 0.0013 m; .* pupil_plane's "
            r"pitch 1.62e-05 m or finer",
        ),
        (
            {"image_plane": Plane((8, 8), (20e-6, 20e-6), (-1.3e-3, 0.0))},
            "image_plane reaches 0.00138 m in y",
        ),
    ],
)
def test_what_makes_no_field_is_refused(change, words):
    settings = {
        "field": torch.ones(8, 8),
        "pupil_plane": PUPIL,
        "image_plane": Plane((8, 8), (20e-6, 20e-6)),
        "focal_length": FOCAL,
        "wavelength": WAVELENGTH,
    }
    with pytest.raises(ValueError, match=words):
        focal_field(**settings | change)


def test_the_advised_pitch_works():
    image = Plane((8, 8), (400e-6, 400e-6))
    with pytest.raises(ValueError, match="or finer") as caught:
        focal_field(torch.ones(8, 8), PUPIL, image, FOCAL, WAVELENGTH)
    pitch = float(str(caught.value).split("pitch ")[1].split()[0])
    focal_field(torch.ones(8, 8), Plane((8, 8), (pitch, pitch)), image, FOCAL, WAVELENGTH)
