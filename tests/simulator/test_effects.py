import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from virtual_bench import CAMERA

from optics.patterns import axicon
from simulator.effects import Situation, decide, phase_spread

EFFECTS = [
    "filter bandwidth", "illumination", "front reflection", "panel response",
    "neighbour coupling", "flicker", "jitter", "gap light", "flatness", "liquid-crystal response",
    "unmodulated light", "pixel aperture", "dark current", "shot noise", "read noise",
]  # fmt: skip

OF_THE_PANEL = EFFECTS[1:10]
"""Effects whose size depends on what the panel shows."""


def situation(unmodulated=0.05, read_noise=2.4, dark=1.0, bandwidth=7e-9, spread=1e-4, sizes=None):
    camera = replace(
        CAMERA,
        panel=replace(CAMERA.panel, unmodulated=unmodulated),
        sensor=replace(CAMERA.sensor, read_noise=read_noise, dark_current=dark),
    )
    return Situation(camera, 550e-9, bandwidth, spread, sizes or {})


situations = st.builds(
    situation,
    unmodulated=st.floats(0, 1),
    read_noise=st.floats(0, 50),
    dark=st.floats(0, 100),
    bandwidth=st.floats(1e-10, 5e-8),
    spread=st.floats(0, 2e-3),
    sizes=st.dictionaries(st.sampled_from(OF_THE_PANEL), st.floats(0, 10)),
)


@settings(max_examples=100, deadline=None)
@given(situations, st.floats(1e-6, 10), st.floats(1, 1000))
def test_raising_the_tolerance_never_turns_an_effect_on(s, tol, factor):
    strict, loose = decide(s, tol, {}), decide(s, tol * factor, {})
    for a, b in zip(strict.decisions, loose.decisions, strict=True):
        assert a.effect == b.effect
        assert a.on or not b.on
        assert a.nodes >= b.nodes
        assert a.estimate == b.estimate


@settings(max_examples=50, deadline=None)
@given(situations)
def test_an_effect_is_on_where_its_estimate_exceeds_the_tolerance(s):
    for effect, estimate in [(d.effect, d.estimate) for d in decide(s, 1.0, {}).decisions]:
        assert not decide(s, 1.01 * estimate, {}).is_on(effect)
        if estimate > 1e-300:
            below = decide(s, 0.99 * estimate, {})[effect]
            assert below.on
            assert (below.nodes > 1) == (effect == "filter bandwidth")


@settings(max_examples=50, deadline=None)
@given(situations, st.floats(1e-6, 10), st.dictionaries(st.sampled_from(EFFECTS), st.booleans()))
def test_forced_settings_win_and_are_recorded(s, tol, forced):
    free, plan = decide(s, tol, {}), decide(s, tol, forced)
    for effect in EFFECTS:
        if effect in forced:
            assert plan.is_on(effect) == forced[effect]
            assert plan[effect].why.startswith("forced. ")
            assert plan[effect].forced
            assert plan[effect].estimate == free[effect].estimate
            assert plan[effect].nodes == (free[effect].nodes if forced[effect] else 1)
        else:
            assert plan[effect] == free[effect]


def test_every_effect_has_its_estimate_and_reason_in_the_order_of_the_physics():
    plan = decide(situation(), 0.01, {})
    assert [d.effect for d in plan.decisions] == EFFECTS
    for decision in plan.decisions:
        assert decision.measure in ("mean", "noise")
        assert decision.why
        assert math.isfinite(decision.estimate)


def test_an_effect_without_a_cause_is_off():
    plan = decide(situation(unmodulated=0.0, dark=0.0, read_noise=0.0), 1e-9, {})
    for effect in (*OF_THE_PANEL, "unmodulated light", "dark current", "read noise"):
        assert not plan.is_on(effect)
        assert plan[effect].estimate == 0
    assert plan.is_on("shot noise")
    assert plan.is_on("pixel aperture")


def test_the_plan_is_plain_data():
    data = decide(situation(), 0.01, {"shot noise": False}).as_data()
    assert data["tol"] == 0.01
    shot = next(d for d in data["decisions"] if d["effect"] == "shot noise")
    assert shot["on"] is False
    assert shot["why"].startswith("forced")


def test_the_plain_data_is_silent_about_what_nothing_causes():
    """As the table that people read is: unless they have asked for it."""
    told = decide(situation(dark=0.0), 0.01, {"jitter": False}).as_data()["decisions"]
    assert [d["effect"] for d in told] == [
        "filter bandwidth", "jitter", "unmodulated light", "pixel aperture", "shot noise",
        "read noise",
    ]  # fmt: skip
    everything = situation(sizes=dict.fromkeys(OF_THE_PANEL, 1e-9))
    assert [d["effect"] for d in decide(everything, 0.01, {}).as_data()["decisions"]] == EFFECTS


def test_an_unknown_effect_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"effect 'fog' is unknown; choose among filter bandwidth"):
        decide(situation(), 0.01, {"fog": True, "shot noise": True})


@pytest.mark.parametrize("tol", [math.nan, -1e-3, math.inf])
def test_a_tolerance_that_is_none_is_refused(tol):
    with pytest.raises(ValueError, match=r"tol is .*; "):
        decide(situation(), tol, {})


def test_the_spread_of_a_cone_is_three_times_its_radius():
    """A cone of one slope sends all light to one radius; its rms is that radius over sqrt 2
    on each axis, and three times the rms is what the estimate takes."""
    phase = axicon(CAMERA.panel, 200e-6, CAMERA.lens.image_distance, 550e-9)
    spread = phase_spread(CAMERA, phase, 550e-9)
    assert spread == pytest.approx(3 * 200e-6 / math.sqrt(2), rel=0.05)
    assert phase_spread(CAMERA, phase + 2 * math.pi * torch.randint(9, phase.shape), 550e-9) == (
        pytest.approx(spread, rel=1e-6)
    )
    assert phase_spread(CAMERA, torch.zeros(48, 64), 550e-9) == 0
