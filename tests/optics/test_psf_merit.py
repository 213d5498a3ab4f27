"""Scenes of dead leaves by their statistics, and the merit of PSFs by simulations of its own."""

import math

import numpy as np
import pytest
import torch
from scipy.ndimage import convolve

from optics.inverse import build_mosaic_observation
from optics.multispectral import PsfMerit, draw_dead_leaves, predict_errors, restore_spectra

SPECTRA = np.array([[1, 0.9, 0.8], [0.2, 0.5, 0.9], [0.8, 0.4, 0.1], [0.1, 0.1, 0.2]])
RESPONSE = np.array([[0.1, 0.1, 0.8], [0.2, 0.8, 0.1], [0.7, 0.1, 0.1]])
BAYER = ("RG", "GB")
NOISE = 0.01


def scene(seed=0, side=48):
    generator = torch.Generator().manual_seed(seed)
    return draw_dead_leaves(torch.from_numpy(SPECTRA), side, generator).numpy()


def merit(seed=0, **options):
    given = {"side": 32, **options}
    generator = torch.Generator().manual_seed(seed)
    return PsfMerit(RESPONSE, BAYER, SPECTRA, NOISE, generator=generator, **given)


def pulses(*places):
    psfs = np.zeros((3, 9, 9))
    for psf, (y, x) in zip(psfs, places, strict=True):
        psf[y, x] = 1.0
    return psfs


POINTS = pulses((4, 4), (4, 4), (4, 4))


def test_each_pixel_of_dead_leaves_has_a_typical_spectrum_of_some_brightness():
    spectra = scene().reshape(3, -1)
    lengths = np.linalg.norm(SPECTRA, axis=1)
    alike = (SPECTRA / lengths[:, None]) @ (spectra / np.linalg.norm(spectra, axis=0))
    nearest = alike.argmax(0)
    assert alike.max(0) == pytest.approx(np.ones(spectra.shape[1]))
    brightness = np.linalg.norm(spectra, axis=0) / lengths[nearest]
    assert brightness.min() >= 0.2
    assert brightness.max() <= 1
    assert set(nearest) == {0, 1, 2, 3}


def test_dead_leaves_are_flat_but_for_edges_that_fit_around_the_border():
    shades = scene()[0]
    across = np.mean(shades != np.roll(shades, 1, 1))
    border = np.mean(shades[:, 0] != shades[:, -1])
    assert 0.05 < across < 0.5
    assert border < 3 * across


def test_the_power_of_dead_leaves_falls_about_with_the_square_of_the_frequency():
    power = np.mean([np.abs(np.fft.fft2(scene(n)[0])) ** 2 for n in range(8)], 0)
    f = np.fft.fftfreq(48)
    far = np.hypot(f[:, None], f)
    used = (far > 0.05) & (far < 0.4)
    slope = np.polyfit(np.log(far[used]), np.log(power[used]), 1)[0]
    assert -3.2 < slope < -2


def test_the_same_seed_draws_the_same_leaves():
    assert np.array_equal(scene(1), scene(1))
    assert not np.array_equal(scene(1), scene(2))


def test_the_merit_is_the_mean_of_the_prediction_and_a_restored_simulation():
    """The picture is blurred by scipy and mixed pixel by pixel."""
    psfs = np.random.default_rng(3).random((3, 5, 5)) ** 4
    psfs /= psfs.sum((1, 2), keepdims=True)
    generator = torch.Generator().manual_seed(0)
    truth = draw_dead_leaves(torch.from_numpy(SPECTRA), 32, generator).numpy()
    raw = NOISE * torch.randn(32, 32, generator=generator, dtype=torch.float64).numpy()
    blurred = [convolve(band, psf, mode="wrap") for band, psf in zip(truth, psfs, strict=True)]
    for y, x in np.ndindex(32, 32):
        letter = "RGB".index(BAYER[y % 2][x % 2])
        raw[y, x] += sum(RESPONSE[letter, n] * blurred[n][y, x] for n in range(3))
    seen = build_mosaic_observation(
        raw.astype(np.float32), BAYER, psfs, response=RESPONSE, noise=NOISE, border="periodic"
    )
    image = restore_spectra(seen, SPECTRA, iterations=60, adapts=False).image
    simulated = np.mean(-10 * np.log10(np.mean((image - truth) ** 2, axis=(1, 2))))
    predicted = predict_errors(psfs, RESPONSE, BAYER, SPECTRA, NOISE).mean_psnr
    found = merit()
    assert found.simulated_psnr(torch.from_numpy(psfs)) == pytest.approx(simulated, abs=0.02)
    assert found(psfs) == pytest.approx((simulated + predicted) / 2, abs=0.02)


def test_blur_that_doesnt_disperse_has_less_merit():
    box = np.full((3, 9, 9), 1 / 81)
    rated = merit()
    assert rated(POINTS) > rated(box) + 3
    assert rated(POINTS) == rated(torch.from_numpy(POINTS))


def test_a_simulated_scene_shows_what_dispersion_separates_behind_one_filter():
    """A Gaussian scene doesn't: its errors move from band to band."""
    grey = np.ones((1, 2)) / 2
    spectra = np.array([[1, 0.1], [0.1, 1.0], [0.6, 0.5]])
    generator = torch.Generator().manual_seed(0)
    rated = PsfMerit(grey, ("W",), spectra, 0.003, generator=generator, channels="W", side=32)
    alike, apart = (torch.from_numpy(one) for one in (POINTS[:2], POINTS[:2].copy()))
    apart[1] = 0
    apart[1, 4, 4] = 0.4
    apart[1, [0, 8], 4] = 0.3
    assert rated.simulated_psnr(apart) > rated.simulated_psnr(alike) + 0.5


@pytest.mark.parametrize(
    ("argument", "value"), [("side", 0), ("spectra", np.ones(3)), ("spectra", np.ones((0, 3)))]
)
def test_bad_arguments_are_named(argument, value):
    given = {"spectra": SPECTRA, "side": 16, argument: value}
    with pytest.raises(ValueError, match=argument):
        PsfMerit(
            RESPONSE, BAYER, given["spectra"], NOISE, generator=torch.Generator(),
            side=given["side"],
        )  # fmt: skip


@pytest.mark.parametrize("noise", [0.0, math.nan])
def test_noise_must_be_positive(noise):
    with pytest.raises(ValueError, match="noise"):
        PsfMerit(RESPONSE, BAYER, SPECTRA, noise, generator=torch.Generator(), side=16)
