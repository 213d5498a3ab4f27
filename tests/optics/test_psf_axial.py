"""The PSF of a round lens against closed forms and direct quadrature."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.special
import torch
from judges import positions, relative
from sweeps import some

from optics.accuracy import ToleranceError
from optics.camera import Lens
from optics.camera.stop import Circle, Stop
from optics.plane import Plane
from optics.psf import PSFOperator

WAVELENGTH = 520e-9
TOLERANCES = [1e-1, 1e-3, 1e-6, 1e-9]


def radii_of(plane: Plane) -> np.ndarray:
    y = positions(plane.shape[0], plane.pitch[0], plane.centre[0])[:, None]
    x = positions(plane.shape[1], plane.pitch[1], plane.centre[1])[None, :]
    return np.hypot(y, x)


def airy(lens: Lens, plane: Plane, wavelength: float, obscuration: float = 0.0) -> np.ndarray:
    """Share of the light on each sample's area: (2 J1(v) / v)², less the obscuration's."""
    outer, z = lens.stop_diameter / 2, lens.image_distance

    def disc(radius: float) -> np.ndarray:
        v = 2 * np.pi * radius * radii_of(plane) / (wavelength * z)
        safe = np.where(v > 0, v, 1)
        return np.pi * radius**2 * np.where(v > 0, 2 * scipy.special.j1(safe) / safe, 1)

    field = disc(outer) - (disc(obscuration * outer) if obscuration else 0)
    open_area = np.pi * outer**2 * (1 - obscuration**2)
    return field**2 / (wavelength * z) ** 2 / open_area * plane.pitch[0] * plane.pitch[1]


def direct(
    lens: Lens, distance: float, wavelength: float, plane: Plane, phase=None, obscuration=0.0
) -> np.ndarray:
    """The Hankel integral at every single radius, with many nodes and no interpolation."""
    outer, z = lens.stop_diameter / 2, lens.image_distance
    inner = obscuration * outer
    points, weights = scipy.special.roots_legendre(1800)
    r = inner + (outer - inner) * (points + 1) / 2
    weights = weights * (outer - inner) / 2 * r * 2 * np.pi
    vergence = 1 / distance - 1 / lens.focus_distance
    turn = np.pi / wavelength * vergence * r**2 + (0 if phase is None else phase(r))
    wave = weights * np.exp(1j * turn)
    s, place = np.unique(radii_of(plane).ravel(), return_inverse=True)
    field = np.concatenate(
        [
            scipy.special.j0(2 * np.pi / (wavelength * z) * np.outer(part, r)) @ wave
            for part in np.array_split(s, max(1, s.size // 500))
        ]
    )
    area = np.pi * (outer**2 - inner**2)
    light = np.abs(field) ** 2 / (wavelength * z) ** 2 / area * plane.pitch[0] * plane.pitch[1]
    return light[place].reshape(plane.shape)


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize(
    "plane",
    [
        Plane((64, 64), (2e-6, 2e-6)),
        Plane((33, 40), (1.5e-6, 2.5e-6)),
        Plane((20, 21), (3e-6, 3e-6), (50e-6, -80e-6)),
        Plane((1, 1), (3e-6, 3e-6)),
    ],
)
def test_in_focus_it_is_the_airy_pattern(plane, tol):
    lens = Lens(0.1, 5.6, 2.0)
    value = PSFOperator(lens, 2.0, WAVELENGTH, plane, integrate=False, tol=tol)()
    assert relative(value.numpy(), airy(lens, plane, WAVELENGTH)) <= tol


@pytest.mark.parametrize("obscuration", [0.1, 0.33, 0.9])
def test_an_obscured_stop_is_the_difference_of_two_discs(obscuration):
    lens, plane = Lens(0.1, 5.6, math.inf), Plane((50, 51), (2e-6, 2e-6))
    lens = replace(lens, stop=Stop(Circle(), (Circle(obscuration),)))
    operator = PSFOperator(lens, math.inf, WAVELENGTH, plane, integrate=False, tol=1e-9)
    assert relative(operator().numpy(), airy(lens, plane, WAVELENGTH, obscuration)) <= 1e-9


@pytest.mark.parametrize(("waves", "strehl"), [(0.25, 0.810569), (0.5, 0.405285), (0.75, 0.090063)])
def test_defocus_lowers_the_peak_as_sinc_squared(waves, strehl):
    """Strehl ratio sinc²(W20), W20 the defocus at the stop's edge in waves."""
    lens = Lens(0.1, 5.0, 2.0)
    vergence = waves * 2 * WAVELENGTH / (lens.stop_diameter / 2) ** 2
    plane = Plane((1, 1), (1e-6, 1e-6))

    def peak(distance: float) -> float:
        return float(PSFOperator(lens, distance, WAVELENGTH, plane, integrate=False, tol=1e-9)())

    assert peak(1 / (0.5 + vergence)) / peak(2.0) == pytest.approx(strehl, abs=1e-6)


@pytest.mark.parametrize("tol", TOLERANCES)
def test_the_benchmark_keeps_every_tolerance(tol):
    """100 mm f/5.6 at 520 nm, object at 2 m, focus at infinity: 38 waves of defocus."""
    lens, plane = Lens(0.1, 5.6, math.inf), Plane((96, 97), (3.45e-6, 3.45e-6))
    operator = PSFOperator(lens, 2.0, WAVELENGTH, plane, integrate=False, tol=tol)
    truth = direct(lens, 2.0, WAVELENGTH, plane)
    assert relative(operator().numpy(), truth) <= tol
    assert operator.account.error <= tol


@pytest.mark.parametrize("seed", some(range(24), *range(12)))
def test_random_lenses_keep_random_tolerances_or_say_why_not(seed):
    rng = np.random.default_rng(seed)
    lens = Lens(
        focal_length=10 ** rng.uniform(-2, 0),
        f_number=10 ** rng.uniform(math.log10(1.4), math.log10(32)),
        focus_distance=math.inf,
    )
    # Up to some tens of waves of defocus, so that the judge's own nodes suffice.
    most = 60 * 2 * WAVELENGTH / (lens.stop_diameter / 2) ** 2
    distance = 1 / min(rng.uniform(0, most), 1 / (1.1 * lens.focal_length))
    shape = tuple(int(n) for n in rng.integers(1, 40, 2))
    plane = Plane(shape, tuple(10 ** rng.uniform(-6, -4.7, 2)))
    tol = 10 ** rng.uniform(-8, -1)
    operator = PSFOperator(lens, distance, WAVELENGTH, plane, integrate=False, tol=tol)
    assert relative(operator().numpy(), direct(lens, distance, WAVELENGTH, plane)) <= tol


def test_an_object_at_infinity_is_the_limit_of_far_ones():
    lens, plane = Lens(0.1, 5.6, 20.0), Plane((30, 30), (3e-6, 3e-6))
    infinite, far = (
        PSFOperator(lens, d, WAVELENGTH, plane, tol=1e-8)().numpy() for d in (math.inf, 1e10)
    )
    assert relative(far, infinite) <= 1e-6


def test_whole_pixels_are_the_integral_of_the_airy_pattern():
    """Midpoint rule of 25 x 25 points in each pixel."""
    lens, pitch = Lens(0.1, 5.6, 2.0), 3.45e-6
    value = PSFOperator(lens, 2.0, WAVELENGTH, Plane((8, 9), (pitch, pitch)), tol=1e-6)()
    # 25 is odd: the points' own origin is the middle of the pixel n // 2.
    centre = tuple(((n // 2) * 25 + 12 - (n * 25) // 2) * -pitch / 25 for n in (8, 9))
    fine = Plane((200, 225), (pitch / 25, pitch / 25), centre)
    truth = airy(lens, fine, WAVELENGTH).reshape(8, 25, 9, 25).sum((1, 3))
    assert relative(value.numpy(), truth) <= 1e-3
    # The rule's own error falls with the square of the points: at 25 it is below 1e-3.


def test_light_in_a_wide_window_is_the_encircled_energy():
    """All but the share 1 - J0²(v) - J1²(v) lies beyond the window's inner circle."""
    lens, n, pitch = Lens(0.1, 8.0, 2.0), 200, 2e-6
    light = PSFOperator(lens, 2.0, WAVELENGTH, Plane((n, n), (pitch, pitch)), tol=1e-6)()

    def inside(radius: float) -> float:
        v = np.pi * radius * lens.stop_diameter / (WAVELENGTH * lens.image_distance)
        return 1 - scipy.special.j0(v) ** 2 - scipy.special.j1(v) ** 2

    assert inside(n / 2 * pitch) < float(light.sum()) < inside(n / 2 * pitch * math.sqrt(2))


@pytest.mark.parametrize("method", [None, "axial"])
def test_a_spherical_aberration_is_a_phase_over_the_radius(method):
    lens, plane = Lens(0.1, 5.6, 2.0), Plane((40, 40), (2e-6, 2e-6))
    operator = PSFOperator(
        lens, 1.8, WAVELENGTH, plane, integrate=False, tol=1e-7, phase_slope=25.0, method=method
    )

    def aberration(r: np.ndarray) -> np.ndarray:
        return 6 * (r / (lens.stop_diameter / 2)) ** 4

    value = operator(aberration(np.hypot(*(p.numpy() for p in operator.points))))
    assert isinstance(value, np.ndarray)
    assert relative(value, direct(lens, 1.8, WAVELENGTH, plane, aberration)) <= 1e-7


def test_the_gradient_equals_finite_differences():
    lens, plane = Lens(0.1, 50.0, 2.0), Plane((4, 5), (15e-6, 15e-6))
    operator = PSFOperator(lens, 1.8, WAVELENGTH, plane, integrate=False, tol=1e-8, method="axial")
    phase = torch.linspace(0, 2, operator.points[1].numel(), dtype=torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(lambda p: 100 * operator(p), (phase,), atol=1e-7)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"distance": -1.0}, "distance is -1 m"),
        ({"distance": float("nan")}, "distance is nan m"),
        ({"distance": 1e-10}, "distance is 1e-10 m, less than a wavelength"),
        ({"wavelength": 0.0}, "wavelength is 0 m"),
        ({"unmodulated": 0.1}, "unmodulated is 0.1; a lens without a panel modulates nothing"),
        ({"method": "panel"}, "method is 'panel'; for a lens choose one of axial, scattered"),
        ({"tol": 0.0}, "tol 0 can't be kept; ask for tol"),
        ({"tol": 1e-11}, r"tol 1e-11 can't be kept; ask for tol 2\.\d+e-11"),
    ],
)
def test_what_makes_no_psf_is_refused(change, words):
    settings = {"distance": 2.0, "wavelength": WAVELENGTH, "pixels": Plane((4, 4), (1e-6, 1e-6))}
    with pytest.raises(ValueError, match=words):
        PSFOperator(Lens(), **settings | change)


def test_the_advised_tolerance_works():
    pixels = Plane((8, 8), (3e-6, 3e-6))
    with pytest.raises(ToleranceError, match="ask for tol") as caught:
        PSFOperator(Lens(), 2.0, WAVELENGTH, pixels, tol=1e-12)
    advised = float(str(caught.value).split("ask for tol ")[1].split()[0])
    assert PSFOperator(Lens(), 2.0, WAVELENGTH, pixels, tol=advised).account.error <= advised


def test_ten_digits_are_answered():
    """In focus: Airy's pattern on whole pixels, whose light adds up."""
    lens, pixels = Lens(0.05, 8.0, 2.0), Plane((12, 12), (3e-6, 3e-6))
    asked = lens, 2.0, WAVELENGTH, pixels
    fine, finest = (PSFOperator(*asked, tol=tol) for tol in (1e-10, 3e-11))
    assert fine.account.error <= 1e-10
    assert relative(fine().numpy(), finest().numpy()) <= 1e-10


def test_more_than_the_memory_is_refused_before_it_is_taken():
    """A metre of focal length wide open at 0.3 m, aberrated: half a million waves of defocus."""
    lens = Lens(1.0, 1.4, math.inf, aberrations=((4, 0, 1e-6),))
    pixels = Plane((1024, 1024), (20e-6, 20e-6))
    with pytest.raises(ToleranceError, match=r"needs \d+ MB at least and \d+ MB are allowed"):
        PSFOperator(lens, 0.3, WAVELENGTH, pixels, integrate=False)


def test_a_phase_of_another_length_or_not_finite_is_refused():
    pixels = Plane((4, 4), (1e-6, 1e-6))
    operator = PSFOperator(Lens(), 2.0, WAVELENGTH, pixels, method="axial")
    with pytest.raises(ValueError, match=r"phase is \(3,\); the pupil has \(\d+,\) points"):
        operator(torch.zeros(3))
    with pytest.raises(ValueError, match="phase has 1 NaN"):
        operator(torch.zeros(operator.points[1].numel()).index_fill(0, torch.tensor(0), math.nan))
