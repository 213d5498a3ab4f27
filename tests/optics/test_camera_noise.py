"""Cameras whose truth is known, from numpy's own generator, are measured as they are."""

import math
from dataclasses import replace

import numpy as np
import pytest
from judges.camera_frames import Lamp, TrueCamera, take_frames
from sweeps import some

from optics.measuring import PairedFrames, characterise_camera
from optics.measuring.group_statistics import noise_below_a_step, rounded_moments
from optics.measuring.paired_frames import measure_pair

PLAIN = TrueCamera()
SPOTS = TrueCamera(
    prnu=0.012, dsnu=2.0, hot=((3, 5), (80, 81), (159, 0)), dead=((10, 10), (140, 12), (0, 159))
)
COARSE = TrueCamera(bits=8, gain=45.0, black=4.0, prnu=0.005)


@pytest.fixture(scope="module")
def plain():
    return characterise_camera(take_frames(PLAIN, 1))


@pytest.fixture(scope="module")
def spots():
    return characterise_camera(take_frames(SPOTS, 2))


def within(found, true, deviations=4.0):
    assert abs(found.value - true) < deviations * found.sigma, (found, true)


def test_photon_transfer_gives_gain_and_noise(plain):
    within(plain.gain, 2.6)
    within(plain.read_noise, 2.4)
    assert plain.gain.sigma < 0.005 * 2.6
    assert plain.read_noise.sigma < 0.01 * 2.4
    assert not plain.read_noise_is_limit
    assert 0.6 < plain.transfer.chi2 < 1.5


def test_darkness_gives_black_level_and_current(plain):
    within(plain.black_level, 64.0)
    within(plain.dark_current, 1.0)
    # Rounding adds a twelfth to the read noise, and 50 µs nothing.
    within(plain.dark_noise, math.sqrt((2.4 / 2.6) ** 2 + 1 / 12))


def test_the_converter_ends_before_the_well(plain):
    assert plain.clip_limit == "converter"
    assert plain.clip_number.value == pytest.approx(4095)
    within(plain.full_well, (4095 - 64) * 2.6)
    # The variance falls as soon as the brightest of the noise clips, three deviations below.
    assert 0.9 < plain.saturation_capacity.value / plain.full_well.value < 1.0


def test_derived_figures_are_those_of_the_standard(plain):
    noise = math.sqrt(2.4**2 + 2.6**2 / 12)
    assert plain.sensitivity_threshold.value == pytest.approx(
        math.sqrt(noise**2 + 0.25) + 0.5, rel=0.02
    )
    capacity = plain.saturation_capacity.value
    assert plain.snr_max.value == pytest.approx(math.sqrt(capacity))
    assert plain.dynamic_range.value == pytest.approx(capacity / plain.sensitivity_threshold.value)
    assert plain.system_gain.value == pytest.approx(1 / plain.gain.value)


def test_a_linear_camera_has_hardly_an_error_of_linearity(plain):
    assert plain.linearity.error.value < 5e-4
    assert abs(plain.linearity.drift.value) < 5e-4


def test_without_a_fixed_pattern_none_is_found(plain):
    assert plain.prnu.value < 4 * max(plain.prnu.sigma, 2e-4)
    assert plain.dsnu.value < 0.15
    assert len(plain.defects.every) == 0


def test_fixed_patterns_are_told_from_noise(spots):
    """The pattern is one sample of 25600 pixels, whose own deviation is known to .44 %."""
    assert spots.prnu.value == pytest.approx(0.012, rel=0.02)
    assert spots.dsnu.value == pytest.approx(2.0, rel=0.02)
    within(spots.gain, 2.6)
    within(spots.read_noise, 2.4)


def test_hot_and_dead_pixels_are_listed_exactly(spots):
    assert sorted(map(tuple, spots.defects.hot.tolist())) == sorted(SPOTS.hot)
    assert sorted(map(tuple, spots.defects.dead.tolist())) == sorted(SPOTS.dead)
    assert len(spots.defects.weak) == len(spots.defects.bright) == 0
    mask = spots.defects.mask(SPOTS.shape)
    assert mask.sum() == 6
    assert mask[3, 5]


def test_pixels_of_wrong_response_are_listed_by_how_far():
    """A pixel that reads a third too much, and one that reads a third too little."""
    source = take_frames(PLAIN, 3)
    frames = [frame.copy() for frame in source.frames]
    for frame, lit in zip(frames, source.lit, strict=True):
        if lit:
            for pixel, factor in (((50, 50), 4 / 3), ((60, 20), 2 / 3)):
                frame[pixel] = min(4095, round((int(frame[pixel]) - 64) * factor) + 64)
    found = characterise_camera(replace(source, frames=frames)).defects
    assert found.bright.tolist() == [[50, 50]]
    assert found.weak.tolist() == [[60, 20]]


def test_a_full_well_shows_below_the_converters_end():
    camera = TrueCamera(well=8000.0, prnu=0.01)
    found = characterise_camera(take_frames(camera, 4))
    assert found.clip_limit == "well"
    within(found.full_well, 8000.0)
    assert found.clip_number.value == pytest.approx(8000 / 2.6 + 64, abs=1)


def test_coarse_numbers_give_gain_and_a_limit_of_the_noise():
    """2.4 electrons are a nineteenth of a step: no frame shows them."""
    found = characterise_camera(take_frames(COARSE, 5))
    within(found.gain, 45.0)
    within(found.full_well, 10_500.0)
    within(found.black_level, 4.0)
    assert found.read_noise_is_limit
    assert 2.4 < found.read_noise.value < 12


def test_noise_of_a_third_of_a_step_is_measured():
    camera = replace(COARSE, read_noise=15.0, dsnu=10.0)
    found = characterise_camera(take_frames(camera, 6))
    within(found.read_noise, 15.0)
    assert not found.read_noise_is_limit


@pytest.mark.parametrize(("drift", "rising"), some([(0.05, True), (0.05, False), (-0.2, False)]))
def test_a_lamp_that_drifts_changes_no_noise(drift, rising):
    source = take_frames(PLAIN, 7, lamp=Lamp(drift=drift), rising=rising)
    found = characterise_camera(source)
    within(found.gain, 2.6)
    assert 0.6 < found.transfer.chi2 < 1.5
    if rising:
        # Exposures that only rise can't tell it from a bent line.
        assert found.linearity.drift is None
        return
    # From the first to the last pair, relative to the light in the middle.
    begun = source.times[source.lit].reshape(-1, 2).mean(axis=1)
    share = np.ptp(begun) / (2 * sum(source.light))
    expected = drift * share / (1 + drift / 2)
    assert found.linearity.drift.value == pytest.approx(expected, rel=0.05)
    assert found.linearity.error.value < 2e-3


def test_a_lamp_that_flickers_between_a_pair_changes_no_noise():
    found = characterise_camera(take_frames(PLAIN, 8, lamp=Lamp(flicker=0.03, shade=0.3)))
    within(found.gain, 2.6)
    assert 0.6 < found.transfer.chi2 < 1.5
    assert found.lamp_jump > 0.03


def test_light_that_falls_to_half_in_the_corners_is_measured_right():
    """Of 3 x 3 areas, those in the corners have .759 of the light, and the middle one .981."""
    found = characterise_camera(take_frames(SPOTS, 9, lamp=Lamp(shade=0.5)))
    within(found.gain, 2.6)
    within(found.full_well, SPOTS.full)
    assert found.prnu.value == pytest.approx(0.012, rel=0.03)
    assert found.unevenness == pytest.approx(0.3, abs=0.02)


def test_a_bent_line_is_found_out():
    """Numbers that are 2 % too low at full scale, by the square: the best line through 5 to 95 %
    of it leaves .2 % on average."""
    found = characterise_camera(take_frames(TrueCamera(bend=0.02), 10))
    assert 0.001 < found.linearity.error.value < 0.005


def test_colour_filters_are_measured_apart():
    """Half of the light behind every other column."""
    source = take_frames(PLAIN, 11)
    other = take_frames(PLAIN, 12, lamp=Lamp())
    frames = []
    for frame, second, lit, time in zip(
        source.frames, other.frames, source.lit, source.exposures, strict=True
    ):
        seen = frame.copy()
        if lit:
            # A frame of half the time has half the light.
            half = [
                one
                for one, t, is_lit in zip(other.frames, other.exposures, other.lit, strict=True)
                if is_lit and t <= time / 2
            ]
            seen[:, 1::2] = (half[-1] if half else second)[:, 1::2]
        frames.append(seen)
    found = characterise_camera(replace(source, frames=frames, period=(1, 2)))
    within(found.gain, 2.6)
    assert len(found.defects.every) == 0


@pytest.mark.sweep
@pytest.mark.parametrize("camera", [PLAIN, SPOTS, replace(COARSE, read_noise=15.0, dsnu=10.0)])
def test_uncertainties_are_those_of_repeated_measurements(camera):
    """Twenty seeds: the mean squared error over the stated variance is 1 within its own spread."""
    names = {"gain": camera.gain, "read_noise": camera.read_noise, "full_well": camera.full}
    pulls = {name: [] for name in names}
    for seed in range(20):
        found = characterise_camera(take_frames(camera, 100 + seed))
        for name, true in names.items():
            one = getattr(found, name)
            pulls[name].append((one.value - true) / one.sigma)
    for name, seen in pulls.items():
        assert 0.35 < np.mean(np.square(seen)) < 2.0, name


def test_rounding_is_as_sheppard_says_where_noise_is_large():
    mean, variance = rounded_moments(np.array([3.2]), 1.5)
    assert mean[0] == pytest.approx(3.2, abs=1e-9)
    assert variance[0] == pytest.approx(1.5**2 + 1 / 12, rel=1e-9)


@pytest.mark.parametrize(("level", "spread", "noise"), [(4.3, 0.0, 0.25), (4.0, 0.4, 0.15)])
def test_noise_below_a_step_is_found_from_drawn_numbers(level, spread, noise):
    rng = np.random.default_rng(0)
    pixels = level + spread * rng.standard_normal(400_000)
    pair = [np.round(pixels + noise * rng.standard_normal(pixels.shape)) for _ in range(2)]
    temporal = ((pair[0] - pair[1]) ** 2).mean() / 2
    found = noise_below_a_step(pair[0].mean(), pair[0].var(), temporal)
    assert found == pytest.approx(noise, rel=0.03)


def test_a_pairs_noise_has_nothing_of_what_is_fixed():
    """A checkerboard of 100 numbers, and normal noise of 2."""
    rng = np.random.default_rng(0)
    board = 100.0 * (np.indices((400, 400)).sum(0) % 2)
    pair = [np.round(board + 500 + 2 * rng.standard_normal(board.shape)) for _ in range(2)]
    found = measure_pair(*pair, np.ones(board.shape, dtype=bool))
    assert found.mean == pytest.approx(550, abs=0.05)
    assert found.variance == pytest.approx(4 + 1 / 12, rel=0.02)
    assert found.spread == pytest.approx(2, rel=0.05)


def test_a_pair_in_light_that_changed_has_the_noise_of_its_mean_light():
    """A tenth more light in the second frame, over a slope of one to two."""
    rng = np.random.default_rng(1)
    light = np.linspace(2000, 4000, 300) * np.ones((300, 1))
    pair = [rng.poisson(light * factor) + 64 for factor in (1.0, 1.1)]
    found = measure_pair(*pair, np.ones(light.shape, dtype=bool), dark=64.0)
    assert found.ratio == pytest.approx(1.1, rel=0.001)
    assert found.variance == pytest.approx(3000 * 1.05, rel=0.02)


SMALL = TrueCamera(shape=(48, 48))


@pytest.fixture(scope="module")
def small():
    return take_frames(SMALL, 13)


def changed(source, keep=None, **fields):
    """The frames that `keep` (exposure, lit) keeps, with other fields."""
    kept = [
        n
        for n, (time, lit) in enumerate(zip(source.exposures, source.lit, strict=True))
        if keep is None or keep(time, lit)
    ]
    made = {
        "frames": [source.frames[n] for n in kept],
        "exposures": source.exposures[kept],
        "lit": source.lit[kept],
        "top_number": source.top_number,
    }
    return PairedFrames(**(made | fields))


@pytest.mark.parametrize(
    ("keep", "message"),
    [
        (lambda _, lit: not lit, "all frames are dark; take frames of an evenly lit target"),
        (lambda _, lit: lit, "no frame is dark; take two dark frames of every exposure time"),
        (lambda t, lit: lit or t > 0.1, r"there are no dark frames of 0\.05, 6.* and 3 more"),
        (lambda t, lit: not lit or t > 0.24, "1 exposure times, and a curve needs 5 or more"),
    ],
)
def test_frames_that_are_missing_are_named(small, keep, message):
    with pytest.raises(ValueError, match=message):
        changed(small, keep)


def test_a_frame_without_a_second_is_named(small):
    first = list(dict.fromkeys(zip(small.exposures.tolist(), small.lit.tolist(), strict=True)))
    at = [
        int(np.flatnonzero((small.exposures == time) & (small.lit == lit))[0])
        for time, lit in first
    ]
    with pytest.raises(ValueError, match=r"there is one lit frame of 0\.05 ms; noise is measured"):
        PairedFrames(
            [small.frames[n] for n in at], small.exposures[at], small.lit[at], small.top_number
        )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"exposures": [0.1]}, "96 frames, 1 exposures and 88 marks"),
        ({"exposures": np.zeros(88)}, "an exposure is 0 s; all must be positive"),
        ({"frames": [np.zeros((4, 4))] * 87 + [np.zeros((4, 5))]}, r"frames are \(4, 4\), \(4, 5"),
    ],
)
def test_frames_that_dont_fit_are_refused(small, change, message):
    with pytest.raises(ValueError, match=message.replace("96", str(len(small.frames)))):
        changed(small, **change)


def with_light(source, number):
    """All lit frames at one number."""
    frames = [
        np.full_like(frame, number(frame)) if lit else frame
        for frame, lit in zip(source.frames, source.lit, strict=True)
    ]
    return changed(source, frames=frames)


def test_frames_that_are_saturated_throughout_are_named(small):
    with pytest.raises(ValueError, match="the light is saturated at every exposure time"):
        characterise_camera(with_light(small, lambda _: 4095))


def test_light_that_is_dark_is_named(small):
    with pytest.raises(ValueError, match=r"the lit frames are at most 0.* above the dark; light"):
        characterise_camera(with_light(small, lambda _: 64))


def test_swapped_light_and_darkness_is_named(small):
    swapped = PairedFrames(
        [frame for frame, t in zip(small.frames, small.exposures, strict=True) if t < 0.3],
        small.exposures[small.exposures < 0.3],
        ~small.lit[small.exposures < 0.3],
        small.top_number,
    )
    with pytest.raises(ValueError, match="check that light and dark frames aren't swapped"):
        characterise_camera(swapped)


def test_dark_numbers_that_end_at_zero_are_named():
    with pytest.raises(ValueError, match=r"of the dark numbers .* are 0, .* raise the camera's"):
        characterise_camera(take_frames(replace(SMALL, black=0.0), 14))


def test_wrong_bits_are_named(small):
    with pytest.raises(ValueError, match="numbers up to 4095, and the converter is said to end at"):
        characterise_camera(changed(small, top_number=1023))


def test_too_few_exposures_below_saturation_are_named(small):
    with pytest.raises(ValueError, match=r"2 exposure times are above .* below 70% of saturation"):
        characterise_camera(changed(small, lambda t, lit: not lit or t < 0.015 or t > 0.2))


def test_without_a_saturated_exposure_full_well_and_capacity_are_unknown(small):
    found = characterise_camera(changed(small, lambda t, lit: not lit or t < 0.15))
    assert found.full_well is None
    assert found.clip_limit is None
    assert found.saturation_capacity is None
    assert found.dynamic_range is None
    within(found.gain, 2.6)
