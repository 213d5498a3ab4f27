"""The phase response from gratings, judged by a bench that computes its light another way."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from judges.calibration_bench import NumpyBench, curve, mapped, turned
from scipy import ndimage
from sweeps import some

from optics.camera import Sensor
from optics.measuring.gratings import (
    max_grating_frequency,
    region_slices,
    region_vectors,
    stripe_pattern,
)
from optics.measuring.phase_curve import StripeLaw, Sweep
from optics.measuring.registration import measure_first_orders
from optics.measuring.response_fit import fit_response

WAVELENGTH = 532e-9
TOP = 255


def swept(count, reach):
    """Levels of a sweep with two references, a quarter of a wave apart by the data sheet."""
    high = np.round(np.linspace(0, TOP, count)).astype(int)
    low = np.where(np.arange(count) % 2 == 1, round(TOP * np.pi / 2 / reach), 0)
    return low, high


def law_of(period, max_step=50.0, active_side=1.0):
    """Of upright stripes."""
    vector = np.array([[0.0, 1 / period]])
    return StripeLaw(
        stripe_pattern((160, 160), (1, 1), vector, 0, 1) == 1, vector[0], active_side, max_step
    )


@pytest.fixture(scope="module")
def law():
    return law_of(40.0)


def measured(rng, phase, reach, law, count=40, noise=0.003):
    low, high = swept(count, reach)
    step = phase[high] - phase[low]
    light = np.sin(step / 2) ** 2
    sigma = np.sqrt((noise * np.sqrt(light)) ** 2 + (noise / 3) ** 2)
    seen = 700 * (light + 0.03 + sigma * rng.standard_normal(count))
    return Sweep(low, high, seen, 700 * sigma, law)


@pytest.mark.parametrize(
    ("reach", "gamma"),
    some(itertools.product([2.3 * np.pi, 5.4 * np.pi, 9.0 * np.pi], [0.85, 1.2]), 0, 3, 5),
)
def test_a_distorted_response_is_found_and_its_waves_are_counted(rng, law, reach, gamma):
    """Of sin² light with noise; the range is a tenth off the data sheet."""
    truth = curve(1.1 * reach, gamma, wiggle=0.01, bend=0.01)
    fit = fit_response(measured(rng, truth, reach, law), TOP + 1, reach)
    error = fit.phase - truth
    assert np.sqrt((error**2).mean()) < 0.02
    assert np.mean(np.abs(error) < 2.5 * fit.sigma + 0.005) > 0.9
    assert fit.residual < 0.01
    assert fit.rival_margin > 10
    assert (np.diff(fit.phase) >= 0).all()
    assert fit.phase[0] == 0


def test_four_regions_are_swept_at_once_on_an_unknown_turned_sensor(rng):
    """Through a numpy bench with its own light: 30 frames for four regions, noise, hot pixels."""
    reach = 6.7 * np.pi
    phases = np.stack(
        [curve(reach * (1.1 - 0.05 * k), 1.15 - 0.1 * k, 0.01 * (k - 1)) for k in range(4)]
    ).reshape(2, 2, -1)
    bench = NumpyBench(phases, turned(4.0, True, stretch=1.03), unmodulated=0.05, star=0, finer=2)
    sensor = Sensor(shape=bench.sensor, gain=bench.gain, read_noise=bench.read_noise)
    vectors = region_vectors(bench.panel, (2, 2), 0.2368, 4 / 190)
    upper = stripe_pattern(bench.panel, (2, 2), vectors, 0, 1) == 1
    parts = region_slices(bench.panel, (2, 2))
    registration = mapped(bench.centre, bench.matrix)
    low, high = swept(30, reach)
    shown = [
        stripe_pattern(bench.panel, (2, 2), vectors, *pair) for pair in zip(low, high, strict=True)
    ]
    frames = [bench.frame(grey, 0.05).astype(np.uint16) for grey in shown]
    gathered = measure_first_orders(
        frames, bench.dark(), registration, vectors, (48, 64), sensor, WAVELENGTH
    )
    truths = phases.reshape(4, -1)
    for orders, vector, part, truth in zip(gathered, vectors, parts, truths, strict=True):
        ok = ~orders.clipped
        stripes = StripeLaw(upper[part], vector, 1.0, 1.7 * reach)
        sweep = Sweep(low[ok], high[ok], orders.light[ok], orders.noise[ok], stripes)
        fit = fit_response(sweep, TOP + 1, reach)
        assert np.sqrt(((fit.phase - truth) ** 2).mean()) < 0.02
        assert np.sqrt((fit.sigma**2).mean()) < 0.04


def test_light_between_hard_stripes_is_the_sine_squared(law):
    step = np.linspace(-30, 30, 101)
    np.testing.assert_allclose(law(step), np.sin(step / 2) ** 2, atol=1e-4)


@pytest.mark.parametrize("blur", [0.25, 0.6])
def test_light_between_blurred_stripes_is_that_of_a_blurred_grating(law, blur):
    """200 samples a pixel, blurred by scipy, and the first coefficient of its Fourier series."""
    n = 200
    hard = (np.arange(40 * n) < 20 * n) * 1.0
    height = ndimage.gaussian_filter1d(hard, blur * n, mode="wrap", truncate=8)
    step = np.array([1.0, 3.0, 8.0, 15.0, 26.0])
    wave = np.exp(1j * step[:, None] * height)
    first = np.abs(np.fft.fft(wave, axis=1)[:, 1] / (40 * n)) ** 2 * np.pi**2 / 4
    np.testing.assert_allclose(law(step, blur**2), first, atol=1e-3)


def test_edges_in_the_gaps_between_pixels_blur_less():
    """Of each pixel only the middle half modulates, where a blur of 0.08 pixels hardly reaches."""
    step = np.array([7 * np.pi])
    hard = 1.0
    whole, middle = (float(law_of(16.0, active_side=side)(step, 0.0064)[0]) for side in (1.0, 0.5))
    assert abs(middle - hard) < 0.2 * abs(whole - hard)


def test_a_ripple_is_the_mean_over_normal_phases(law):
    step = np.linspace(0, 25, 60)
    expected = 0.5 * (1 - np.exp(-((0.01 * step) ** 2) / 2) * np.cos(step))
    np.testing.assert_allclose(law(step, 0.0, 1e-4), expected, atol=1e-4)


def test_the_slopes_are_the_differences(law):
    step, nudge = np.array([-7.0, 0.5, 2.0, 11.0, 20.0]), 1e-4
    by_step, by_blur = law.derivatives(step, 0.09, 1e-4)
    differences = (law(step + nudge, 0.09, 1e-4) - law(step - nudge, 0.09, 1e-4)) / (2 * nudge)
    np.testing.assert_allclose(by_step, differences, atol=1e-5)
    differences = (law(step, 0.09 + nudge, 1e-4) - law(step, 0.09 - nudge, 1e-4)) / (2 * nudge)
    np.testing.assert_allclose(by_blur, differences, atol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"active_side": 0.0}, "at most 1"),
        ({"max_step": 0.0}, "max_step is 0"),
        ({"period": 1.5}, "two pixels or more"),
    ],
)
def test_stripes_that_cannot_be_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        law_of(**({"period": 20.0} | change))


def test_neighbours_that_blur_the_stripes_are_told_from_phase(rng, law):
    """Half a pixel of blur on stripes of 40: without a model of it the phase is off by more."""
    reach = 6.7 * np.pi
    truth = curve(reach, 1.1)
    low, high = swept(40, reach)
    n = 8192
    height = ndimage.gaussian_filter1d(
        (np.arange(n) < n // 2) * 1.0, 0.5 / 40 * n, mode="wrap", truncate=8
    )
    step = truth[high] - truth[low]
    wave = np.exp(1j * step[:, None] * height)
    light = np.abs(np.fft.fft(wave, axis=1)[:, 1] / n) ** 2 * np.pi**2 / 4
    noise = np.full(40, 0.002)
    sweep = Sweep(low, high, light + noise * rng.standard_normal(40), noise, law)
    fit = fit_response(sweep, TOP + 1, reach)
    assert np.sqrt(((fit.phase - truth) ** 2).mean()) < 0.02
    assert fit.blur == pytest.approx(0.5, abs=0.15)


def test_a_frame_that_went_wrong_is_left_out(rng, law):
    reach = 6.7 * np.pi
    truth = curve(reach, 1.1)
    sweep = measured(rng, truth, reach, law)
    sweep.light[17] += 300.0
    fit = fit_response(sweep, TOP + 1, reach)
    assert not fit.inliers[17]
    assert fit.inliers.sum() >= 37
    assert np.sqrt(((fit.phase - truth) ** 2).mean()) < 0.02


def test_light_that_does_not_come_and_go_is_refused(rng, law):
    low, high = swept(40, 20.0)
    sweep = Sweep(low, high, 5 + 0.1 * rng.standard_normal(40), np.full(40, 0.1), law)
    with pytest.raises(ValueError, match=r"too little to see the phase.*polariser"):
        fit_response(sweep, 256, 20.0)


def test_light_that_follows_no_phase_is_refused(rng, law):
    low, high = swept(40, 20.0)
    sweep = Sweep(low, high, rng.uniform(0, 1, 40), np.full(40, 0.01), law)
    with pytest.raises(ValueError, match="follows no rising phase"):
        fit_response(sweep, 256, 20.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"light": np.ones(39)}, "one value a frame"),
        ({"light": np.full(40, np.nan)}, "finite"),
        ({"noise": np.zeros(40)}, "positive"),
        ({"high": np.zeros(40, int)}, "12 at least"),
    ],
)
def test_sweeps_that_cannot_be_are_refused(law, change, message):
    low, high = swept(40, 20.0)
    whole = {"low": low, "high": high, "light": np.ones(40), "noise": np.ones(40), "law": law}
    with pytest.raises(ValueError, match=message):
        Sweep(**(whole | change))


def test_an_expected_range_that_is_none_is_refused(rng, law):
    with pytest.raises(ValueError, match="expected_range is 0 rad"):
        fit_response(measured(rng, curve(20.0), 20.0, law), 256, 0.0)


def test_clipped_spots_are_told_and_too_many_refused(rng):
    sensor = Sensor(shape=(64, 64))
    registration = mapped((32.0, 32.0), turned(0.0, scale=100.0))
    frames = [rng.integers(64, 90, (64, 64)).astype(np.uint16) for _ in range(20)]
    frames[3][32, 48] = 4095
    vectors = np.array([(0.0, 0.16)])

    def gathered():
        dark = np.full((64, 64), 64.0)
        return measure_first_orders(
            frames, dark, registration, vectors, (50, 50), sensor, WAVELENGTH
        )

    assert np.flatnonzero(gathered()[0].clipped).tolist() == [3]
    for frame in frames[:5]:
        frame[32, 16] = 4095
    with pytest.raises(ValueError, match=r"clipped in 5 of 20 frames; expose them shorter"):
        gathered()
    vectors = np.array([(0.0, 0.5)])
    with pytest.raises(ValueError, match="outside of the frame"):
        gathered()


@pytest.mark.parametrize("regions", [(1, 1), (2, 2), (2, 3)])
def test_the_spots_of_regions_stay_apart(regions):
    """In first and third orders and from the centre, on the thesis' panel and lens."""
    shape, scale = (1080, 1920), WAVELENGTH * 0.13333
    longest = max_grating_frequency((512, 768), 3.45e-6, 8e-6, scale)
    vectors = region_vectors(shape, regions, longest)
    assert len(vectors) == np.prod(regions)
    assert np.hypot(*vectors.T).max() <= longest
    lines = np.array([shape[0] // regions[0], shape[1] // regions[1]])
    orders = [(0, 0)] + [tuple(s * v) for v in vectors * lines for s in (1, -1)]
    away = np.abs(np.array(orders)[:, None] - np.array(orders)[None]).max(-1)
    assert away[~np.eye(len(orders), dtype=bool)].min() >= 4


def test_stripes_are_equally_wide_in_every_region():
    vectors = np.array([(0.05, 0.1), (-0.1, 0.05), (0.0, 0.125), (0.125, 0.0)])
    grey = stripe_pattern((80, 160), (2, 2), vectors, 7, 200)
    for rows, columns in region_slices((80, 160), (2, 2)):
        part = grey[rows, columns]
        assert set(part.ravel().tolist()) == {7, 200}
        assert (part == 200).mean() == pytest.approx(0.5, abs=0.02)


def test_regions_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="1x1"):
        region_slices((10, 10), (0, 2))
    with pytest.raises(ValueError, match="choose fewer regions"):
        region_vectors((96, 128), (4, 4), 0.2)
    with pytest.raises(ValueError, match=r"at most 0\.25"):
        region_vectors((96, 128), (2, 2), 0.3)
