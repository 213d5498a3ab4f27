"""Transfer functions against closed forms, Hopkins' series and adaptive quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.special
import torch
from judges import direct_transform, positions, relative
from judges.transfer import clear_stop, hopkins_series
from scipy.integrate import dblquad, quad

from optics.accuracy import ToleranceError
from optics.camera import Lens
from optics.formation import rfft2_frequencies
from optics.otf import (
    ambiguity_function,
    defocused_transfer_function,
    lens_transfer_function,
    modulation_transfer,
    transfer_function,
)
from optics.plane import Plane

WAVELENGTH = 520e-9
LENS = Lens(0.1, 5.6, 2.0)
RADIUS = LENS.stop_diameter / 2
SCALE = WAVELENGTH * LENS.image_distance
CUTOFF = LENS.stop_diameter / SCALE


def distance_for(waves: float) -> float:
    """Metres to an object whose defocus at the stop's edge is W20 = waves wavelengths."""
    return 1 / (1 / LENS.focus_distance + 2 * waves * WAVELENGTH / RADIUS**2)


def defocus(waves: float):
    """The same defocus as a phase over the pupil."""
    return lambda y, x: 2 * math.pi * waves * (y**2 + x**2) / RADIUS**2


def lens_at(v, *, waves=0.0, angle=0.0, **options):
    """lens_transfer_function() at shares v of the cut-off in one direction."""
    f = torch.as_tensor(v, dtype=torch.float64) * CUTOFF
    fy, fx = f * math.sin(angle), f * math.cos(angle)
    return lens_transfer_function(LENS, distance_for(waves), WAVELENGTH, fy, fx, **options)


def hopkins_integral(v: float, waves: float) -> float:
    """The same by adaptive quadrature over the position across the overlap."""

    def along(y: float) -> float:
        half = math.sqrt(1 - y * y) - v
        return 2 * half * np.sinc(8 * waves * v * half)

    return 2 / np.pi * quad(along, 0, math.sqrt(1 - v * v), epsabs=1e-12, limit=500)[0]


def overlap(v: tuple[float, float], phase) -> complex:
    """P(p - s / 2) P*(p + s / 2) over both stops, upright, by adaptive quadrature."""
    vy, vx = v

    def ends(y: float) -> tuple[float, float]:
        one, two = (math.sqrt(max(1 - (y - d) ** 2, 0.0)) for d in (vy, -vy))
        left, right = max(vx - one, -vx - two), min(vx + one, -vx + two)
        return min(left, right), right

    def part(wave) -> float:
        def integrand(x: float, y: float) -> float:
            one = phase((y - vy) * RADIUS, (x - vx) * RADIUS)
            two = phase((y + vy) * RADIUS, (x + vx) * RADIUS)
            return wave(one - two)

        low, high = abs(vy) - 1, 1 - abs(vy)
        limits = (lambda y: ends(y)[0], lambda y: ends(y)[1])
        return dblquad(integrand, low, high, *limits, epsabs=1e-8, epsrel=1e-8)[0]

    return complex(part(math.cos), part(math.sin)) / math.pi


def coma(y, x):
    """Three radians at the edge, and a fourth-order term that isn't round."""
    y, x = y / RADIUS, x / RADIUS
    return 3 * x * (x**2 + y**2) - 2 * y + 1.5 * y**4


@pytest.mark.parametrize(("dtype", "bound"), [("float32", 1e-6), ("float64", 1e-13)])
@pytest.mark.parametrize("shape", [(6, 8), (7, 9), (6, 9), (1, 5), (1, 1)])
def test_that_of_a_picture_is_the_fourier_sum_around_the_origin(shape, dtype, bound, rng):
    plane = Plane(shape, (2e-6, 3e-6))
    psf = rng.random((2, *shape)).astype(dtype)
    value = transfer_function(psf, plane)
    fy, fx = (f.numpy().ravel() for f in rfft2_frequencies(plane))
    rows = np.exp(-2j * np.pi * np.outer(fy, positions(shape[0], 2e-6)))
    columns = np.exp(-2j * np.pi * np.outer(positions(shape[1], 3e-6), fx))
    truth = rows @ psf.astype(float) @ columns / psf.astype(float).sum((1, 2), keepdims=True)
    assert value.dtype == ("complex64" if dtype == "float32" else "complex128")
    assert relative(value, truth) <= bound
    assert np.abs(value[:, 0, 0] - 1).max() <= bound


@pytest.mark.parametrize("shape", [(64, 63), (65, 64)])
def test_a_gaussian_keeps_its_closed_form(shape):
    """exp(-2 pi² sigma² f²)."""
    sigma, plane = 3e-6, Plane(shape, (1.2e-6, 1.3e-6))
    y, x = (positions(n, p) for n, p in zip(shape, plane.pitch, strict=True))
    psf = np.exp(-(y[:, None] ** 2 + x[None, :] ** 2) / (2 * sigma**2))
    fy, fx = (f.numpy() for f in rfft2_frequencies(plane))
    truth = np.exp(-2 * np.pi**2 * sigma**2 * (fy**2 + fx**2))
    assert np.abs(transfer_function(psf, plane) - truth).max() <= 1e-6


def test_a_star_beside_the_origin_turns_the_phase():
    """One sample towards +x: exp(-2 pi i f pitch)."""
    plane = Plane((5, 8), (1e-6, 2e-6))
    psf = torch.zeros(5, 8, dtype=torch.float64)
    psf[2, 5] = 7
    fx = rfft2_frequencies(plane)[1]
    truth = torch.exp(-2j * math.pi * fx * 2e-6).expand(5, 5)
    assert torch.allclose(transfer_function(psf, plane), truth, atol=1e-14, rtol=0)


def test_the_airy_pattern_has_the_closed_form_of_a_clear_stop():
    """But for the light beside the window: the share 2 / (pi v) with v = 450 at its edge."""
    pitch = 0.4 / CUTOFF
    plane = Plane((720, 721), (pitch, pitch))
    y, x = (positions(n, pitch) for n in plane.shape)
    v = np.pi * CUTOFF * np.hypot(y[:, None], x[None, :])
    v[360, 360] = 1e-9
    fy, fx = (f.numpy() for f in rfft2_frequencies(plane))
    value = transfer_function((2 * scipy.special.j1(v) / v) ** 2, plane)
    assert np.abs(value - clear_stop(np.hypot(fy, fx) / CUTOFF)).max() <= 2e-3


@pytest.mark.parametrize(
    ("psf", "words"),
    [
        (torch.ones(1, 4), r"psf is \(1, 4\); its plane has \(4, 4\) samples"),
        (torch.zeros(4, 4), "psf sums to 0; it needs light"),
        (-torch.ones(4, 4), "psf sums to -16; it needs light"),
        (torch.full((4, 4), math.nan), "psf has 16 NaN"),
        (torch.ones(4, 4, dtype=torch.complex64), "psf is torch.complex64; give the light"),
    ],
)
def test_what_is_no_psf_is_refused(psf, words):
    with pytest.raises(ValueError, match=words):
        transfer_function(psf, Plane((4, 4), (1e-6, 1e-6)))


def test_a_dark_psf_among_others_is_refused():
    psf = torch.stack([torch.ones(4, 4), torch.zeros(4, 4)])
    with pytest.raises(ValueError, match="psf sums to 0"):
        transfer_function(psf, Plane((4, 4), (1e-6, 1e-6)))


def test_the_gradient_in_the_psf_equals_finite_differences(rng):
    psf = torch.from_numpy(rng.random((3, 4))).requires_grad_()
    plane = Plane((3, 4), (1e-6, 1e-6))
    assert torch.autograd.gradcheck(lambda p: transfer_function(p, plane), (psf,))


@pytest.mark.parametrize("dtype", [torch.complex64, torch.complex128])
def test_modulation_and_gradient_are_finite_at_and_near_a_zero(dtype):
    transfer = torch.tensor([0, 1e-30j, -3 + 4j, 1e-30], dtype=dtype, requires_grad=True)
    value = modulation_transfer(transfer)
    value.sum().backward()
    assert np.allclose(value.detach().numpy(), [0, 1e-30, 5, 1e-30], rtol=1e-6, atol=0)
    assert np.allclose(transfer.grad.numpy(), [0, 1j, -0.6 + 0.8j, 1], rtol=1e-6, atol=0)


def test_a_psf_that_makes_a_zero_has_a_gradient():
    """Two stars a sample apart cancel at the highest frequency."""
    psf = torch.tensor([[0.0, 1.0, 1.0, 0.0]], requires_grad=True)
    value = modulation_transfer(transfer_function(psf, Plane((1, 4), (1e-6, 1e-6))))
    value.sum().backward()
    assert float(value[0, 2].detach()) == 0
    assert torch.isfinite(psf.grad).all()


def test_modulation_answers_arrays_with_arrays():
    assert isinstance(modulation_transfer(np.array([3 + 4j])), np.ndarray)


@pytest.mark.parametrize("tol", [1e-2, 1e-6, 1e-12])
def test_a_lens_in_focus_has_its_closed_form(tol):
    v = np.concatenate([np.linspace(-1.2, 1.2, 101), [1e-9, 1 - 1e-9, 1e-4, 1 - 1e-4]])
    assert np.abs(lens_at(v, tol=tol).numpy() - clear_stop(v)).max() <= max(tol, 1e-14)


def test_a_lens_is_asked_on_a_grid_of_frequencies():
    fy, fx = rfft2_frequencies(Plane((32, 33), (2e-6, 1.5e-6)))
    value = lens_transfer_function(LENS, 2.0, WAVELENGTH, fy.numpy(), fx.numpy())
    truth = clear_stop(np.hypot(fy.numpy(), fx.numpy()) / CUTOFF)
    assert isinstance(value, np.ndarray)
    assert value.shape == (32, 17)
    assert value.dtype == np.complex128
    assert np.abs(value - truth).max() <= 1e-12


@pytest.mark.parametrize("phase", [None, coma])
def test_a_lens_is_one_at_zero_and_exactly_zero_from_the_cut_off_on(phase):
    value = lens_at([0.0, 1.0, 1.0001, 5.0, -1.0], waves=0.7, phase=phase)
    assert abs(complex(value[0]) - 1) <= 1e-14
    assert not value[1:].any()
    assert not lens_at([1.5, 2.0], waves=0.7, phase=phase).any()


@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-10])
@pytest.mark.parametrize("waves", [0.05, 0.64, 3.3, 38.0, -3.3])
def test_a_lens_out_of_focus_is_hopkins_series(waves, tol):
    v = np.array([1e-3, 0.03, 0.2, 0.5, 0.77, 0.99])
    truth = [hopkins_series(share, abs(waves)) for share in v]
    assert np.abs(lens_at(v, waves=waves, angle=0.9, tol=tol).numpy() - truth).max() <= tol


@pytest.mark.parametrize("waves", [0.05, 0.64, 3.3])
def test_series_and_adaptive_quadrature_agree(waves):
    """The judges among themselves."""
    for v in (0.03, 0.5, 0.99):
        assert hopkins_series(v, waves) == pytest.approx(hopkins_integral(v, waves), abs=1e-10)


def test_thousands_of_waves_are_no_trouble():
    v = np.array([1e-4, 0.01, 0.3, 0.9])
    truth = [hopkins_series(share, 2000.0) for share in v]
    assert np.abs(lens_at(v, waves=2000.0, tol=1e-9).numpy() - truth).max() <= 1e-9


@pytest.mark.parametrize("waves", [0.0, 0.64, 6.0])
def test_defocus_may_be_given_as_a_phase(waves):
    """Over both dimensions of the overlap, in place of Hopkins' integral."""
    v = np.array([0.0, 1e-3, 0.2, 0.5, 0.77, 0.99])
    truth = [hopkins_series(share, waves) if share * waves else clear_stop(share) for share in v]
    value = lens_at(v, angle=2.0, phase=defocus(waves), tol=1e-9)
    assert np.abs(value.numpy() - truth).max() <= 1e-9
    undone = lens_at(v, waves=waves, angle=2.0, phase=defocus(-waves), tol=1e-9)
    assert np.abs(undone.numpy() - clear_stop(v)).max() <= 1e-9


def test_a_tilt_shifts_the_picture():
    """By d, where the phase is 2 pi p d / (wavelength z): exp(-2 pi i f d)."""
    dy, dx = 3e-6, -7e-6
    fy, fx = (CUTOFF * torch.linspace(-0.8, 0.8, n, dtype=torch.float64) for n in (6, 7))
    value = lens_transfer_function(
        LENS, 2.0, WAVELENGTH, fy[:, None], fx,
        phase=lambda y, x: 2 * math.pi / SCALE * (y * dy + x * dx),
    ).numpy()  # fmt: skip
    fy, fx = fy.numpy()[:, None], fx.numpy()
    truth = clear_stop(np.hypot(fy, fx) / CUTOFF) * np.exp(-2j * np.pi * (fy * dy + fx * dx))
    assert np.abs(value - truth).max() <= 1e-6


@pytest.mark.parametrize("v", [(0.0, 0.3), (0.25, -0.4), (-0.55, 0.2), (0.6, 0.6)])
def test_an_aberration_agrees_with_adaptive_quadrature(v):
    fy, fx = (torch.tensor(part * CUTOFF, dtype=torch.float64) for part in v)
    value = lens_transfer_function(LENS, 2.0, WAVELENGTH, fy, fx, phase=coma)
    assert abs(complex(value) - overlap(v, coma)) <= 1e-6
    mirrored = lens_transfer_function(LENS, 2.0, WAVELENGTH, -fy, -fx, phase=coma)
    assert abs(complex(mirrored) - complex(value).conjugate()) <= 1e-12


def test_an_aberration_has_the_sign_of_the_psf_that_it_makes():
    """The Fourier sum of |Fourier sum of a sampled pupil|²; its jagged edge costs 1 %."""
    pitch = 0.45 / CUTOFF
    pupil = Plane((96, 96), (2 * RADIUS / 90, 2 * RADIUS / 90))
    image = Plane((80, 81), (pitch, pitch))
    y, x = positions(96, pupil.pitch[0])[:, None], positions(96, pupil.pitch[1])[None, :]
    wave = (np.hypot(y, x) <= RADIUS) * np.exp(1j * coma(y, x))
    psf = np.abs(direct_transform(wave, pupil, image, SCALE)) ** 2
    value = lens_transfer_function(
        LENS, 2.0, WAVELENGTH, *rfft2_frequencies(image), phase=coma
    ).numpy()
    error = np.abs(value - transfer_function(psf, image))
    assert error.max() <= 0.02
    assert np.abs(value.imag).max() >= 0.2


@pytest.mark.parametrize("seed", range(12))
def test_random_tolerances_are_kept(seed):
    """Defocus by distance and by phase, and a tilt: Hopkins' series, shifted."""
    rng = np.random.default_rng(seed)
    tol, total = 10 ** rng.uniform(-10, -1), 10 ** rng.uniform(-1.5, 1.2)
    share, d = rng.uniform(-0.5, 1.5), rng.uniform(-2e-5, 2e-5)
    v, angle = rng.uniform(0.01, 0.99, 5), rng.uniform(0, 2 * np.pi)
    value = lens_at(
        v, waves=total * share, angle=angle, tol=tol,
        phase=lambda y, x: defocus(total * (1 - share))(y, x) + 2 * math.pi / SCALE * y * d,
    ).numpy()  # fmt: skip
    shift = np.exp(-2j * np.pi * CUTOFF * v * np.sin(angle) * d)
    assert np.abs(value - shift * [hopkins_series(share, total) for share in v]).max() <= tol


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_the_gradient_in_the_phase_equals_finite_differences(angle):
    """Zero frequency and the cut-off among the values; and the gradient's gradient."""

    def value(strength: torch.Tensor) -> torch.Tensor:
        def phase(y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
            y, x = y / RADIUS, x / RADIUS
            return strength[0] * x**3 + strength[1] * (x**2 + y**2) ** 2 + strength[2] * y

        return lens_at([0.0, 0.3, 0.999, 1.0, 1.1], angle=angle, phase=phase, tol=1e-12)

    strength = torch.tensor([1.0, -2.0, 0.4], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(value, (strength,))
    assert torch.autograd.gradgradcheck(lambda s: value(s).abs(), (strength,), atol=1e-4)


def test_a_gradient_over_a_picture_passes():
    strength = torch.tensor(2.0, requires_grad=True)
    fy, fx = rfft2_frequencies(Plane((24, 24), (1.5e-6, 1.5e-6)))
    value = lens_transfer_function(
        LENS, 2.0, WAVELENGTH, fy, fx, phase=lambda y, x: strength * x * y**2 / RADIUS**3
    )
    modulation_transfer(value).sum().backward()
    assert torch.isfinite(strength.grad)
    assert float(strength.grad) < 0


def test_a_phase_that_is_too_steep_is_refused_and_the_advice_works():
    v = [0.2, 0.5]
    with pytest.raises(ToleranceError, match=r"512 nodes a side.* ask for tol .* less steep"):
        lens_at(v, phase=defocus(3000.0), tol=1e-9)

    def rough(y, x):
        return 3 * torch.abs(y / RADIUS - 0.1)

    with pytest.raises(ToleranceError, match="ask for tol") as caught:
        lens_at(v, angle=1.0, phase=rough, tol=1e-11)
    advised = float(str(caught.value).split("ask for tol ")[1].split()[0])
    assert 1e-11 < advised < 1e-3
    assert torch.isfinite(torch.view_as_real(lens_at(v, angle=1.0, phase=rough, tol=advised))).all()


def test_a_phase_may_be_a_number_or_a_numpy_function():
    v = np.array([0.1, 0.6])
    assert np.abs(lens_at(v, phase=lambda y, x: 1.5).numpy() - clear_stop(v)).max() <= 1e-12
    value = lens_at(v, phase=lambda y, x: np.asarray(defocus(0.64)(y.numpy(), x.numpy())))
    assert np.abs(value.numpy() - [hopkins_series(share, 0.64) for share in v]).max() <= 1e-6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"distance": 0.0}, "distance is 0 m"),
        ({"wavelength": math.nan}, "wavelength is nan m"),
        ({"tol": 0.0}, "tol 0 can't be kept; ask for tol 1e-12 or more"),
        ({"tol": math.nan}, "tol nan can't be kept"),
        ({"fy": torch.tensor([0.0, math.inf])}, "fy has 1 NaN or infinite values of 2"),
        ({"fx": torch.tensor([math.nan])}, "fx has 1 NaN or infinite values of 1"),
        ({"fy": torch.ones(3)}, r"fy is \(3,\) and fx is \(2,\); give shapes that broadcast"),
        ({"phase": lambda y, x: y * math.nan}, "phase has .* NaN"),
        ({"phase": lambda y, x: torch.ones(7)}, r"phase answers \(7,\) for positions"),
        ({"phase": lambda y, x: y + 1j}, "phase answers torch.complex128; it must answer"),
    ],
)
def test_what_makes_no_transfer_function_is_refused(change, words):
    settings = {
        "distance": 2.0,
        "wavelength": WAVELENGTH,
        "fy": torch.zeros(2),
        "fx": torch.tensor([0.0, 1e5]),
    }
    with pytest.raises(ValueError, match=words):
        lens_transfer_function(LENS, **settings | change)


def test_nothing_asked_is_nothing_answered():
    assert lens_at(np.zeros(0)).shape == (0,)


def slit(u, waves=0.0) -> np.ndarray:
    """A clear slit: the overlap's length times a sinc (Goodman 6.4)."""
    h = np.clip(1 - np.abs(u) / 2, 0, None)
    return h * np.sinc(4 * u * waves * h)


def cubic_ambiguity(strength: float, u: float, v: float) -> complex:
    """Of exp(i strength x³), by the error function of a complex number.

    The phases' difference is strength (3 u x² + u³ / 4).
    """
    h, b, c = 1 - abs(u) / 2, 3 * strength * u, 2 * np.pi * v
    root = np.sqrt(-1j * b)
    ends = scipy.special.erf(root * (np.array([-h, h]) + c / (2 * b)))
    whole = np.sqrt(np.pi) / (2 * root) * (ends[1] - ends[0]) * np.exp(-1j * c**2 / (4 * b))
    return whole * np.exp(1j * strength * u**3 / 4) / 2


@pytest.mark.parametrize("tol", [1e-6, 1e-12])
def test_a_clear_slit_has_its_closed_form(tol):
    """Over the polar display, edges and outside included."""
    u, v = np.linspace(-2.2, 2.2, 45), np.linspace(-30, 30, 41)[:, None]
    value = ambiguity_function(None, u, v, tol=tol)
    h = np.clip(1 - np.abs(u) / 2, 0, None)
    assert isinstance(value, np.ndarray)
    assert value.shape == (41, 45)
    assert np.abs(value - h * np.sinc(2 * h * v)).max() <= tol
    assert not value[:, np.abs(u) >= 2].any()
    assert abs(value[20, 22] - 1) <= 1e-14


def test_a_cubic_phase_plate_has_its_closed_form():
    u, v = np.array([-1.7, -0.4, 0.05, 0.8, 1.9]), np.array([-12.0, 0.0, 3.3])[:, None]
    truth = np.array([[cubic_ambiguity(30.0, a, b) for a in u] for b in v[:, 0]])
    assert np.abs(ambiguity_function(lambda x: 30 * x**3, u, v) - truth).max() <= 1e-6


@pytest.mark.parametrize("waves", [0.0, 0.5, -4.0, 300.0])
def test_a_defocused_slit_has_its_closed_form(waves):
    u = np.linspace(-2, 2, 81)
    value = defocused_transfer_function(None, u, np.array(waves))
    assert np.abs(value - slit(u, waves)).max() <= 1e-6


@pytest.mark.parametrize("waves", [0.5, 4.0])
def test_defocus_in_the_phase_is_the_slanted_line(waves):
    """Eq. 2.40 itself: in focus with the defocus in the pupil, or beside it."""
    u = np.linspace(-2, 2, 81)
    value = defocused_transfer_function(lambda x: 2 * math.pi * waves * x**2, u, np.array(0.0))
    assert np.abs(value - slit(u, waves)).max() <= 1e-6


def test_that_of_a_slit_is_the_conjugate_of_the_psf_s_fourier_transform():
    """A plate that is neither odd nor even, out of focus, by sums over 400 points in the slit."""

    def plate(x):
        return 8 * x**3 - 3 * x**4

    waves, n = 0.7, 400
    x = (np.arange(n) + 0.5) * 2 / n - 1
    wave = np.exp(1j * (plate(x) + 2 * np.pi * waves * x**2))
    place = np.arange(-800, 800) * 0.2  # turns per half-width; Nyquist is 0.25
    psf = np.abs(np.exp(-2j * np.pi * np.outer(place, x)) @ wave) ** 2
    u = np.linspace(-1.9, 1.9, 20)
    truth = np.exp(-2j * np.pi * np.outer(u, place)) @ psf / psf.sum()
    value = defocused_transfer_function(plate, u, np.array(waves))
    assert np.abs(value.conj() - truth).max() <= 5e-3
    assert np.abs(truth.imag).max() > 0.1


def test_a_strong_cubic_plate_nears_the_stationary_phase():
    """|H| = sqrt(pi / (12 strength |u|)) at any defocus (10.1364/AO.34.001859)."""
    strength = 1500.0
    u, waves = torch.linspace(0.2, 1.2, 41), torch.tensor([[0.0], [5.0], [30.0]])
    value = modulation_transfer(
        defocused_transfer_function(lambda x: strength * x**3, u, waves)
    ).numpy()
    truth = np.sqrt(np.pi / (12 * strength * u.numpy()))
    assert np.abs(value / truth - 1).max() <= 0.1


def test_a_cubic_plate_hides_the_defocus_that_a_clear_slit_shows():
    u = torch.linspace(0.1, 1.5, 30)
    for phase, low, high in ((lambda x: 90 * x**3, 0.5, 2.0), (None, 0.0, 0.2)):
        sharp, blurred = (
            modulation_transfer(defocused_transfer_function(phase, u, torch.tensor(w)))
            for w in (0.0, 3.0)
        )
        ratio = blurred / sharp
        assert low <= float(ratio.min()) <= float(ratio.median()) <= high


def test_the_gradient_in_a_slit_s_phase_equals_finite_differences():
    def value(strength: torch.Tensor) -> torch.Tensor:
        u = torch.tensor([0.0, 0.5, -1.3, 2.0], dtype=torch.float64)
        return defocused_transfer_function(
            lambda x: strength[0] * x**3 + strength[1] * x**5, u, torch.tensor(0.3), tol=1e-12
        )

    strength = torch.tensor([5.0, -3.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(value, (strength,))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"shift": torch.tensor([math.nan, 1.0])}, "shift has 1 NaN or infinite values of 2"),
        ({"frequency": torch.tensor(math.inf)}, "frequency has 1 NaN"),
        ({"shift": torch.ones(3)}, r"shift is \(3,\) and frequency is \(2,\); give shapes"),
        ({"tol": -1.0}, "tol -1 can't be kept; ask for tol 1e-12 or more"),
        ({"phase": lambda x: x * math.inf}, "phase has .* NaN or infinite values"),
        ({"phase": lambda x: 1e6 * x**3}, "16384 nodes a side, for a phase that turns by"),
    ],
)
def test_what_makes_no_ambiguity_function_is_refused(change, words):
    settings = {"phase": None, "shift": torch.ones(2), "frequency": torch.zeros(2)}
    with pytest.raises(ValueError, match=words):
        ambiguity_function(**settings | change)


def test_defocused_transfer_names_its_own_arguments():
    with pytest.raises(ValueError, match="waves has 1 NaN"):
        defocused_transfer_function(None, torch.ones(2), torch.tensor(math.nan))
