"""The frames that a plan asks for, counted by hand and by brute force."""

from __future__ import annotations

import itertools
from collections import defaultdict
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plans import abilities, block, plan_of, tunable

from labapp.files.plan_file import AXES
from labapp.runs.steps import block_exposures, planned_shots

WHEEL = abilities()


def taken(*blocks: dict[str, Any], able=WHEEL, **keys: Any):
    return planned_shots(plan_of(*blocks, **keys), able)


def words(listed) -> list[str]:
    """Role, target, pattern, nm, ms and repeat of every frame, in short."""
    return [
        f"{s.role} {s.target} {s.pattern} {s.wavelength * 1e9:g} {s.exposure * 1e3:g} {s.repeat}"
        for s in listed
    ]


def test_targets_change_slowest_and_repeats_fastest():
    listed = taken(
        block(
            targets=["star", "photograph"],
            patterns=["neutral", "lens"],
            wavelengths_nm=[450, 532],
            exposures_ms=[1, 8],
            repeats=2,
        )
    )
    assert len(listed) == 2**5
    assert words(listed)[:9] == [
        "light star neutral 450 1 0",
        "light star neutral 450 1 1",
        "light star neutral 450 8 0",
        "light star neutral 450 8 1",
        "light star neutral 532 1 0",
        "light star neutral 532 1 1",
        "light star neutral 532 8 0",
        "light star neutral 532 8 1",
        "light star lens 450 1 0",
    ]
    assert words(listed)[16] == "light photograph neutral 450 1 0"
    assert [shot.index for shot in listed] == list(range(32))
    assert [shot.step for shot in listed] == [n // 2 for n in range(32)]


def test_an_order_of_ones_own_comes_first_and_the_rest_follows():
    listed = taken(
        block(patterns=["neutral", "lens"], exposures_ms=[1, 8], repeats=2, order=["exposure"])
    )
    assert words(listed) == [
        f"light star {pattern} 532 {ms} {repeat}"
        for ms in (1, 8)
        for pattern in ("neutral", "lens")
        for repeat in (0, 1)
    ]


def test_repeats_can_be_outermost():
    """The same steps once more: repeat 1 of a step comes after repeat 0 of all steps."""
    listed = taken(block(exposures_ms=[1, 8], repeats=3, order=["repeat"]))
    assert [(s.step, s.repeat) for s in listed] == [(n, r) for r in range(3) for n in range(2)]


def test_axes_step_together():
    listed = taken(
        block(
            patterns=["neutral", "lens"],
            wavelengths_nm=[450, 532, 633],
            exposures_ms=[4, 2, 1],
            together=[["wavelength", "exposure"]],
        )
    )
    assert words(listed) == [
        f"light star {pattern} {nm} {ms} 0"
        for pattern in ("neutral", "lens")
        for nm, ms in ((450, 4), (532, 2), (633, 1))
    ]


def test_slots_are_set_by_their_number():
    listed = taken(block(wavelengths_nm=None, slots=[3, 1]))
    assert [(s.slot, s.wavelength) for s in listed] == [(3, 633e-9), (1, 450e-9)]
    assert [s.slot for s in taken(block(wavelengths_nm=[633, 450]))] == [0, 0]


def test_a_target_of_the_plan_is_placed_under_the_benchs_name():
    (shot,) = taken(
        block(targets=["near"]), targets={"near": {"place": "star", "prompt": "Move it."}}
    )
    assert (shot.target, shot.place, shot.prompt) == ("near", "star", "Move it.")


def test_darks_of_every_exposure_come_before_so_many_frames():
    """Every 4 frames: two darks of each of the two exposures, whatever the wavelength."""
    listed = taken(
        block(
            wavelengths_nm=[450, 532, 633],
            exposures_ms=[1, 8],
            interleave=[{"role": "dark", "every": 4, "frames": 2}],
        )
    )
    darks = [f"dark dark neutral {{}} {ms} {n}" for ms in (1, 8) for n in (0, 1)]
    assert words(listed) == [
        *(dark.format(450) for dark in darks),
        "light star neutral 450 1 0",
        "light star neutral 450 8 0",
        "light star neutral 532 1 0",
        "light star neutral 532 8 0",
        *(dark.format(633) for dark in darks),
        "light star neutral 633 1 0",
        "light star neutral 633 8 0",
    ]
    # Darks that come again are other steps: their noise is not the same.
    assert [s.step for s in listed] == [0, 0, 1, 1, 2, 3, 4, 5, 6, 6, 7, 7, 8, 9]


def test_calibration_frames_without_a_period_come_once_at_the_beginning():
    listed = taken(block(exposures_ms=[1, 8, 64], interleave=[{"role": "dark"}]))
    assert [s.role for s in listed] == ["dark"] * 3 + ["light"] * 3


def test_flats_are_of_every_colour_and_neutrals_of_every_target_too():
    listed = taken(
        block(
            targets=["star", "photograph"],
            patterns=["lens"],
            wavelengths_nm=[450, 532],
            interleave=[{"role": "flat", "pattern": "grey"}, {"role": "neutral"}],
        )
    )
    assert words(listed)[:6] == [
        "flat flat grey 450 1 0",
        "flat flat grey 532 1 0",
        "neutral star neutral 450 1 0",
        "neutral star neutral 532 1 0",
        "neutral photograph neutral 450 1 0",
        "neutral photograph neutral 532 1 0",
    ]


def test_slots_of_the_same_wavelength_have_flats_of_their_own():
    listed = taken(block(wavelengths_nm=None, slots=[3, 4], interleave=[{"role": "flat"}]))
    assert [(s.role, s.slot) for s in listed] == [
        ("flat", 3),
        ("flat", 4),
        ("light", 3),
        ("light", 4),
    ]


def test_another_target_can_be_the_dark_one():
    listed = taken(block(interleave=[{"role": "dark", "target": "cap"}]), targets={"cap": {}})
    assert [s.place for s in listed] == ["cap", "star"]


def test_periods_are_those_of_all_videos_of_the_block():
    """Two and three frames of 1/60 s fit together in six, a tenth of a second."""
    plan = plan_of(block(patterns=["two", "three"], exposures_ms=None, periods=[1, 3]))
    assert block_exposures(plan.acquire[0], plan, WHEEL) == [0.1, 0.3]
    alone = plan_of(block(patterns=["two"], exposures_ms=None, periods=[1]))
    # Whole microseconds: 2/60 s is 33333.3 of them.
    assert block_exposures(alone.acquire[0], alone, WHEEL) == [0.033333]


def test_exposures_are_whole_microseconds():
    plan = plan_of(block(exposures_ms=[0.12345, 1 / 3]))
    assert block_exposures(plan.acquire[0], plan, WHEEL) == [0.000123, 0.000333]


@pytest.mark.parametrize("nm", [400, 440, 450, 470, 720, 531.9])
def test_the_ends_of_a_filters_range_are_in_it(nm):
    """Written as 400 nm in a plan and as 400e-9 m by a driver, they differ in the last bit."""
    able = tunable(wavelength_range=(nm * 1e-9, 800e-9))
    (shot,) = taken(block(wavelengths_nm=[nm]), able=able)
    assert shot.wavelength == nm * 1e-9


def test_a_pattern_that_comes_twice_is_taken_twice():
    """The last one shows what has drifted; its noise must be its own."""
    listed = taken(block(patterns=["neutral", "lens", "neutral"], repeats=2))
    assert [(s.pattern, s.step, s.repeat) for s in listed] == [
        ("neutral", 0, 0),
        ("neutral", 0, 1),
        ("lens", 1, 0),
        ("lens", 1, 1),
        ("neutral", 2, 0),
        ("neutral", 2, 1),
    ]


def test_a_block_begins_with_a_step_that_no_other_has():
    """The first block's last frame belongs to its first step: repeats are outermost."""
    first = block(exposures_ms=[1, 8], repeats=2, order=["repeat"], together=[])
    darks = [{"role": "dark", "every": 2}]
    listed = taken(first | {"interleave": darks}, first)
    steps = [shot.step for shot in listed]
    # Two darks and two frames; two other darks and the same frames again; and the second block.
    assert steps == [0, 1, 2, 3, 4, 5, 2, 3, 6, 7, 6, 7]


reads = {
    "regions_px": ([0, 0, 8, 8], [4, 2, 16, 8]),
    "binnings": (1, 2),
    "gains_db": (0.0, 6.0),
}
names = {"targets": ("dark", "star", "photograph"), "patterns": ("neutral", "lens", "grey")}


@st.composite
def blocks(draw) -> dict[str, Any]:
    """Blocks of up to a few dozen frames; values may come twice."""
    few = {"min_size": 1, "max_size": 3}
    made = {key: draw(st.lists(st.sampled_from(known), **few)) for key, known in names.items()}
    made["slots"] = draw(st.lists(st.integers(1, 4), **few))
    for key, known in reads.items():
        made[key] = draw(st.lists(st.sampled_from(known), min_size=1, max_size=2))
    made["exposures_ms"] = draw(st.lists(st.sampled_from([1, 2.5, 8]), **few))
    lengths = {axis: len(v) for axis, v in zip(AXES, made.values(), strict=False)}
    made["repeats"] = lengths["repeat"] = draw(st.integers(1, 3))
    made["average"] = draw(st.integers(1, 3))
    made["order"] = draw(st.permutations(AXES))[: draw(st.integers(0, 8))]
    pairs = [list(p) for p in itertools.permutations(AXES, 2) if lengths[p[0]] == lengths[p[1]]]
    made["together"] = [draw(st.sampled_from(pairs))] if pairs and draw(st.booleans()) else []
    made["interleave"] = draw(
        st.lists(
            st.fixed_dictionaries(
                {"role": st.sampled_from(["dark", "flat", "neutral"]), "frames": st.integers(1, 3)},
                optional={"every": st.integers(1, 9)},
            ),
            max_size=2,
        )
    )
    return made


@given(blocks())
@settings(deadline=None)
def test_light_frames_are_the_product_of_the_axes_in_their_order(made):
    """All tuples of positions, of which those stay that step together, sorted slowest first."""
    values = [
        made["targets"],
        made["patterns"],
        made["slots"],
        [tuple(one) for one in made["regions_px"]],
        made["binnings"],
        made["gains_db"],
        made["exposures_ms"],
        range(made["repeats"]),
    ]
    order = [*made["order"], *(axis for axis in AXES if axis not in made["order"])]
    positions = [
        dict(zip(AXES, tuple_, strict=True))
        for tuple_ in itertools.product(*(range(len(v)) for v in values))
    ]
    for pair in made["together"]:
        positions = [p for p in positions if p[pair[0]] == p[pair[1]]]
    positions.sort(key=lambda p: [p[axis] for axis in order])
    expected = [tuple(v[p[axis]] for axis, v in zip(AXES, values, strict=True)) for p in positions]
    light = [s for s in taken(block(wavelengths_nm=None, **made)) if s.role == "light"]
    assert [
        (
            s.target, s.pattern, s.slot, s.readout.region, s.readout.binning, s.readout.gain_db,
            s.exposure * 1e3, s.repeat,
        )
        for s in light
    ] == expected  # fmt: skip
    assert {s.readout.averaged for s in light} == {made["average"]}


@given(st.lists(blocks(), min_size=1, max_size=3))
@settings(deadline=None)
def test_no_two_frames_of_a_plan_share_step_and_repeat(made):
    listed = taken(*(block(wavelengths_nm=None, **one) for one in made))
    assert [shot.index for shot in listed] == list(range(len(listed)))
    assert len({(shot.step, shot.repeat) for shot in listed}) == len(listed)
    assert {shot.step for shot in listed} == set(range(max(s.step for s in listed) + 1))
    of_step = defaultdict(set)
    for s in listed:
        setting = (s.role, s.target, s.pattern, s.slot, s.wavelength, s.exposure, s.readout)
        of_step[s.step].add(setting)
    assert all(len(settings_) == 1 for settings_ in of_step.values())


@given(st.lists(blocks(), min_size=1, max_size=2))
@settings(deadline=None)
def test_a_frame_begins_when_the_last_is_read_out_and_all_that_changed_stands(made):
    """What changes settles at the same time: the slowest is waited for, not the sum."""
    listed = taken(*(block(wavelengths_nm=None, **one) for one in made))
    end = 0.0
    before: tuple[Any, ...] = (None, None, None)
    for s in listed:
        now = (s.place, s.pattern, s.slot)
        waits = [t for t, a, b in zip((0.5, 0.05, 0.2), before, now, strict=True) if a != b]
        assert s.start_time - end == pytest.approx(max([0.0, *waits]), abs=1e-9)
        end = s.start_time + s.readout.averaged * (s.exposure + 0.008)
        before = now
    assert [s.start_time for s in listed] == sorted(s.start_time for s in listed)
    assert sum(s.duration for s in listed) == pytest.approx(end)


def test_settling_of_all_devices_overlaps():
    able = abilities(target_settling=0.1, slm_settling=0.3, filter_settling=0.2)
    first, second = taken(
        block(patterns=["neutral", "lens"], wavelengths_nm=[450, 532],
              together=[["pattern", "wavelength"]]),
        able=able,
    )  # fmt: skip
    assert first.start_time == pytest.approx(0.3)
    assert second.start_time == pytest.approx(0.3 + 0.001 + 0.008 + 0.3)
    assert second.duration == pytest.approx(0.3 + 0.001 + 0.008)
