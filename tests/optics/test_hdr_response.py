"""Response curves of 8-bit pictures, recovered from brackets of a known one."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from optics.hdr import CLIPPED, DARK, fit_response, merge_by_response

MEMORIAL = Path(__file__).parents[3] / "shared/data/hdr/memorial"
TIMES = np.array([4.0, 2.0, 1.0, 0.5, 0.25, 0.125])


def number(exposure):
    """A film with fog, toe and shoulder (Naka and Rushton's function)."""
    power = exposure**0.7
    return 15 + 240 * power / (power + 2)


def pictures(noise=0.7, times=TIMES, seed=1):
    """Smooth light of five decades, and pictures of it."""
    rng = np.random.default_rng(seed)
    light = 10 ** (np.linspace(-2.5, 2.5, 240)[:, None] + 0.3 * np.sin(np.arange(200) / 9))
    exact = number(light * np.asarray(times)[:, None, None])
    frames = np.clip(np.round(exact + rng.normal(0, noise, exact.shape)), 0, 255)
    return light, frames.astype(np.uint8)


def test_the_curve_is_that_of_the_pictures():
    _, frames = pictures()
    curve = fit_response(frames, TIMES)
    levels = np.arange(35, 236)
    share = (levels - 15) / 240
    truth = np.log(2 * share / (1 - share)) / 0.7
    away = curve.logs[levels] - truth
    assert np.abs(away - np.median(away)).max() < 0.05
    # Rounding adds to the noise.
    assert curve.number_noise == pytest.approx(np.hypot(0.7, 12**-0.5), rel=0.25)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_three_exposures_far_apart_tell_a_curve_without_ripples(seed):
    """sRGB's curve (IEC 61966-2-1), and even patches; ripples with a period of 8 fit as well."""
    rng, times = np.random.default_rng(seed), np.array([0.125, 1.0, 8.0])
    patches = 10 ** rng.uniform(-2.5, 0.5, (4, 4))
    light = np.kron(patches, np.ones((60, 80))) * np.exp(rng.normal(0, 0.02, (240, 320)))
    share = np.minimum(light * times[:, None, None], 1)
    coded = np.where(share < 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
    frames = np.clip(np.round(255 * coded + rng.normal(0, 0.5, coded.shape)), 0, 255)
    curve = fit_response(frames.astype(np.uint8), times)
    levels = np.arange(30, 246)
    away = curve.logs[levels] - np.log(((levels / 255 + 0.055) / 1.055) ** 2.4)
    assert np.abs(away - np.median(away)).max() < 0.1


def test_merged_light_is_that_of_the_scene_and_better_than_opencvs():
    light, frames = pictures()
    merged = merge_by_response(frames, TIMES, fit_response(frames, TIMES))
    seen = ((frames >= 5) & (frames <= 250)).sum(axis=0) >= 2
    away = np.log2(merged.rate.numpy() / light)
    valid = seen & (merged.state.numpy() == 0)
    assert valid.mean() > 0.8
    assert away[valid].std() < 0.08
    bright = valid & (light > 0.05) & (light < 50)
    assert away[bright].std() < 0.03
    colours = [cv2.merge([one] * 3) for one in frames]
    times = TIMES.astype(np.float32)
    for calibrate, merge in (
        (cv2.createCalibrateDebevec(), cv2.createMergeDebevec()),
        (cv2.createCalibrateRobertson(), cv2.createMergeRobertson()),
    ):
        theirs = merge.process(colours, times, calibrate.process(colours, times))[..., 0]
        assert np.log2(np.maximum(theirs, 1e-9) / light)[valid].std() > away[valid].std()


def test_the_stated_variance_is_the_achieved_one():
    light, frames = pictures()
    merged = merge_by_response(frames, TIMES, fit_response(frames, TIMES))
    inside = (light > 0.3) & (light < 10)
    away = np.log(merged.rate.numpy() / light)[inside]
    stated = (merged.variance.numpy() / merged.rate.numpy() ** 2)[inside]
    assert away.var() / stated.mean() == pytest.approx(1, abs=0.5)


def test_dark_and_clipped_pixels_say_so():
    _, frames = pictures()
    frames = frames.copy()
    frames[:, 0, :10], frames[:, 1, :10] = 255, 15
    merged = merge_by_response(frames, TIMES, fit_response(frames, TIMES))
    state = merged.state.numpy()
    assert (state[0, :10] == CLIPPED).all()
    assert np.isinf(merged.variance.numpy()[0, :10]).all()
    assert (state[1, :10] == DARK).all()
    assert np.isfinite(merged.rate.numpy()).all()


def test_light_beyond_the_curves_ends_is_bounded_and_its_deviation_honest():
    """Scanned pictures clip unevenly: one exposure of a clipped pixel may show a lower number."""
    _, frames = pictures()
    frames = frames.copy()
    frames[:, 0, :10], frames[:, 1, :10] = 255, 15
    frames[2, 0, :10] = 250
    curve = fit_response(frames, TIMES)
    merged = merge_by_response(frames, TIMES, curve)
    rate, variance, state = (one.numpy() for one in (merged.rate, merged.variance, merged.state))
    # In the curve's scale, 1 makes the number 128.
    share = 113 / 240
    scale = (2 * share / (1 - share)) ** (1 / 0.7)
    assert (state[0, :10] == CLIPPED).all()
    assert np.isinf(variance[0, :10]).all()
    # The number 240 of the shortest exposure is made by 130 / 0.125, and 250 by 700 / 0.125.
    assert (rate[0, :10] * scale > 130 / 0.125).all()
    assert (rate[0, :10] * scale < 1000 / 0.125).all()
    # In the longest exposure, a light of 0.0011 makes the number 17.7, three deviations above 15.
    assert (state[1, :10] == DARK).all()
    assert (np.sqrt(variance[1, :10]) * scale > 0.0001).all()
    assert (np.sqrt(variance[1, :10]) * scale < 0.003).all()
    assert (rate[1, :10] <= 3 * np.sqrt(variance[1, :10])).all()


def test_what_tells_no_curve_is_refused():
    _, frames = pictures()
    with pytest.raises(ValueError, match="two exposure times at least"):
        fit_response(frames[:2], [1.0, 1.0])
    with pytest.raises(ValueError, match="0 pixels have numbers from 5 to 250 in two frames"):
        fit_response(np.full((3, 50, 50), 255, np.uint8), [1, 2, 4])
    white = frames[:3].copy()
    white[1] = 255
    with pytest.raises(ValueError, match=r"in two neighbouring exposures.* add exposures"):
        fit_response(white, TIMES[:3])
    with pytest.raises(ValueError, match="numbers hardly change"):
        fit_response(np.full((3, 50, 50), 128, np.uint8), [1, 2, 4])
    curve = fit_response(frames, TIMES)
    with pytest.raises(ValueError, match="6 frames of 1 sizes and 2 exposures"):
        merge_by_response(frames, [1.0, 2.0], curve)
    with pytest.raises(ValueError, match="aren't 8-bit"):
        merge_by_response(frames.astype(np.uint16), TIMES, curve)


@pytest.mark.shared
@pytest.mark.skipif(not MEMORIAL.exists(), reason="no photographs beside the checkout")
def test_memorial_church_is_nearer_to_its_authors_radiance_than_opencvs_merges():
    """Standard deviation of log2 of the ratio to memorial.hdr, made of all 16 exposures by Debevec;
    pixels with numbers from 5 to 250 in two of the eight frames, and not in the blue borders. Of
    two rows and three columns, one: pixels are merged one by one, and are more than are merged at
    once."""
    paths = [MEMORIAL / f"memorial{61 + number:04d}.png" for number in range(8)]
    frames = np.array([cv2.imread(str(path))[::2, ::3] for path in paths])
    times = np.array([32, 16, 8, 4, 2, 1, 0.5, 0.25], np.float32)
    published = cv2.imread(str(MEMORIAL / "memorial.hdr"), cv2.IMREAD_UNCHANGED)[::2, ::3]
    border = ((frames[..., 0] == 255) & (frames[..., 1:] == 0).all(axis=-1)).any(axis=0)
    seen = (((frames >= 5) & (frames <= 250)).sum(axis=0) >= 2).all(axis=-1)
    seen &= ~border & (published > 0).all(axis=-1)

    def spread(light):
        ratio = light.mean(axis=-1)[seen] / published.mean(axis=-1)[seen]
        return float(np.log2(ratio).std())

    ours = [
        merge_by_response(frames[..., band], times, fit_response(frames[..., band], times)).rate
        for band in range(3)
    ]
    found = spread(np.stack(ours, axis=-1))
    assert found <= 0.19
    for calibrate, merge in (
        (cv2.createCalibrateDebevec(), cv2.createMergeDebevec()),
        (cv2.createCalibrateRobertson(), cv2.createMergeRobertson()),
    ):
        every = list(frames)
        assert spread(merge.process(every, times, calibrate.process(every, times))) > found
