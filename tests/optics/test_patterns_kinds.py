"""Patterns against formulas, and against where they send the light."""

import math
from pathlib import Path

import cv2
import mpmath
import numpy as np
import pytest
import torch
from judges import positions
from scipy.integrate import cumulative_trapezoid
from scipy.special import jv

from optics.camera import Camera, Lens, Panel, Sensor
from optics.patterns import (
    annular_phase_mask,
    axicon,
    binary_grating,
    blazed_grating,
    constant_phase,
    cubic_phase_mask,
    fresnel_lens,
    logarithmic_asphere,
    random_patches,
    sine_grating,
    steering_grating,
    superpose,
    zernike_pattern,
)
from optics.psf import PSFOperator

WAVELENGTH = 550e-9
PANEL = Panel(shape=(48, 64), pitch=40e-6, unmodulated=0.0)
CAMERA = Camera(PANEL, Lens(), Sensor(pitch=6e-6))
DISTANCE = CAMERA.lens.image_distance
PUBLISHED = Path(__file__).parents[3] / "shared/data/thesis/phase_retrieval/results"


def mesh(panel: Panel = PANEL) -> tuple[np.ndarray, np.ndarray]:
    y, x = (positions(n, panel.pitch) for n in panel.shape)
    return y[:, None], x[None, :]


def picture(phase: torch.Tensor, distance: float = 2.0, side: int = 81) -> np.ndarray:
    """What a point at a distance looks like on the sensor."""
    pixels = CAMERA.sensor.window_plane((side, side))
    return PSFOperator(CAMERA, distance, WAVELENGTH, pixels, integrate=False)(phase).numpy()


def brightest(phase: torch.Tensor) -> tuple[float, float]:
    """(y, x) in metres of the brightest pixel."""
    light = picture(phase)
    row, column = np.unravel_index(light.argmax(), light.shape)
    return (row - 40) * 6e-6, (column - 40) * 6e-6


def orders(row: torch.Tensor) -> np.ndarray:
    """The share of light in every order of a periodic row of pixels."""
    return np.abs(np.fft.fft(np.exp(1j * row.numpy())) / row.numel()) ** 2


def similarity(one: np.ndarray, other: np.ndarray) -> float:
    return float((one * other).sum() / np.linalg.norm(one) / np.linalg.norm(other))


def test_a_lens_off_the_centre_is_a_lens_and_a_tilt():
    y, x = mesh()
    truth = -np.pi / (WAVELENGTH * 3.0) * ((y - 2e-4) ** 2 + (x + 1e-4) ** 2)
    assert np.allclose(fresnel_lens(PANEL, 3.0, WAVELENGTH, (2e-4, -1e-4)).numpy(), truth)


def test_a_lens_wraps_exactly():
    """What is left of hundreds of waves, against fifty digits."""
    panel = Panel()
    phase = fresnel_lens(panel, -0.25, WAVELENGTH)
    for row, column in ((0, 0), (1079, 3), (17, 1919), (540, 1)):
        with mpmath.workdps(50):
            r2 = mpmath.mpf(panel.pitch) ** 2 * ((row - 540) ** 2 + (column - 960) ** 2)
            turns = r2 / (2 * mpmath.mpf(WAVELENGTH) * mpmath.mpf(0.25))
            truth = float(turns - mpmath.floor(turns)) * 2 * math.pi
        assert turns > 100
        left = float(phase[row, column] % (2 * math.pi))
        assert abs(math.remainder(left - truth, 2 * math.pi)) < 1e-11


def test_a_cubic_pattern_is_the_thesis_formula():
    """gamma (x³ + y³), thesis Eq. 2.41, with 1 at half the longer side."""
    y, x = mesh()
    half = 32 * PANEL.pitch
    truth = 9.0 * ((x / half) ** 3 + (y / half) ** 3)
    assert np.allclose(cubic_phase_mask(PANEL, 9.0).numpy(), truth)
    assert np.allclose(cubic_phase_mask(PANEL, 2.0, half / 2).numpy(), truth * 2 / 9 * 8)


def test_a_cubic_pattern_makes_the_psf_indifferent_to_distance():
    """What changes the plain PSF beyond recognition hardly changes the coded one."""
    coded, plain = cubic_phase_mask(PANEL, 30.0), constant_phase(PANEL)
    assert similarity(picture(plain), picture(plain, 0.9)) < 0.3
    assert similarity(picture(coded), picture(coded, 0.9)) > 0.95


def test_an_annular_pattern_spreads_light_alike_at_all_distances():
    """The share of light within any radius, in focus and out of it."""
    y, x = np.indices((81, 81)) - 40
    ring = np.hypot(y, x).round().astype(int).ravel()

    def within(phase: torch.Tensor, distance: float) -> np.ndarray:
        return np.cumsum(np.bincount(ring, picture(phase, distance).ravel()))[:41]

    def change(phase: torch.Tensor) -> float:
        return np.abs(within(phase, 2.0) - within(phase, 0.9)).max()

    assert change(constant_phase(PANEL)) > 0.5
    assert change(annular_phase_mask(PANEL, 4, 7.0)) < 0.1


def test_an_annular_pattern_has_so_many_equal_rings():
    panel = Panel(shape=(11, 402), pitch=1e-5)
    ray = annular_phase_mask(panel, 4, 3.0, 2e-3).numpy()[5, 201:]
    # 50 pixels a ring: a parabola from 0 over 3 rad back to 0, and nothing beyond 200 pixels.
    inside = (np.arange(50) - 25) / 25
    truth = np.concatenate([np.tile(3.0 * (1 - inside**2), 4), np.zeros(1)])
    assert np.allclose(ray, truth, atol=1e-9)


LARGE = Camera(
    Panel(shape=(256, 256), pitch=40e-6, unmodulated=0.0), Lens(f_number=12.5), CAMERA.sensor
)
STOP = LARGE.lens.stop_diameter / 2


def asphere(near: float, far: float, radius: float = STOP) -> torch.Tensor:
    focus = LARGE.lens.focus_distance
    return logarithmic_asphere(LARGE.panel, near, far, focus, WAVELENGTH, radius)


def test_a_logarithmic_asphere_has_each_zone_in_focus_for_a_distance_of_its_own():
    """Where pattern, lens and wave of an object add up to a stationary phase, which is found by
    the phase's slope; beyond the radius it stays at the farthest distance."""
    middle = LARGE.panel.shape[0] // 2
    x = positions(256, LARGE.panel.pitch)[middle + 5 :]
    slope = np.gradient(asphere(1.5, 3.0, 4e-3).numpy()[middle, middle + 5 :], x)[1:-1]
    power = 1 / 2.0 - slope * WAVELENGTH / (2 * math.pi * x[1:-1])
    truth = 1.5 + 1.5 * np.minimum(x[1:-1] / 4e-3, 1) ** 2
    # Differences over the rim's kink are neither side's.
    away = np.abs(x[1:-1] - 4e-3) > 1.5 * LARGE.panel.pitch
    assert np.allclose((1 / power)[away], truth[away], rtol=1e-3)


def test_a_logarithmic_asphere_of_one_distance_is_a_lens():
    lens = fresnel_lens(LARGE.panel, 1 / (1 / 1.5 - 1 / 2.0), WAVELENGTH)
    assert np.allclose(asphere(1.5, 1.5 * (1 + 1e-7)).numpy(), lens.numpy(), atol=1e-4)


def test_a_logarithmic_asphere_lights_its_whole_focal_line():
    """On the axis, against the integral over the stop's area with the zones' own distances; and
    in the mean 2 wavelength s² / ((far - near) radius²) of the light in focus, by stationary
    phase, about which the rim's wave ripples. A plain lens leaves nothing there."""

    def on_axis(phase: torch.Tensor, distance: float) -> float:
        pixels = LARGE.sensor.window_plane((1, 1))
        operator = PSFOperator(LARGE, distance, WAVELENGTH, pixels, integrate=False)
        return float(operator(phase))

    area = np.linspace(0, STOP**2, 100_001)
    zone = 1.5 + 1.5 * area / STOP**2

    def by_zones(distance: float) -> float:
        path = cumulative_trapezoid(1 / zone - 1 / distance, area, initial=0)
        field = np.trapezoid(np.exp(-1j * math.pi / WAVELENGTH * path), area)
        return float(abs(field) ** 2 / STOP**4)

    coded, plain = asphere(1.5, 3.0), constant_phase(LARGE.panel)
    best, distances = on_axis(plain, 2.0), np.linspace(1.7, 2.7, 15)
    seen = np.array([on_axis(coded, s) / best for s in distances])
    assert np.allclose(seen, [by_zones(s) for s in distances], rtol=0.01)
    assert np.mean(seen * STOP**2 / (2 * WAVELENGTH * distances**2)) == pytest.approx(1 / 1.5, 0.1)
    assert on_axis(plain, 1.7) / best < 1e-3 * seen[0]


@pytest.mark.parametrize(
    ("near", "far", "message"),
    [
        (2.0, 1.0, "far is 1 m; it must be finite and more than near, 2 m"),
        (2.0, math.inf, "far is inf m"),
        (-1.0, 1.0, "near"),
        (0.2, 0.3, r"near 0.2 m or far 0.3 m changes the phase .* within 1.34 /m of 1/focus, 0.5"),
    ],
)
def test_a_logarithmic_asphere_that_cannot_be_is_refused(near, far, message):
    with pytest.raises(ValueError, match=message):
        asphere(near, far)


def test_the_rings_of_an_annular_pattern_fill_the_panel():
    """Without a radius, the last one ends in the corners."""
    panel = Panel(shape=(31, 41))
    phase = annular_phase_mask(panel, 3, 1.0)
    width = math.hypot(31, 41) / 2 / 3
    y, x = (np.arange(n) - n // 2 for n in panel.shape)
    place = np.hypot(y[:, None], x) / width
    truth = 1 - (2 * (place % 1) - 1) ** 2
    assert np.allclose(phase.numpy(), truth)


@pytest.mark.parametrize("direction", [0.0, math.pi / 2, 2.0, -0.7])
def test_a_blazed_grating_sends_light_to_one_side(direction):
    """The grating equation: wavelength distance / period."""
    period = 12.0
    away = WAVELENGTH * DISTANCE / (period * PANEL.pitch)
    y, x = brightest(blazed_grating(PANEL, period, direction))
    assert y == pytest.approx(away * math.sin(direction), abs=3.1e-6)
    assert x == pytest.approx(away * math.cos(direction), abs=3.1e-6)


@pytest.mark.parametrize("shift", [(60e-6, -120e-6), (0.0, 90e-6)])
def test_a_steered_pattern_shifts_the_psf(shift):
    assert brightest(steering_grating(PANEL, shift, DISTANCE, WAVELENGTH)) == pytest.approx(
        shift, abs=3.1e-6
    )


def test_a_binary_grating_of_half_a_wave_leaves_nothing_in_the_middle():
    """Orders of sampled stripes: (2 / N) / sin(pi k / N) in amplitude, for odd k."""
    row = binary_grating(Panel(shape=(2, 96)), 8, math.pi)[0]
    light = orders(row)
    assert light[0] < 1e-30
    for k in (1, 3):
        share = (2 / 8 / math.sin(math.pi * k / 8)) ** 2
        assert light[12 * k] == pytest.approx(share)
        assert light[-12 * k] == pytest.approx(share)


def test_the_stripes_of_a_binary_grating_begin_at_the_origin():
    """Which is pixel 8 // 2, a period from the edge."""
    assert binary_grating(Panel(shape=(1, 8)), 4, 1.5)[0].tolist() == [0, 0, 1.5, 1.5] * 2
    turned = binary_grating(Panel(shape=(8, 1)), 4, 1.5, math.pi / 2)[:, 0]
    assert turned.tolist() == [0, 0, 1.5, 1.5] * 2


@pytest.mark.parametrize(("period", "amplitude"), [(32, 2.4), (8, 1.1)])
def test_a_sine_spreads_light_over_orders_as_bessel_functions_do(period, amplitude):
    """exp(i a sin t) = sum of J_k(a) exp(i k t), Jacobi and Anger."""
    light = orders(sine_grating(Panel(shape=(2, 64)), amplitude, period)[0])
    for k in range(4):
        assert light[k * 64 // period] == pytest.approx(jv(k, amplitude) ** 2, abs=2e-4)


def test_a_sine_waves_in_its_direction():
    y, x = mesh()
    along = (x * math.cos(0.4) + y * math.sin(0.4)) / PANEL.pitch
    truth = 1.5 * np.sin(2 * np.pi * along / 20)
    assert np.allclose(sine_grating(PANEL, 1.5, 20, 0.4).numpy(), truth)


def test_patches_are_rectangles_of_uniform_phases():
    panel = Panel(shape=(90, 160))
    phase = random_patches(panel, (9, 16), torch.Generator().manual_seed(3), 5.0).numpy()
    blocks = phase.reshape(9, 10, 16, 10)
    assert (blocks == blocks[:, :1, :, :1]).all()
    assert len(np.unique(phase)) == 9 * 16
    values = np.sort(blocks[:, 0, :, 0].ravel()) / 5.0
    # Kolmogorov and Smirnov: 1.63 / sqrt(n) is passed once in a hundred times.
    assert np.abs(values - (np.arange(144) + 0.5) / 144).max() < 1.63 / 12


def test_patches_come_from_the_generator_alone():
    panel = Panel(shape=(10, 10))
    seeds = (1, 1, 2)
    one, same, other = (
        random_patches(panel, (5, 5), torch.Generator().manual_seed(seed)) for seed in seeds
    )
    assert (one == same).all()
    assert not (one == other).any()


def test_patches_that_do_not_divide_the_panel_differ_by_a_pixel():
    phase = random_patches(Panel(shape=(7, 3)), (3, 2), torch.Generator().manual_seed(0))
    heights = np.unique(phase[:, 0].numpy(), return_counts=True)[1]
    assert sorted(heights) == [2, 2, 3]


@pytest.mark.parametrize(
    ("n", "m", "truth"),
    [
        (2, 0, lambda r, t: math.sqrt(3) * (2 * r**2 - 1)),
        (3, 1, lambda r, t: math.sqrt(8) * (3 * r**3 - 2 * r) * np.cos(t)),
        (2, -2, lambda r, t: math.sqrt(6) * r**2 * np.sin(2 * t)),
        (4, 0, lambda r, t: math.sqrt(5) * (6 * r**4 - 6 * r**2 + 1)),
    ],
)
def test_zernike_patterns_are_nolls_polynomials(n, m, truth):
    """Noll 1976, Table I, in radians of a path of 60 nm."""
    y, x = (axis / 1.5e-3 for axis in mesh())
    expected = 2 * math.pi * 60e-9 / WAVELENGTH * truth(np.hypot(y, x), np.arctan2(y, x))
    phase = zernike_pattern(PANEL, [(n, m, 60e-9)], 1.5e-3, WAVELENGTH)
    assert np.allclose(phase.numpy(), expected, atol=1e-9)


def test_zernike_patterns_undo_the_aberrations_of_a_lens():
    """The PSF is that of the perfect lens."""
    terms = ((4, 0, 80e-9), (3, -1, -90e-9))
    radius = CAMERA.lens.stop_diameter / 2
    aberrant = Camera(PANEL, Lens(aberrations=terms), CAMERA.sensor)
    pixels = CAMERA.sensor.window_plane((21, 21))
    operator = PSFOperator(aberrant, 2.0, WAVELENGTH, pixels, integrate=False)
    undone = [(n, m, -path) for n, m, path in terms]
    seen = operator(zernike_pattern(PANEL, undone, radius, WAVELENGTH)).numpy()
    truth = picture(constant_phase(PANEL), side=21)
    assert similarity(seen, truth) > 0.999
    assert seen.sum() == pytest.approx(truth.sum(), rel=0.01)


def test_a_sum_is_a_sum():
    parts = [sine_grating(PANEL, 1.0, 20), cubic_phase_mask(PANEL, 3.0), constant_phase(PANEL, 2.0)]
    assert torch.equal(superpose(PANEL, *parts), parts[0] + parts[1] + parts[2])
    assert not superpose(PANEL).any()
    given = superpose(PANEL, parts[0].numpy())
    assert isinstance(given, np.ndarray)


def test_a_sum_may_be_too_steep_though_its_parts_are_not():
    parts = [blazed_grating(PANEL, 3.0), blazed_grating(PANEL, 4.0)]
    with pytest.raises(ValueError, match=r"the sum changes .* 1\.17 pi .* all by 0\.857 for"):
        superpose(PANEL, *parts)
    superpose(PANEL, *(0.857 * part for part in parts))


def test_parts_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"a part is \(2, 2\) pixels; the panel has \(48, 64\)"):
        superpose(PANEL, torch.zeros(2, 2))


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: constant_phase(PANEL, math.nan), "phase is nan"),
        (lambda: fresnel_lens(PANEL, 1.0, WAVELENGTH, (math.inf, 0.0)), r"centre .* finite"),
        (lambda: cubic_phase_mask(PANEL, math.inf), "strength is inf"),
        (lambda: cubic_phase_mask(PANEL, 1.0, 0.0), "radius is 0 m; it must be positive"),
        (lambda: annular_phase_mask(PANEL, 0, 1.0), "rings is 0; choose 1 to 20"),
        (lambda: annular_phase_mask(PANEL, 21, 0.1), "rings is 21; choose 1 to 20"),
        (lambda: annular_phase_mask(PANEL, 3, math.nan), "depth is nan"),
        (lambda: annular_phase_mask(PANEL, 1, 1.0, 70e-6), "a ring needs at least 8e-05 m"),
        (lambda: blazed_grating(PANEL, 0.0), "period is 0 pixels; it must be positive"),
        (lambda: blazed_grating(PANEL, 5.0, math.nan), "direction is nan"),
        (lambda: steering_grating(PANEL, (0.0, math.nan), 0.1, WAVELENGTH), "shift .* finite"),
        (lambda: steering_grating(PANEL, (0.0, 0.0), 0.0, WAVELENGTH), "distance is 0 m"),
        (lambda: binary_grating(PANEL, 1.9, 1.0), "period is 1.9 pixels; stripes need at least 2"),
        (lambda: binary_grating(PANEL, 4, math.inf), "step is inf"),
        (lambda: sine_grating(PANEL, 0.1, 3.9), "period is 3.9 pixels; choose at least 4"),
        (lambda: sine_grating(PANEL, math.nan, 8.0), "amplitude is nan"),
        (
            lambda: random_patches(PANEL, (49, 2), torch.Generator()),
            "patches has 49 rows; choose 1 to 48",
        ),
        (lambda: random_patches(PANEL, (2, 0), torch.Generator()), "0 columns; choose 1 to 64"),
        (lambda: random_patches(PANEL, (2, 2), torch.Generator(), 0.0), "depth is 0 rad"),
        (
            lambda: zernike_pattern(PANEL, [(3, 2, 1e-9)], 1e-3, WAVELENGTH),
            r"\(3, 2\) doesn't exist",
        ),
        (
            lambda: zernike_pattern(PANEL, [(2, 0, math.nan)], 1e-3, WAVELENGTH),
            r"\(2, 0\) is nan m",
        ),
        (lambda: zernike_pattern(PANEL, [(2, 0, 1e-9)], -1.0, WAVELENGTH), "radius is -1 m"),
        (lambda: zernike_pattern(PANEL, [(80, 0, 1e-9)], 1e-8, WAVELENGTH), "polynomials overflow"),
        (lambda: superpose(PANEL, torch.full((48, 64), math.nan)), "a part has 3072 NaN"),
    ],
)
def test_what_cannot_be_shown_is_refused_by_name(ask, words):
    with pytest.raises(ValueError, match=words):
        ask()


@pytest.mark.shared
@pytest.mark.skipif(not PUBLISHED.is_dir(), reason="lies beside the checkout")
def test_an_axicon_is_the_one_that_the_thesis_shows():
    """Its published grey levels turn once in 24 pixels of radius: a ring of 80 of 1920 pixels.

    Their middle is a pixel before ours, on both axes.
    """
    found = PUBLISHED / "phase_pattern_images/r_80p/backup/axiconProfile.png"
    grey = cv2.imread(str(found), cv2.IMREAD_GRAYSCALE)
    panel = Panel()
    radius = WAVELENGTH * DISTANCE / (24 * panel.pitch)
    ours = axicon(panel, radius, DISTANCE, WAVELENGTH).numpy()
    agreement = np.exp(1j * (ours[1:, 1:] - 2 * np.pi * grey[:-1, :-1] / 255)).mean()
    assert abs(agreement) > 0.9999
