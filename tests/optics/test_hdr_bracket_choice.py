"""Chosen exposure brackets, against an exhaustive search, and on numpy's own frames."""

import math
from dataclasses import replace

import numpy as np
import pytest
from judges.exhaustive_bracket import exhaustive
from sweeps import some

from optics.camera import Sensor
from optics.hdr import (
    Bracket,
    ExposureLimits,
    UnreachableSNR,
    WantedSNR,
    choose_bracket,
    choose_ladder,
    common_period,
    cramer_rao_variance,
    merge,
)

SENSOR = Sensor()
LIMITS = ExposureLimits(20e-6, 30.0, readout=0.008)


def least_snr_db(sensor: Sensor, wanted: WantedSNR, times) -> float:
    """The least ratio over the range, away from clip levels, by the bound of the merge."""
    count = len(times)
    bracket = Bracket(
        np.full((count, 1, 1), sensor.black_level), times, [sensor.black_level] * count,
        [wanted.darks] * count, sensor,
    )  # fmt: skip
    rates = np.geomspace(wanted.low, wanted.high, 400)
    found = [rate / math.sqrt(cramer_rao_variance(bracket, rate)) for rate in rates]
    return 20 * math.log10(min(found))


@pytest.mark.parametrize(
    ("snr_db", "decades", "darks", "counted", "readout", "read_noise"),
    some(
        [
            (30, 4, math.inf, False, 0.008, 2.4),
            (20, 5, 4, False, 0.001, 2.4),
            (15, 3, 1, False, 0.0, 30.0),
            (36, 2, math.inf, False, 0.002, 10.0),
            (25, 2.5, 4, True, 0.02, 5.0),
        ],
        *(2, 3, 4),
    ),
)
def test_the_quickest_bracket_is_that_of_an_exhaustive_search(
    snr_db, decades, darks, counted, readout, read_noise
):
    sensor = replace(SENSOR, read_noise=read_noise)
    wanted = WantedSNR(snr_db, 1e6 / 10**decades, 1e6, darks, darks if counted else 0)
    limits = replace(LIMITS, readout=readout)
    found = choose_bracket(sensor, wanted, limits)
    judged = exhaustive(sensor, wanted, limits)
    assert found.duration <= 1.01 * judged.duration
    assert least_snr_db(sensor, wanted, found.times) >= snr_db - 0.02
    each = sum(found.times) + readout * found.frames
    each += wanted.counted_darks * sum(time + readout for time in set(found.times))
    assert found.duration == pytest.approx(each)


def test_no_bracket_of_one_frame_less_suffices_where_the_fewest_are_wanted():
    """All pairs and triples of 60 exposure times, against the fewest frames by choice."""
    wanted = WantedSNR(26, 1e2, 1e6)
    found = choose_bracket(SENSOR, wanted, LIMITS, "frames")
    assert found.frames == 3
    assert least_snr_db(SENSOR, wanted, found.times) >= 26 - 0.02
    times = np.geomspace(1e-3, 30, 60)
    rates = np.geomspace(wanted.low, wanted.high, 200)[:, None]
    light, floor = rates * times, 2.4**2 + 2.6**2 / 12 + times
    told = np.where(light < 4031 * 2.6 - times, light**2 / (light + floor), 0)
    pairs = told[:, :, None] + told[:, None, :]
    assert not (pairs >= 10**2.6).all(axis=0).any()


@pytest.mark.parametrize("seed", some(range(3)))
def test_merged_frames_reach_the_ratio(seed):
    """Frames of a scene of three decades, merged: the error in each tenth of a decade."""
    rng = np.random.default_rng(seed)
    wanted = WantedSNR(float(rng.uniform(20, 38)), 1e3, 1e6, 4)
    chosen = choose_bracket(SENSOR, wanted, LIMITS)
    rate = 1e3 * 10 ** rng.uniform(0, 3, (300, 400))

    def numbers(light, time):
        electrons = rng.poisson(light + time, (300, 400)) + rng.normal(0, 2.4, (300, 400))
        return np.clip(np.round(electrons / 2.6 + 64), 0, 4095)

    dark = {t: np.mean([numbers(0 * rate, t) for _ in range(4)], axis=0) for t in set(chosen.times)}
    frames = [numbers(rate * t, t) for t in chosen.times]
    darks = [dark[t] for t in chosen.times]
    merged = merge(Bracket(frames, chosen.times, darks, [4] * chosen.frames, SENSOR))
    error = (merged.rate.numpy() / rate - 1).ravel()
    place = np.digitize(np.log10(rate.ravel()), np.arange(3, 6, 0.1))
    reached = np.array(
        [-10 * math.log10(np.mean(error[place == one] ** 2)) for one in np.unique(place)]
    )
    assert (reached >= wanted.snr_db - 0.15).mean() >= 0.95
    # The ratio isn't far beyond everywhere, which would be a waste of time.
    assert reached.min() <= wanted.snr_db + 1.5


@pytest.mark.parametrize("ratio", some([2, 4, 8]))
def test_a_chosen_bracket_takes_no_longer_than_a_ladder(ratio):
    wanted = WantedSNR(28, 1e2, 1e6, 4)
    chosen = choose_bracket(SENSOR, wanted, LIMITS)
    ladder = choose_ladder(SENSOR, wanted, LIMITS, ratio)
    steps = np.array(sorted(set(ladder.times)))
    np.testing.assert_allclose(steps[1:] / steps[:-1], ratio, rtol=1e-2)
    assert least_snr_db(SENSOR, wanted, ladder.times) >= 28 - 0.02
    assert chosen.duration <= ladder.duration
    if ratio == 2:
        assert chosen.frames <= 2 / 3 * ladder.frames


def test_exposures_are_whole_periods_or_among_those_that_are_allowed():
    wanted = WantedSNR(25, 30, 1e5)
    periods = choose_bracket(SENSOR, wanted, replace(LIMITS, period=0.01)).times
    np.testing.assert_allclose(np.array(periods) / 0.01, np.round(np.array(periods) / 0.01))
    listed = (0.001, 0.02, 0.5, 3.0, 10.0)
    among = choose_bracket(SENSOR, wanted, replace(LIMITS, times=listed))
    assert set(among.times) <= set(listed)
    assert least_snr_db(SENSOR, wanted, among.times) >= 25 - 0.02


def test_exposures_that_are_there_already_count():
    wanted = WantedSNR(25, 1e2, 1e5)
    whole = choose_bracket(SENSOR, wanted, LIMITS)
    taken = ((0.02, 1), (0.7, 2))
    rest = choose_bracket(SENSOR, wanted, LIMITS, taken=taken)
    assert rest.duration < whole.duration
    both = [*rest.times, 0.02, 0.7, 0.7]
    assert least_snr_db(SENSOR, wanted, both) >= 25 - 0.02
    assert choose_bracket(SENSOR, wanted, LIMITS, taken=whole.groups).times == ()


def test_a_ratio_out_of_reach_is_refused_with_what_can_be_reached():
    few = replace(LIMITS, most_frames=3, longest=1.0)
    with pytest.raises(
        UnreachableSNR, match=r"40 dB aren't .*with 3 frames of at most 1000 ms"
    ) as e:
        choose_bracket(SENSOR, WantedSNR(40, 1e2, 1e6), few)
    offered = float(str(e.value).split("the whole range, ")[1].split(" dB")[0])
    choose_bracket(SENSOR, WantedSNR(offered - 0.05, 1e2, 1e6), few)
    with pytest.raises(UnreachableSNR):
        choose_bracket(SENSOR, WantedSNR(offered + 0.15, 1e2, 1e6), few)
    with pytest.raises(UnreachableSNR, match="may be clipped in the shortest exposure, 10 ms"):
        choose_bracket(SENSOR, WantedSNR(30, 1e3, 1e7), replace(LIMITS, shortest=0.01))
    with pytest.raises(UnreachableSNR, match="no ladder of x2"):
        choose_ladder(SENSOR, WantedSNR(40, 1e2, 1e6), few, 2)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: WantedSNR(30, 0, 1), "range is 0 to 1"),
        (lambda: WantedSNR(30, 2, 1), "the lower one comes first"),
        (lambda: WantedSNR(math.nan, 1, 2), "snr_db is nan"),
        (lambda: WantedSNR(30, 1, 2, 0.5), "darks is 0.5"),
        (lambda: WantedSNR(30, 1, 2, counted_darks=-1), "counted_darks is -1"),
        (lambda: ExposureLimits(1, 0.1), "limited to 1 to 0.1"),
        (lambda: ExposureLimits(0.1, 1, readout=-1), "readout is -1"),
        (lambda: ExposureLimits(0.1, 1, period=0), "period is 0"),
        (lambda: ExposureLimits(0.001, 0.005, period=0.01), "no exposure time"),
        (lambda: ExposureLimits(0.1, 1, most_frames=0), "most_frames is 0"),
        (lambda: choose_bracket(SENSOR, WantedSNR(30, 1, 2), LIMITS, "money"), "choose time"),
        (lambda: choose_ladder(SENSOR, WantedSNR(30, 1, 2), LIMITS, 1.0), "ratio is 1"),
    ],
)
def test_bad_numbers_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_the_common_period_of_a_lamp_and_a_video():
    """Of 100 Hz and four frames at 60 Hz: two videos last 133.3 ms, three 200 ms, 20 periods."""
    assert common_period([0.01, 4 / 60]) == pytest.approx(0.2)
    assert common_period([0.01]) == 0.01
    with pytest.raises(ValueError, match="no common one"):
        common_period([0.01, 0.01 * (1 + math.sqrt(5)) / 2])


@pytest.mark.parametrize("longest", some([0.02, 0.1, 1.0]))
def test_exposures_at_the_longest_are_repeated(longest):
    """Where a single exposure can't be long enough, several are taken."""
    wanted, limits = WantedSNR(30, 1e3, 1e6), replace(LIMITS, longest=longest, most_frames=99)
    chosen = choose_bracket(SENSOR, wanted, limits)
    assert max(chosen.times) <= longest
    assert least_snr_db(SENSOR, wanted, chosen.times) >= 30 - 0.02
    # A thousand electrons of the darkest pixels, and some for the noise without light.
    assert sum(chosen.times) <= 1.6
