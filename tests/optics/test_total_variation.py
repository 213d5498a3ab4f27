"""Splitting against a slow solver of the same problem; photographs with a border, noise, holes.

Photographs are blurred on a larger field than the solver's frame.
"""

import math

import numpy as np
import pytest
from judges import gaussian_psf, natural_image
from scipy.signal import convolve2d, fftconvolve
from skimage import data
from sweeps import some

from optics.inverse.observation_builder import build_observation
from optics.inverse.total_variation import initial_weight, total_variation
from optics.progress import Cancelled, Progress


def disk(radius: float) -> np.ndarray:
    """Antialiased."""
    n = 2 * math.ceil(radius) + 1
    at = (np.arange(n * 16) + 0.5) / 16 - n / 2
    inside = (at[:, None] ** 2 + at**2 <= radius**2).astype(float)
    psf = inside.reshape(n, 16, n, 16).mean((1, 3))
    return psf / psf.sum()


def photograph(side: int = 160) -> np.ndarray:
    return data.camera()[120 : 120 + side, 140 : 140 + side] / 255.0


def blurred(scene, psf, noise, seed=0):
    """The part of the scene that all of the light of which is known, before and after."""
    frame = fftconvolve(scene, psf, mode="valid")
    top, left = (m - 1 - m // 2 for m in psf.shape)
    truth = scene[top : top + frame.shape[0], left : left + frame.shape[1]]
    return truth, frame + np.random.default_rng(seed).normal(0, noise, frame.shape)


def seen(frame, psf, noise=None, border="unknown", **more):
    return build_observation(frame, psf, noise, border, **more)


def psnr(image, truth) -> float:
    return 10 * math.log10(1 / np.mean((np.clip(np.asarray(image), 0, 1) - truth) ** 2))


def comet() -> np.ndarray:
    """Without any symmetry."""
    psf = gaussian_psf(5, 0.8)
    psf += 0.6 * np.roll(psf, (1, 1), (0, 1)) + 0.2 * np.roll(psf, (-1, 1), (0, 1))
    return psf / psf.sum()


def objective(x, psf, frame, trust, weight, whole):
    """Of a picture on the whole period, written out."""
    ring = np.pad(x, [(m, m) for m in psf.shape], mode="wrap")
    spread = convolve2d(ring, psf, mode="full")
    cut = [m + m // 2 for m in psf.shape]
    spread = spread[cut[0] : cut[0] + x.shape[0], cut[1] : cut[1] + x.shape[1]]
    top, left = (n // 2 - m // 2 for n, m in zip(whole, frame.shape, strict=True))
    at = spread[top : top + frame.shape[0], left : left + frame.shape[1]]
    down, along = np.roll(x, -1, 0) - x, np.roll(x, -1, 1) - x
    return (trust * (at - frame) ** 2).sum() / 2 + weight * np.hypot(down, along).sum()


def slowly(psf, frame, trust, weight, whole, steps=3000):
    """Chambolle and Pock's primal-dual algorithm, double precision, for the same problem."""
    operator = np.fft.fft2(
        np.roll(
            np.pad(psf, [(0, n - m) for n, m in zip(whole, psf.shape, strict=True)]),
            [-(m // 2) for m in psf.shape],
            (0, 1),
        )
    )
    top, left = (n // 2 - m // 2 for n, m in zip(whole, frame.shape, strict=True))
    window = slice(top, top + frame.shape[0]), slice(left, left + frame.shape[1])

    def spread(x):
        return np.fft.ifft2(np.fft.fft2(x) * operator).real[window]

    def spread_back(y):
        full = np.zeros(whole)
        full[window] = y
        return np.fft.ifft2(np.fft.fft2(full) * operator.conj()).real

    x = ahead = np.full(whole, frame.mean())
    p, qy, qx = np.zeros(frame.shape), np.zeros(whole), np.zeros(whole)
    tau = sigma = 0.99 / math.sqrt(9)
    for _ in range(steps):
        p = p + sigma * (spread(ahead) - frame)
        p = np.where(trust > 0, p / (1 + sigma / np.maximum(trust, 1e-12)), 0)
        qy = qy + sigma * (np.roll(ahead, -1, 0) - ahead)
        qx = qx + sigma * (np.roll(ahead, -1, 1) - ahead)
        length = np.maximum(np.hypot(qy, qx) / weight, 1)
        qy, qx = qy / length, qx / length
        back = spread_back(p) + np.roll(qy, 1, 0) - qy + np.roll(qx, 1, 1) - qx
        ahead, x = 2 * (x - tau * back) - x, x - tau * back
    return x


@pytest.mark.parametrize("shape", [(15, 20), pytest.param((16, 17), marks=pytest.mark.sweep)])
def test_splitting_ends_where_a_slow_solver_does(shape):
    """Of a frame with an unknown border, dead pixels and less trusted ones."""
    rng = np.random.default_rng(2)
    scene, psf = natural_image(*(n + 4 for n in shape), 3), comet()
    _, frame = blurred(scene, psf, 0.01)
    trust = rng.choice([0.0, 0.3, 1.0], frame.shape, p=[0.1, 0.2, 0.7]).astype(np.float32)
    problem = seen(frame, psf, 0.01, weights=trust)
    weight = 2e-3
    ours = total_variation(problem, weight, iterations=800)
    truth = slowly(psf, frame, trust, weight, problem.period_shape)
    top, left = (n // 2 - m // 2 for n, m in zip(problem.period_shape, frame.shape, strict=True))
    inner = truth[top : top + frame.shape[0], left : left + frame.shape[1]]
    assert np.abs(ours.image.numpy() - inner.clip(0)).max() <= 0.01
    best = objective(truth, psf, frame, trust, weight, problem.period_shape)
    worse = truth + 0.01 * rng.standard_normal(truth.shape)
    assert objective(worse, psf, frame, trust, weight, problem.period_shape) > best


def test_a_period_that_was_seen_whole_needs_no_splitting_of_the_data():
    """The same answer as by the general way, which trusts each pixel as much."""
    psf, scene = comet(), natural_image(32, 34, 4)
    blur = np.fft.fft2(np.roll(np.pad(psf, ((0, 27), (0, 29))), (-2, -2), (0, 1)))
    frame = np.fft.ifft2(np.fft.fft2(scene) * blur).real
    frame += np.random.default_rng(5).normal(0, 0.01, frame.shape)
    short = total_variation(seen(frame, psf, 0.01, "periodic"), 1e-3, iterations=800)
    ones = np.ones(frame.shape, dtype=np.float32)
    general = seen(frame, psf, 0.01, "periodic", weights=ones)
    long = total_variation(general, 1e-3, iterations=800)
    assert np.abs(short.image.numpy() - long.image.numpy()).max() <= 2e-3
    assert short.residual == pytest.approx(long.residual, rel=2e-3)


@pytest.mark.parametrize("psf", some([comet(), disk(3.0), disk(5.0), gaussian_psf(11, 1.5)]))
def test_the_border_costs_nothing(psf):
    """The rim of the frame is restored nearly as well as what lies inside."""
    truth, frame = blurred(photograph(), psf, 0.01)
    restored = total_variation(seen(frame, psf, 0.01)).image.numpy()
    error = (restored - truth) ** 2
    rim = np.ones(error.shape, dtype=bool)
    rim[8:-8, 8:-8] = False
    assert psnr(restored, truth) > psnr(frame, truth) + 1.5
    assert math.sqrt(error[rim].mean()) < 1.4 * math.sqrt(error[~rim].mean())


@pytest.mark.parametrize(
    ("psf", "noise"),
    [
        pytest.param(psf, noise, marks=pytest.mark.sweep if i != j else ())
        for i, psf in enumerate([disk(3.0), gaussian_psf(13, 2.0), comet()])
        for j, noise in enumerate([0.003, 0.01, 0.03])
    ],
)
def test_the_weight_is_nearly_the_best_one(psf, noise):
    """Nobody tells it the noise: within 0.7 dB of the best weight, which knows the truth."""
    truth, frame = blurred(photograph(), psf, noise)
    problem = seen(frame, psf)
    found = total_variation(problem)
    weights = noise**2 * 2.0 ** np.arange(-1, 6)
    best = max(psnr(total_variation(problem, w).image, truth) for w in weights)
    assert psnr(found.image, truth) > best - 0.7
    assert 0.5 < found.residual < 1.1


@pytest.mark.parametrize("noise", [0.003, 0.01, 0.03])
@pytest.mark.parametrize("psf", [disk(3.0), disk(7.0), gaussian_psf(9, 1.0), gaussian_psf(13, 2.0)])
def test_noise_is_estimated_within_five_percent(psf, noise):
    _, frame = blurred(photograph(), psf, noise)
    assert seen(frame, psf).noise == pytest.approx(noise, rel=0.05)


def test_the_spectrum_of_a_known_power_law_is_found():
    """White noise filtered to fall as the frequency to the power 2.6 in power, then blurred."""
    rng, n, psf = np.random.default_rng(6), 256, gaussian_psf(9, 1.0)
    f = np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n))
    f[0, 0] = np.inf
    scene = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((n, n))) * 0.05 * f**-1.3, (n, n))
    _, frame = blurred(scene, psf, 0.02)
    law = seen(frame, psf, 0.0).power_law
    assert law.slope == pytest.approx(2.6, abs=0.15)
    assert law.strength == pytest.approx(0.05**2, rel=0.3)
    assert math.sqrt(law.noise_variance) == pytest.approx(0.02, rel=0.03)


def test_units_of_light_and_of_the_psf_dont_matter():
    psf = comet()
    _, frame = blurred(photograph(96), psf, 0.01)
    plain = total_variation(seen(frame, psf, 0.01), iterations=12)
    other = total_variation(seen(5000 * frame, 0.25 * psf, 50.0), iterations=12)
    assert other.image.numpy() == pytest.approx(20000 * plain.image.numpy(), rel=1e-3, abs=20)
    assert other.residual == pytest.approx(plain.residual, rel=1e-3)


def test_clipped_highlights_are_restored_at_least_as_bright():
    """Their pixels taken for what they say leave dark rings; known as clipped they don't."""
    psf, scene = disk(4.0), photograph() * 0.8
    rng = np.random.default_rng(7)
    for y, x in rng.integers(10, 150, (12, 2)):
        scene[y : y + 3, x : x + 3] = 8.0
    truth, frame = blurred(scene, psf, 0.01)
    clipped = frame > 1
    frame = frame.clip(max=1)
    naive = total_variation(seen(frame, psf, 0.01), iterations=40).image
    known = total_variation(seen(frame, psf, 0.01, clipped=clipped), iterations=40)
    assert psnr(known.image, truth.clip(max=1)) > psnr(naive, truth.clip(max=1)) + 1
    assert float(known.image.max()) > 1.5


def test_dead_pixels_are_filled_from_what_the_others_know():
    psf = disk(3.0)
    truth, frame = blurred(photograph(), psf, 0.01)
    dead = np.random.default_rng(8).random(frame.shape) < 0.05
    broken = np.where(dead, 3.0, frame)
    weights = (~dead).astype(np.float32)
    whole = total_variation(seen(frame, psf, 0.01)).image
    known = total_variation(seen(broken, psf, 0.01, weights=weights)).image
    assert psnr(known, truth) > psnr(whole, truth) - 0.3


def test_stars_before_a_dark_sky_are_restored_without_a_halo():
    psf, scene = disk(4.0), np.zeros((64, 64))
    scene[[12, 30, 30, 50], [20, 30, 34, 44]] = (4, 8, 8, 2)
    frame = fftconvolve(scene, psf, mode="same")
    frame += np.random.default_rng(9).normal(0, 0.002, frame.shape)
    restored = total_variation(seen(frame, psf, 0.002, "dark"), iterations=150).image.numpy()
    assert (restored >= 0).all()
    for y, x in zip((12, 30, 30, 50), (20, 30, 34, 44), strict=True):
        near = restored[y - 1 : y + 2, x - 1 : x + 2].sum()
        assert near == pytest.approx(scene[y, x], rel=0.15)
    # Of 22 in all.
    assert restored[:, :8].sum() < 0.3


def test_shorter_gradients_count_more_with_a_smaller_power():
    """Of a picture of flat patches, heavier tails restore better, each with its best weight."""
    scene = np.kron(np.random.default_rng(10).random((8, 8)), np.ones((16, 16)))
    truth, frame = blurred(scene, disk(3.0), 0.02)
    problem = seen(frame, disk(3.0), 0.02)
    flat, heavy = (
        max(
            psnr(total_variation(problem, 4e-4 * w, power=p, iterations=60).image, truth)
            for w in (4, 8, 16)
        )
        for p in (1.0, 0.6)
    )
    assert heavy > flat + 1


def test_it_ends_when_the_picture_hardly_changes():
    _, frame = blurred(photograph(96), comet(), 0.01)
    done = total_variation(seen(frame, comet(), 0.01), 1e-3, iterations=500, tol=1e-4)
    assert done.converged
    assert done.iterations < 500
    assert len(done.relative_changes) == done.iterations
    short = total_variation(seen(frame, comet(), 0.01), 1e-3, iterations=3, tol=1e-9)
    assert not short.converged


def test_it_can_be_cancelled():
    _, frame = blurred(photograph(64), comet(), 0.01)
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        total_variation(seen(frame, comet(), 0.01), progress=progress)


@pytest.mark.parametrize("frame", [np.zeros((20, 21)), np.full((20, 21), 0.3), np.eye(9) - 0.5])
@pytest.mark.parametrize("noise", [None, 0.0, 0.1])
def test_pictures_without_detail_light_or_noise_stay_finite(frame, noise):
    done = total_variation(seen(frame, comet(), noise))
    assert np.isfinite(done.image.numpy()).all()
    assert math.isfinite(done.residual)
    assert initial_weight(seen(frame, comet(), noise)) >= 0


FRAME = np.full((8, 9), 0.5)


@pytest.mark.parametrize(("make", "words"), [
    (lambda: seen(np.full((8, 9), np.nan), comet()), "image"),
    (lambda: seen(FRAME, np.zeros((3, 3))), "psf sums to 0"),
    (lambda: seen(FRAME, comet(), -1.0), "noise is -1"),
    (lambda: seen(FRAME, comet(), 0.1, "mirror"), "border is 'mirror'"),
    (lambda: seen(FRAME, comet(), 0.1, weights=np.ones((8, 8))), "weights"),
    (lambda: seen(FRAME, comet(), 0.1, weights=np.zeros((8, 9))), "weights"),
    (lambda: seen(FRAME, comet(), 0.1, clipped=np.ones((8, 9), bool)), "every pixel"),
    (lambda: seen(FRAME[None], comet()), "rows, columns"),
    (lambda: total_variation(seen(FRAME, comet()), 0.0), "weight is 0"),
    (lambda: total_variation(seen(FRAME, comet()), power=1.5), "power is 1.5"),
    (lambda: total_variation(seen(FRAME, comet()), iterations=0), "iterations is 0"),
])  # fmt: skip
def test_what_doesnt_fit_is_refused_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make()
