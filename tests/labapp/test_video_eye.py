"""What an eye on a video says of an account that is true, and of those that aren't."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from figures.video_eye import Look, Seen, judge

from drivers.screen import Presentations
from drivers.screen.refreshes import Refresh

PERIOD = 1 / 60
FRAMES = 60
START = 1000.0
"""Seconds of time.monotonic() at which refresh 0 was."""


def played(misses=(), count=200, since=3):
    """Looks and the true account of a video some of whose frames came refreshes too late.

    misses: frames that came one refresh late. since: the first refresh that was looked at.
    """
    late = np.cumsum(np.isin(np.arange(count), misses))
    refresh = np.arange(count) + late
    drawn = START + (refresh + 0.15) * PERIOD
    times = START + (refresh + 1.0) * PERIOD
    moments = np.arange(START + since * PERIOD, drawn[-3], 1.5e-3)
    standing = np.searchsorted(drawn, moments) - 1
    looks = [
        Look(moment, moment + 1e-4, int(frame % FRAMES))
        for moment, frame in zip(moments, standing, strict=True)
    ]
    refreshes = [Refresh(n, START + n * PERIOD) for n in range(since, int(refresh[-1]))]
    told = Presentations(np.arange(count) % FRAMES, times, count, len(misses))
    return Seen(looks, refreshes), told


def test_a_true_account_is_found_true():
    seen, told = played()
    verdict = judge(seen, told, FRAMES)
    assert verdict.good
    assert verdict.frames > 190
    assert verdict.period == pytest.approx(PERIOD)
    assert (verdict.missed, verdict.reported, verdict.unseen) == (0, 0, 0)


def test_reported_misses_are_seen():
    verdict = judge(*played([20, 21, 90]), FRAMES)
    assert verdict.good
    assert (verdict.missed, verdict.reported, verdict.unreported) == (3, 3, 0)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_misses_that_are_not_counted_are_unreported(count):
    seen, told = played([20, 21, 90])
    verdict = judge(seen, replace(told, missed=count), FRAMES)
    assert not verdict.good
    assert verdict.unreported == 3 - count


def test_misses_before_the_first_look_make_up_for_none():
    seen, told = played([2, 4, 90], since=10)
    assert judge(seen, told, FRAMES).reported == 1
    assert judge(seen, replace(told, missed=2), FRAMES).unreported == 1


def test_times_that_tell_a_frame_before_it_came_are_untrue():
    seen, told = played([20])
    _, punctual = played()
    verdict = judge(seen, replace(told, times=punctual.times), FRAMES)
    assert not verdict.good
    assert verdict.untrue >= 170


def test_a_frame_out_of_order_is_seen():
    seen, told = played()
    middle = len(seen.looks) // 2
    looks = list(seen.looks)
    looks[middle] = looks[middle]._replace(frame=(looks[middle].frame - 1) % FRAMES)
    assert judge(Seen(looks, seen.refreshes), told, FRAMES).backwards == 1


def test_half_a_frame_is_seen():
    seen, told = played()
    looks = [look._replace(frame=-1) if n == 50 else look for n, look in enumerate(seen.looks)]
    verdict = judge(Seen(looks, seen.refreshes), told, FRAMES)
    assert verdict.torn == 1
    assert not verdict.good


def test_an_eye_that_saw_nothing_finds_nothing_good():
    seen, told = played()
    assert not judge(Seen([], []), told, FRAMES).good
    assert not judge(Seen(seen.looks, []), told, FRAMES).good
    nothing = Presentations(np.zeros(0, int), np.zeros(0), 0, 0)
    assert not judge(seen, nothing, FRAMES).good


def test_a_starved_eye_sees_the_same():
    """Between two looks that are far apart, frames come and go."""
    seen, told = played([20, 21, 90])
    looks = [look for n, look in enumerate(seen.looks) if n % 200 < 100]
    verdict = judge(Seen(looks, seen.refreshes), told, FRAMES)
    assert verdict.good
    assert verdict.unseen > 20
    assert (verdict.missed, verdict.reported) == (3, 3)
