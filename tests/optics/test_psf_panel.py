"""The PSF against closed forms, and against quadrature that shares nothing with it."""

import gc
import itertools
import math
import weakref
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from judges import by_panel, line_density, positions, quadrature_psf, relative
from judges.view import View
from scipy.integrate import quad
from scipy.special import fresnel, j1
from sweeps import some

from optics.accuracy import ToleranceError
from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.stop import Circle, Stop
from optics.plane import Plane
from optics.psf import PSFOperator, psf

WAVELENGTH = 550e-9


def with_panel(camera: Camera, **changes) -> Camera:
    return replace(camera, panel=replace(camera.panel, **changes))


def scale_of(camera: Camera) -> float:
    return WAVELENGTH * camera.lens.image_distance


def random_phase(camera: Camera, seed: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).uniform(0, 2 * np.pi, camera.panel.shape))


def line_on_pixels(camera: Camera, n: int, pixels: int) -> np.ndarray:
    def density(u: float) -> float:
        return line_density(camera, n, WAVELENGTH, u)

    p = camera.sensor.pitch
    centres = positions(pixels, p)
    return np.array([quad(density, c - p / 2, c + p / 2, epsabs=1e-12)[0] for c in centres])


@pytest.mark.parametrize("fill_factor", [1.0, 0.81])
@pytest.mark.parametrize("shape", [(24, 32), (25, 31)])
def test_a_neutral_rectangle_gives_the_analytic_pattern_on_pixels(small_camera, shape, fill_factor):
    """sinc² for a full panel, the grating function under sinc² for one with gaps."""
    camera = with_panel(small_camera, shape=shape, fill_factor=fill_factor)
    result = psf(
        camera,
        torch.zeros(shape),
        distance=2.0,
        wavelength=WAVELENGTH,
        pixels=camera.sensor.window_plane((14, 15)),
        tol=1e-3,
    )
    truth = np.outer(line_on_pixels(camera, shape[0], 14), line_on_pixels(camera, shape[1], 15))
    if fill_factor == 1.0:
        middle = (shape[0] * shape[1]) * (camera.panel.pitch * camera.sensor.pitch) ** 2
        assert truth.max() < middle / scale_of(camera) ** 2  # the analytic peak density
    assert relative(result.value.numpy(), truth) <= 1e-4


def test_a_small_round_stop_gives_airys_pattern_with_its_exact_area():
    """Density A / (wavelength z)² (2 J1(x) / x)², x = pi D r / (wavelength z)."""
    diameter = 0.8e-3
    lens = Lens(focal_length=0.125, f_number=0.125 / diameter, focus_distance=2.0)
    panel = Panel(shape=(90, 96), pitch=10e-6, fill_factor=1.0, unmodulated=0.0)
    camera = Camera(panel, lens, Sensor(pitch=12e-6))
    operator = PSFOperator(
        camera, 2.0, WAVELENGTH, camera.sensor.window_plane((25, 24)), integrate=False
    )
    value = operator(torch.zeros(panel.shape))
    y, x = positions(25, 12e-6)[:, None], positions(24, 12e-6)[None, :]
    argument = np.pi * diameter * np.hypot(y, x) / scale_of(camera)
    argument[12, 12] = 1.0
    airy = (2 * j1(argument) / argument) ** 2
    airy[12, 12] = 1.0
    truth = airy * math.pi / 4 * diameter**2 * (12e-6 / scale_of(camera)) ** 2
    # 80 pixels across the stop: its staircase costs about (1/80)².
    assert relative(value.numpy(), truth) <= 5e-4


def test_the_orders_of_a_neutral_panel_share_the_light_as_its_gaps_say(small_camera):
    """Order (m, n) gets F sinc²(m sqrt F) sinc²(n sqrt F); all orders together all light."""
    scale, pitch = scale_of(small_camera), small_camera.panel.pitch
    # Samples that divide an order into 32, so that each window sum is an exact mean.
    fine = replace(small_camera, sensor=Sensor(pitch=scale / pitch / 32))
    orders = 9
    operator = PSFOperator(
        fine, 2.0, WAVELENGTH, fine.sensor.window_plane((32 * orders, 32 * orders)), integrate=False
    )
    light = operator(torch.zeros(fine.panel.shape)).numpy()
    blocks = light.reshape(orders, 32, orders, 32)
    side = math.sqrt(small_camera.panel.fill_factor)
    peaks = blocks[:, 16, :, 16] / blocks[4, 16, 4, 16]
    m = np.arange(orders) - orders // 2
    assert np.allclose(peaks, np.outer(np.sinc(m * side), np.sinc(m * side)) ** 2, atol=1e-6)
    # At the order itself F; the side lobes of 24 pixels leave a few percent around it.
    axis_24, axis_32 = (
        sum(line_density(fine, n, WAVELENGTH, u) for u in positions(32, fine.sensor.pitch))
        * fine.sensor.pitch
        for n in fine.panel.shape
    )
    assert blocks.sum((1, 3))[4, 4] == pytest.approx(axis_24 * axis_32, rel=1e-5)
    assert blocks.sum((1, 3))[4, 4] == pytest.approx(small_camera.panel.fill_factor, rel=0.02)
    whole = [
        sum(line_density(fine, n, WAVELENGTH, u) for u in positions(32 * orders, fine.sensor.pitch))
        * fine.sensor.pitch
        for n in fine.panel.shape
    ]
    assert light.sum() == pytest.approx(whole[0] * whole[1], rel=1e-5)
    assert 0.9 < light.sum() < 1.0


@pytest.mark.parametrize("order", [-5, 3, 10])
def test_a_blazed_grating_moves_the_spot_and_pays_the_envelope(small_camera, order):
    """Peak at order wavelength z / (N pitch), weaker by sinc²(order sqrt F / N)."""
    n = small_camera.panel.shape[1]
    step = scale_of(small_camera) / (n * small_camera.panel.pitch)
    camera = replace(small_camera, sensor=Sensor(pitch=step / 2))
    ramp = torch.arange(n, dtype=torch.float64) * (2 * math.pi * order / n)
    operator = PSFOperator(
        camera, 2.0, WAVELENGTH, camera.sensor.window_plane((9, 61)), integrate=False, tol=1e-9
    )
    neutral = operator(torch.zeros(camera.panel.shape)).numpy()
    blazed = operator(ramp.expand(camera.panel.shape)).numpy()
    assert np.unravel_index(blazed.argmax(), blazed.shape) == (4, 30 + 2 * order)
    share = np.sinc(order * math.sqrt(camera.panel.fill_factor) / n) ** 2
    assert blazed.max() / neutral.max() == pytest.approx(share, rel=1e-9)


def defocused_rectangle(camera: Camera, distance: float, shape: tuple[int, int]) -> np.ndarray:
    """A fully filled panel without a pattern, on sensor points, by Fresnel integrals."""
    vergence = 1 / distance - 1 / camera.lens.focus_distance
    scale, pitch, p = scale_of(camera), camera.panel.pitch, camera.sensor.pitch

    def line(n: int, u: np.ndarray) -> np.ndarray:
        low, high = (-(n // 2) - 0.5) * pitch, (n - n // 2 - 0.5) * pitch
        stretch = np.sqrt(2 * abs(vergence) / WAVELENGTH)
        shift = u / (vergence * camera.lens.image_distance)
        s1, c1 = fresnel(stretch * (high - shift))
        s0, c0 = fresnel(stretch * (low - shift))
        return ((c1 - c0) ** 2 + (s1 - s0) ** 2) / stretch**2 / (scale * n * pitch)

    rows, columns = (
        line(n, positions(m, p)) for n, m in zip(camera.panel.shape, shape, strict=True)
    )
    return np.outer(rows, columns) * p**2


@pytest.mark.parametrize("distance", [1.6, 2.6, math.inf])
def test_defocus_of_a_rectangle_follows_fresnels_integrals(small_camera, distance):
    """Each axis: integral of exp(i pi V x² / wavelength - 2 pi i x u / (wavelength z))."""
    camera = with_panel(small_camera, fill_factor=1.0)
    operator = PSFOperator(
        camera,
        distance,
        WAVELENGTH,
        camera.sensor.window_plane((31, 32)),
        integrate=False,
        tol=0.05,
    )
    value = operator(torch.zeros(camera.panel.shape)).numpy()
    truth = defocused_rectangle(camera, distance, (31, 32))
    assert relative(value, truth) <= operator.account.error
    # On the axis itself.
    assert value[15, 16] == pytest.approx(truth[15, 16], rel=operator.account.error)


def test_the_unmodulated_share_adds_in_intensity(small_camera):
    """0/pi squares cancel on the axis: only the unmodulated share of a neutral spot is left."""
    rows, columns = np.indices(small_camera.panel.shape)
    squares = torch.from_numpy(np.pi * ((rows + columns) % 2))

    def centre(share: float, phase: torch.Tensor) -> float:
        operator = PSFOperator(
            small_camera,
            2.0,
            WAVELENGTH,
            small_camera.sensor.window_plane((5, 5)),
            integrate=False,
            unmodulated=share,
            tol=1e-9,
        )
        return float(operator(phase)[2, 2])

    neutral = centre(0.0, torch.zeros(small_camera.panel.shape))
    assert centre(0.0, squares) <= 1e-20 * neutral
    assert centre(0.07, squares) == pytest.approx(0.07 * neutral, rel=1e-9)
    panel = with_panel(small_camera, unmodulated=0.2)
    by_default = PSFOperator(
        panel, 2.0, WAVELENGTH, panel.sensor.window_plane((5, 5)), integrate=False
    )(squares)
    assert float(by_default[2, 2]) == pytest.approx(0.2 * neutral, rel=1e-5)


def test_an_object_at_infinity_is_the_limit_of_far_ones(small_camera):
    focused = replace(small_camera, lens=replace(small_camera.lens, focus_distance=20.0))
    phase = random_phase(focused, 1)
    at_infinity = PSFOperator(
        focused, math.inf, WAVELENGTH, focused.sensor.window_plane((12, 12)), tol=0.1
    )(phase)
    far = PSFOperator(focused, 1e9, WAVELENGTH, focused.sensor.window_plane((12, 12)), tol=0.1)(
        phase
    )
    near = PSFOperator(focused, 20.0, WAVELENGTH, focused.sensor.window_plane((12, 12)), tol=0.1)(
        phase
    )
    assert relative(far.numpy(), at_infinity.numpy()) <= 1e-5
    assert relative(near.numpy(), at_infinity.numpy()) > 0.01


@pytest.mark.parametrize("tol", [1e-2, 1e-5, 1e-8])
@pytest.mark.parametrize("distance", [0.3, 0.7, 1.3, math.inf])
@pytest.mark.parametrize("shape", [(24, 32), (25, 31)])
def test_defocus_keeps_the_tolerance_however_strong(small_camera, distance, tol, shape):
    """Quadrature inside the panel's pixels, with nodes for several waves across each."""
    camera = with_panel(small_camera, shape=shape)
    phase = random_phase(camera, 7)
    operator = PSFOperator(
        camera, distance, WAVELENGTH, camera.sensor.window_plane((12, 13)), tol=tol
    )
    truth = quadrature_psf(
        camera, phase.numpy(), distance, WAVELENGTH, (12, 13), across_panel_pixel=16
    )
    assert relative(operator(phase).numpy(), truth) <= tol
    assert operator.account.error <= tol


def test_strong_defocus_of_a_rectangle_follows_fresnels_integrals(small_camera):
    """As below, with a panel so coarse that defocus turns by waves inside a pixel."""
    camera = with_panel(small_camera, fill_factor=1.0, shape=(4, 5), pitch=300e-6)
    operator = PSFOperator(
        camera, 0.25, WAVELENGTH, camera.sensor.window_plane((31, 32)), integrate=False, tol=1e-9
    )
    assert "curved" in operator.account.method
    value = operator(torch.zeros(camera.panel.shape)).numpy()
    assert relative(value, defocused_rectangle(camera, 0.25, (31, 32))) <= 1e-9


def test_the_gradient_through_curved_pixels_equals_finite_differences():
    camera = Camera(Panel(shape=(4, 5), pitch=40e-6), Lens(), Sensor(pitch=60e-6))
    operator = PSFOperator(camera, 0.3, WAVELENGTH, camera.sensor.window_plane((3, 4)), tol=1e-8)
    assert "curved" in operator.account.method
    phase = random_phase(camera, 2).requires_grad_()
    assert torch.autograd.gradcheck(lambda p: 100 * operator(p), (phase,), atol=1e-7)


def test_an_object_too_close_for_any_sampling_is_refused(small_camera):
    words = "rad across a panel pixel; bring the object closer to the plane in focus"
    with pytest.raises(ToleranceError, match=words):
        PSFOperator(small_camera, 1e-6, WAVELENGTH, small_camera.sensor.window_plane((8, 8)))


@pytest.mark.parametrize("tol", [math.inf, 2.0])
def test_what_is_no_tolerance_is_refused(small_camera, tol):
    with pytest.raises(ValueError, match=r"tol is .* give a number up to 1, for instance"):
        PSFOperator(
            small_camera, 2.0, WAVELENGTH, small_camera.sensor.window_plane((8, 8)), tol=tol
        )


@pytest.mark.parametrize("tol", [0.0, -1e-3, float("nan"), 1e-15])
def test_a_tolerance_below_rounding_is_refused(small_camera, tol):
    with pytest.raises(ToleranceError, match=r"tol .* can't be kept; ask for tol"):
        PSFOperator(
            small_camera, 2.0, WAVELENGTH, small_camera.sensor.window_plane((8, 8)), tol=tol
        )


@pytest.mark.parametrize("seed", range(3))
def test_single_precision_is_as_good_as_the_account_says(small_camera, seed):
    phase = random_phase(small_camera, seed) * 10
    single = PSFOperator(
        small_camera, 2.0, WAVELENGTH, small_camera.sensor.window_plane((12, 13)), integrate=False
    )
    double = PSFOperator(
        small_camera,
        2.0,
        WAVELENGTH,
        small_camera.sensor.window_plane((12, 13)),
        integrate=False,
        tol=1e-9,
    )
    assert (single.account.precision, double.account.precision) == ("float32", "float64")
    value, truth = single(phase), double(phase)
    assert (value.dtype, truth.dtype) == (torch.float32, torch.float64)
    assert relative(value.numpy(), truth.numpy()) <= single.account.arithmetic.value


@pytest.mark.parametrize("tol", [1e-2, 1e-3, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("seed", range(4))
def test_the_achieved_error_keeps_the_tolerance(small_camera, tol, seed):
    """Quadrature inside panel and sensor pixels, at as much defocus as the tolerance allows."""
    rng = np.random.default_rng(seed)
    shape = [(24, 32), (25, 31), (24, 31), (25, 32)][seed]
    camera = with_panel(small_camera, shape=shape)
    for distance in (*rng.uniform(1.2, 2.0, 6), 2.0):
        try:
            operator = PSFOperator(
                camera, distance, WAVELENGTH, camera.sensor.window_plane((12, 13)), tol=tol
            )
        except ToleranceError:
            continue
        break
    phase = random_phase(camera, seed)
    truth = quadrature_psf(camera, phase.numpy(), distance, WAVELENGTH, (12, 13))
    assert operator.account.error <= tol
    assert relative(operator(phase).numpy(), truth) <= tol


@pytest.mark.parametrize(
    ("share", "vergence"),
    some(itertools.product((0.9, 0.5, 0.0), (0.3, 0.02, 0.11))),
)
def test_light_steered_off_axis_with_defocus_keeps_the_predicted_error(
    small_camera, vergence, share
):
    """The slope of defocus inside the pixels matters most where a grating sends the light."""
    camera = with_panel(small_camera, shape=(1, 800), pitch=10e-6)
    camera = replace(camera, sensor=Sensor(pitch=5e-6))
    edge = 200 * 5e-6
    slope = 2 * math.pi * share * edge / scale_of(camera) * 10e-6
    ramp = (torch.arange(800, dtype=torch.float64) * slope)[None]
    operator = PSFOperator(
        camera,
        1 / (0.5 + vergence),
        WAVELENGTH,
        camera.sensor.window_plane((1, 400)),
        tol=0.1,
        method="gridded FFT",
        pixel_tol=1e-4,
    )
    truth = quadrature_psf(camera, ramp.numpy(), 1 / (0.5 + vergence), WAVELENGTH, (1, 400))
    error = relative(operator(ramp).numpy(), truth)
    assert error <= operator.account.error
    # A gridded FFT is taken to reach more than it does here.
    assert share < 0.9 or error > operator.account.error / 40


def test_the_gradient_equals_finite_differences():
    """torch.autograd.gradcheck, on pixels, with defocus and unmodulated light."""
    camera = Camera(Panel(shape=(4, 5), pitch=40e-6), Lens(), Sensor(pitch=60e-6))
    operator = PSFOperator(camera, 2.0, WAVELENGTH, camera.sensor.window_plane((3, 4)), tol=1e-8)
    phase = random_phase(camera, 2).requires_grad_()
    # The light of a pixel is a few percent: scaled to one for gradcheck's absolute part.
    assert torch.autograd.gradcheck(lambda p: 100 * operator(p), (phase,), atol=1e-7)


def test_a_batch_of_phases_gives_the_psfs_of_each(small_camera):
    phases = torch.stack([random_phase(small_camera, s) for s in range(3)])
    operator = PSFOperator(
        small_camera, 2.0, WAVELENGTH, small_camera.sensor.window_plane((7, 6)), tol=1e-8
    )
    together = operator(phases)
    assert together.shape == (3, 7, 6)
    assert relative(together[1].numpy(), operator(phases[1]).numpy()) <= 1e-12


def test_adding_whole_waves_changes_nothing(small_camera):
    phase = random_phase(small_camera, 3)
    operator = PSFOperator(small_camera, 2.0, WAVELENGTH, small_camera.sensor.window_plane((7, 6)))
    waves = 2 * math.pi * torch.randint(-9, 9, phase.shape, dtype=torch.float64)
    assert relative(operator(phase + waves).numpy(), operator(phase).numpy()) <= 1e-5


def test_oversampled_points_sum_to_their_pixel(small_camera):
    """A midpoint sum of 16 x 16 shares is the pixel's light to its own second order."""
    phase = random_phase(small_camera, 4)
    pixels = quadrature_psf(small_camera, phase.numpy(), 2.0, WAVELENGTH, (5, 5))
    points = small_camera.sensor.window_plane((5, 5)).with_finer_pitch(15)
    operator = PSFOperator(small_camera, 2.0, WAVELENGTH, points, integrate=False, tol=1e-9)
    sums = operator(phase).numpy().reshape(5, 15, 5, 15).sum((1, 3))
    assert relative(sums, pixels) <= 2e-3


def test_the_account_tells_method_sampling_and_time(small_camera):
    result = psf(
        small_camera,
        distance=2.0,
        wavelength=WAVELENGTH,
        pixels=small_camera.sensor.window_plane((8, 8)),
    )
    assert result.account.cpu_spent is not None
    assert result.account.cpu_spent >= 0
    assert "32x24 panel pixels" in result.account.sampling
    # The obliquity of the ray from the panel's corner; the parabola costs less than half of it.
    corner, z = math.hypot(12, 16) * 40e-6, 1 / (1 / 0.125 - 1 / 2.0)
    assert result.account.model.value == pytest.approx((corner / z) ** 2, rel=0.5)


def test_bad_arguments_are_refused_by_name(small_camera):
    def operator(distance=2.0, wavelength=WAVELENGTH, shape=(8, 8), **options):
        pixels = small_camera.sensor.window_plane(shape)
        return PSFOperator(small_camera, distance, wavelength, pixels, **options)

    with pytest.raises(ValueError, match=r"distance is 0 m; the object must be in front"):
        operator(distance=0.0)
    with pytest.raises(ValueError, match=r"distance is nan m"):
        operator(distance=float("nan"))
    with pytest.raises(ValueError, match=r"wavelength is -1 m; it must be positive"):
        operator(wavelength=-1.0)
    with pytest.raises(ValueError, match=r"shape \(0, 8\) must be at least 1"):
        operator(shape=(0, 8))
    with pytest.raises(
        ValueError, match=r"method is 'axial'; for .* behind a panel choose one of matrix DFT"
    ):
        operator(method="axial")
    with pytest.raises(ValueError, match=r"unmodulated is 1.5; it is a share"):
        operator(unmodulated=1.5)
    with pytest.raises(ValueError, match=r"phase is \(32, 24\); the pupil has \(24, 32\) pixels"):
        operator()(torch.zeros(32, 24))
    phase = torch.zeros(24, 32)
    phase[1, 2] = math.nan
    with pytest.raises(ValueError, match=r"phase has 1 NaN or infinite values"):
        operator()(phase)


@pytest.mark.parametrize("length", ["focal_length", "f_number"])
@pytest.mark.parametrize("stop", [Stop(), Stop(Circle(), (Circle(0.3),))], ids=["round", "annular"])
@pytest.mark.parametrize("distance", [2.0, 3.0], ids=["flat pixels", "divided pixels"])
def test_derivatives_move_the_edge_of_the_stop(small_camera, length, stop, distance):
    """The stop's radius changes with both lengths; Richardson's limit of differences agrees."""
    phase = random_phase(small_camera, 3).double()
    weights = torch.rand(9, 8, dtype=torch.float64, generator=torch.manual_seed(1))
    at = {"focal_length": 0.125, "f_number": 150.0}

    def value(**changed):
        lens = replace(small_camera.lens, stop=stop, focus_distance=2.0, **{**at, **changed})
        camera, pixels = replace(small_camera, lens=lens), small_camera.sensor.window_plane((9, 8))
        operator = PSFOperator(camera, distance, WAVELENGTH, pixels, tol=1e-8)
        return (operator(phase) * weights).sum()

    leaf = torch.tensor(at[length], dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(value(**{length: leaf}), leaf)
    wide, narrow = (
        (value(**{length: at[length] * (1 + h)}) - value(**{length: at[length] * (1 - h)}))
        / (2 * h * at[length])
        for h in (4e-4, 2e-4)
    )
    assert float(gradient) == pytest.approx(float((4 * narrow - wide) / 3), rel=1e-5)


def test_every_picture_of_a_batch_keeps_its_own_brightness(small_camera):
    """A pattern of amplitude 1e-30 beside one of 1 would vanish in single precision."""
    operator = PSFOperator(small_camera, 2.0, WAVELENGTH, small_camera.sensor.window_plane((8, 8)))
    amplitude = torch.ones(2, 24, 32, dtype=torch.float64)
    amplitude[1] *= 1e-30
    bright, dim = operator(None, amplitude)
    assert relative(dim.double() * 1e60, bright) <= 1e-6


def test_what_is_returned_may_be_written_into(small_camera):
    operator = PSFOperator(small_camera, 2.0, WAVELENGTH, small_camera.sensor.window_plane((8, 8)))
    phase = random_phase(small_camera, 5)
    before = operator(phase)
    operator.unmodulated_psf().zero_()
    assert torch.equal(operator(phase), before)


def test_a_length_that_changes_in_place_is_refused(small_camera):
    distance = torch.tensor(2.0, dtype=torch.float64)
    operator = PSFOperator(
        small_camera, distance, WAVELENGTH, small_camera.sensor.window_plane((8, 8))
    )
    operator()
    distance.fill_(3.0)
    with pytest.raises(ValueError, match="distance has changed since this PSFOperator was planned"):
        operator()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"wavelength": 550.0}, "wavelength is 550 m, longer than a millimetre; give metres"),
        ({"wavelength": "550 nm"}, "wavelength is '550 nm', a str; give one number in m"),
        ({"distance": [2.0]}, r"distance is \[2.0\], a list; give one number in m"),
        ({"tol": "fine"}, "tol is 'fine', a str; give one number"),
    ],
)
def test_bad_arguments_are_refused_in_words(small_camera, changed, message):
    good = {
        "distance": 2.0,
        "wavelength": WAVELENGTH,
        "pixels": small_camera.sensor.window_plane((8, 8)),
    }
    with pytest.raises((ValueError, TypeError), match=message):
        psf(small_camera, **{**good, **changed})


@pytest.mark.parametrize(
    ("phase", "message"),
    [
        ([[0.0] * 32] * 24, "phase is a list; give a torch tensor or a numpy array"),
        (np.full((24, 32), "a"), "an array of <U1 was given; give an array of numbers"),
        (
            np.ma.masked_greater(np.arange(768.0).reshape(24, 32), 765),
            r"masked array with 2 masked values of 768 was given; .* filled\(\)",
        ),
    ],
    ids=["list", "text", "masked"],
)
def test_what_is_no_picture_is_refused_in_words(small_camera, phase, message):
    operator = PSFOperator(small_camera, 2.0, WAVELENGTH, small_camera.sensor.window_plane((8, 8)))
    with pytest.raises((ValueError, TypeError), match=message):
        operator(phase)


# Told of the light that is really there


def dark_hole(camera: Camera, distance: float, pixels: Plane) -> torch.Tensor:
    """A phase that descent has led to as little light in the window as a coarse operator sees."""
    phase = torch.from_numpy(np.random.default_rng(4).uniform(0, 0.5, camera.panel.shape))
    phase.requires_grad_()
    operator = PSFOperator(camera, distance, WAVELENGTH, pixels, integrate=False, tol=0.1)
    descent = torch.optim.Adam([phase], lr=0.15)
    for _ in range(40):
        descent.zero_grad()
        try:
            light = operator(phase).sum()
        except ToleranceError:
            break
        (light / light.detach()).backward()
        descent.step()
    return phase.detach()


@pytest.mark.parametrize("tol", [0.1, 0.01, 1e-5])
@pytest.mark.parametrize("null", [False, True])
def test_a_dark_hole_that_descent_has_made_keeps_its_tolerance(small_camera, null, tol):
    """On the axis, and where the pixels' envelope is zero: what a coarse way leaves out is all
    that is left there."""
    camera = with_panel(small_camera, shape=(24, 30), fill_factor=0.95, unmodulated=0.0)
    away = scale_of(camera) / camera.panel.active_side if null else 0.0
    pixels = camera.sensor.window_plane((7, 8), centre=(0.0, away))
    phase = dark_hole(camera, 1.5, pixels)
    operator = PSFOperator(camera, 1.5, WAVELENGTH, pixels, integrate=False, tol=tol)
    light = operator(phase).numpy()
    view = View(camera, pixels, 1.5, WAVELENGTH, integrate=False, phase=phase.numpy())
    error = relative(light, by_panel(view))
    assert error <= operator.account.error <= tol


def test_unmodulated_light_counts_in_the_error_of_a_dark_hole(small_camera):
    """It fills the hole, so that no more digits of the pattern's light are needed than of it."""
    dark = with_panel(small_camera, shape=(24, 30), unmodulated=0.0)
    pixels = dark.sensor.window_plane((7, 8))
    phase = dark_hole(dark, 1.5, pixels)
    filled = with_panel(dark, unmodulated=0.1)
    told = []
    for camera in (dark, filled):
        operator = PSFOperator(camera, 1.5, WAVELENGTH, pixels, tol=1e-2, method="matrix DFT")
        light = operator(phase).numpy()
        view = View(camera, pixels, 1.5, WAVELENGTH, phase=phase.numpy())
        assert relative(light, by_panel(view)) <= operator.account.error <= 1e-2
        told.append(operator.account.error)
    assert told[0] > 2 * told[1]


def test_light_beside_the_pixels_is_told_where_it_is_far_brighter():
    """In the envelope's null of a full panel: a few samples on it is a hundred times brighter."""
    camera = Camera(Panel((20, 24), 30e-6, 1.0, unmodulated=0.0), Lens(0.1, 100.0, 2.0), Sensor())
    null = scale_of(camera) / camera.panel.pitch
    pixels = Plane((5, 3), (12e-6, 12e-6), (0.0, null))
    phase = random_phase(camera, 3)
    for tol in (1e-2, 1e-4, 1e-6):
        operator = PSFOperator(camera, 1.7, WAVELENGTH, pixels, tol=tol)
        view = View(camera, pixels, 1.7, WAVELENGTH, phase=phase.numpy())
        error = relative(operator(phase).numpy(), by_panel(view))
        assert error <= operator.account.error <= tol


def test_bright_pixels_behind_a_closed_part_of_the_stop_hide_no_others():
    """An amplitude of 1e30 times less where the stop is open is all the light that there is."""
    camera = Camera(
        Panel((24, 24), 20e-6, 0.9, unmodulated=0.0),
        Lens(0.1, 0.1 / 0.3e-3, 2.0, Stop(Circle(), (Circle(0.4),))),
        Sensor(pitch=20e-6),
    )
    y, x = np.indices(camera.panel.shape) - 12
    radius = np.hypot(y, x) * 20e-6 / 0.15e-3
    amplitude = np.where(radius < 0.2, 1.0, 1e-30)
    pixels = camera.sensor.window_plane((6, 7))
    light = PSFOperator(camera, 2.0, WAVELENGTH, pixels, tol=1e-4)(
        None, torch.from_numpy(amplitude)
    )
    view = View(camera, pixels, 2.0, WAVELENGTH, amplitude=amplitude)
    assert relative(light.numpy(), by_panel(view)) <= 1e-4


def test_the_first_terms_left_out_are_what_the_error_is_measured_from(small_camera):
    camera = with_panel(small_camera, shape=(60, 64), fill_factor=0.9, unmodulated=0.0)
    pixels = camera.sensor.window_plane((40, 40))
    operator = PSFOperator(
        camera, 1.6, WAVELENGTH, pixels, integrate=False, tol=0.1, method="chirp-Z"
    )
    assert "estimate" in operator.account.sampling_error.how
    phase = random_phase(camera, 5)
    light = operator(phase)
    assert operator.account.sampling_error.how == "measured on 8 rows of the window"
    exact = PSFOperator(camera, 1.6, WAVELENGTH, pixels, integrate=False, tol=1e-8)(phase)
    error = relative(light.numpy(), exact.numpy())
    assert operator.account.error / 10 <= error <= operator.account.error


BASE = {"focal": 0.1, "f_number": 90.0, "focus": 2.0, "distance": 1.4, "wavelength": WAVELENGTH,
        "separation": 0.0835, "field": 1e-4, "coma": -8e-8}  # fmt: skip
WEIGHTS = torch.from_numpy(np.random.default_rng(3).normal(size=(11, 12)))


def weighted_light(apart: bool, tol: float, **values) -> tuple[torch.Tensor, PSFOperator]:
    """A sum over a small window behind 24 by 28 pixels, of which the stop cuts some."""
    v = BASE | values
    lens = Lens(v["focal"], v["f_number"], v["focus"], aberrations=((3, 1, v["coma"]),))
    panel = Panel((24, 28), 50e-6, 0.8, unmodulated=0.1)
    camera = Camera(panel, lens, Sensor(), separation=v["separation"] if apart else 0.0)
    settings = {"field": (v["field"], -2e-4)} if apart else {}
    pixels = Plane((11, 12), (6e-6, 6e-6), (1e-5, -2e-5))
    operator = PSFOperator(
        camera, v["distance"], v["wavelength"], pixels, integrate=False, tol=tol, **settings
    )
    phase = torch.from_numpy(np.random.default_rng(5).uniform(0, 6, panel.shape))
    return (operator(phase).to(torch.float64) * WEIGHTS).sum(), operator


@cache
def slope_of_light(apart: bool, name: str) -> float:
    """By Richardson's extrapolation of differences."""
    step = abs(BASE[name]) * (1e-3 if name == "coma" else 1e-4)

    def difference(h: float) -> float:
        ends = [weighted_light(apart, 1e-8, **{name: BASE[name] + s * h})[0] for s in (1, -1)]
        return float(ends[0] - ends[1]) / (2 * h)

    return (4 * difference(step / 2) - difference(step)) / 3


@pytest.mark.parametrize(
    ("apart", "name", "tol"),
    some(
        (
            (apart, name, tol)
            for apart, names in (
                (False, ("focal", "f_number", "focus", "distance", "coma")),
                (True, ("f_number", "wavelength", "separation", "field")),
            )
            for name in names
            for tol in (1e-8, 1e-3)
        ),
        *(0, 2, 3, 7, 8, 12, 15, 16),
    ),
)
def test_derivatives_in_lengths_keep_what_is_told_of_them(apart, name, tol):
    """Against differences in which the stop's edge moves, too."""
    length = torch.tensor(BASE[name], dtype=torch.float64, requires_grad=True)
    value, operator = weighted_light(apart, tol, **{name: length})
    (slope,) = torch.autograd.grad(value, length)
    found = slope_of_light(apart, name)
    told = operator.account.gradient_error
    assert told is not None
    assert abs(float(slope) / found - 1) <= max(told.value, 1e-5)
    assert abs(float(slope) / found - 1) <= max(tol, 1e-5)


def test_an_operator_keeps_no_light_of_its_calls(small_camera):
    """Only what its account tells: a light may be large, and hold a graph of derivatives."""
    operator = PSFOperator(small_camera, 2.2, 550e-9, small_camera.sensor.window_plane((8, 8)))
    light = operator(torch.zeros(small_camera.panel.shape, requires_grad=True))
    seen = weakref.ref(light)
    del light
    gc.collect()
    assert seen() is None
    assert operator.account.error > 0
