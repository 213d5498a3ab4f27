import math
import threading
import time
from collections import Counter
from functools import partial

import pytest
from wall import Wall

from simulator.clock import VirtualClock

PATIENCE = 60
"""Seconds after which a test that should have ended long ago is given up."""


def never():
    return False


def waiting(clock, until, cancelled=never):
    thread = threading.Thread(target=clock.wait_until, args=(until, cancelled), daemon=True)
    thread.start()
    return thread


def test_a_clock_begins_at_zero_and_waiting_takes_no_time():
    clock = VirtualClock()
    assert clock.now() == 0
    for until in (1e-9, 3.5, 1e9):
        clock.wait_until(until, never)
        assert clock.now() == until


@pytest.mark.parametrize("speed", [math.inf, 1.0])
def test_a_clock_never_goes_back(speed):
    clock = VirtualClock(speed)
    clock.wait_until(0.002, never)
    for past in (0.002, 0.001, 0.0, -5.0, math.nan):
        clock.wait_until(past, never)
        assert clock.now() == 0.002


@pytest.mark.parametrize("speed", [0.5, 1.0, 20.0])
def test_a_finite_speed_takes_its_time(monkeypatch, speed):
    clock, wall = VirtualClock(speed), Wall()
    monkeypatch.setattr("simulator.clock.time", wall)
    for lap in (1, 2):
        clock.wait_until(lap * 0.05 * speed, never)
        assert wall.now - 1000.0 == pytest.approx(lap * 0.05, abs=1e-4)
        assert clock.now() == lap * 0.05 * speed


def test_time_moves_only_while_somebody_waits():
    clock = VirtualClock(1000.0)
    clock.wait_until(1.0, never)
    time.sleep(0.02)
    assert clock.now() == 1.0


@pytest.mark.parametrize("speed", [math.inf, 1.0])
def test_who_has_cancelled_already_does_not_wait(speed):
    clock = VirtualClock(speed)
    clock.wait_until(3600.0, lambda: True)
    assert clock.now() == 0


def test_cancelling_ends_a_wait_early():
    """The wait would last an hour; the thread has ended although nobody waited that long."""
    clock, stop = VirtualClock(1.0), threading.Event()
    thread = waiting(clock, 3600.0, stop.is_set)
    while clock.now() == 0:
        time.sleep(0.001)
    stop.set()
    thread.join(PATIENCE)
    assert not thread.is_alive()
    assert 0 < clock.now() < 3600


class StandingWall(Wall):
    """One that nobody moves by sleeping."""

    def sleep(self, seconds):
        time.sleep(0.001)


def test_two_who_wait_at_once_wait_through_the_same_time(monkeypatch):
    """The clock would be twice as fast if each moved it by what it has waited."""
    clock, wall, stop, looks = VirtualClock(100.0), StandingWall(), threading.Event(), Counter()
    monkeypatch.setattr("simulator.clock.time", wall)

    def looking(who):
        looks[who] += 1
        return stop.is_set()

    threads = [waiting(clock, 1e6, partial(looking, who)) for who in "ab"]
    for passed in (0.0, 0.1, 0.2, 0.3):
        wall.now = 1000.0 + passed
        before = dict(looks)
        while any(looks[who] < before.get(who, 0) + 3 for who in "ab"):
            time.sleep(0.001)
        assert clock.now() == pytest.approx(100 * passed)
    assert all(thread.is_alive() for thread in threads)
    stop.set()
    for thread in threads:
        thread.join(PATIENCE)
        assert not thread.is_alive()


def test_who_begins_to_wait_later_joins_in():
    speed = 20.0
    clock = VirtualClock(speed)
    long = waiting(clock, 4.0)
    while clock.now() < 1.0:
        time.sleep(0.001)
    clock.wait_until(3.0, never)
    assert clock.now() >= 3.0
    long.join(PATIENCE)
    assert clock.now() == 4.0


def test_two_may_wait_at_infinite_speed():
    clock = VirtualClock()
    threads = [waiting(clock, until) for until in (5.0, 3.0, 4.0)]
    for thread in threads:
        thread.join(PATIENCE)
    assert clock.now() == 5.0


@pytest.mark.parametrize("speed", [0.0, -1.0, -math.inf, math.nan])
def test_a_speed_that_is_none_is_refused(speed):
    with pytest.raises(ValueError, match=r"speed is (0|-1|-inf|nan); it must be positive\. 1 is"):
        VirtualClock(speed)
