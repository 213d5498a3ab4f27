"""What a video's liquid crystal does to the light, against small steps in time."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import positions, relative
from small_bench.world import (
    CAMERA,
    NEUTRAL,
    fresh_light,
    lens_pattern,
    light_of,
    ring_pattern,
    world,
)
from sweeps import some

import optics.slm.modulator
import simulator.formation.kernels
from optics.psf import PSFOperator, modulated_psf
from optics.slm import Modulator, grey_to_phase
from simulator.formation.kernels import exposure_fields
from simulator.panel_content import PanelContent, shares_of_time, spans_of_time

WAVELENGTH = 550e-9
FRAME = 1 / 60
STILLS = (NEUTRAL, ring_pattern(60e-6), lens_pattern(3.0))


def slow(tau: float, **changes):
    return replace(CAMERA, panel=replace(CAMERA.panel, response_time=tau, **changes))


def far_field(field):
    """The light of a panel's field, summed over its pixels, on 20 x 20 points."""
    at, panel = positions(20, 30e-6), CAMERA.panel
    scale = WAVELENGTH * CAMERA.lens.image_distance
    down, along = (
        np.exp(-2j * np.pi / scale * np.outer(at, positions(n, panel.pitch))) for n in panel.shape
    )
    return np.abs(down @ np.asarray(field) @ along.T) ** 2


def stepped(video, tau: float, start: float, length: float, steps: int = 200, flicker: float = 0):
    """The mean light over an interval, in units of a frame, of a video that began long ago.

    The phase is moved by the exact solution of its equation over each small step.
    """
    phases = [grey_to_phase(CAMERA.panel, grey, WAVELENGTH) for grey in video]
    n, dt = len(video), 1 / steps
    left = math.exp(-dt * FRAME / tau) if tau else 0.0
    # To the beginning of the interval, from ten periods or fifty time constants before.
    rounds = math.ceil(50 * tau / (n * FRAME)) + 1
    first, last = round(start * steps), round((start + length) * steps)
    phase, total = phases[0], 0.0
    for step in range(first - rounds * n * steps, last):
        end = phases[step // steps % n]
        if step >= first:
            middle = end + (phase - end) * math.sqrt(left)
            ripples = [0.0] if not flicker else flicker * np.sin(2 * np.pi * np.arange(30) / 30)
            total = total + sum(far_field(np.exp(1j * middle * (1 + r))) for r in ripples) / len(
                ripples
            )
        phase = end + (phase - end) * left
    return total / (last - first)


def rendered(video, camera, start: float, length: float, tol=1e-4):
    shown = PanelContent.of(np.stack(video), FRAME)
    seen = shown.frame_sequence(start * FRAME, length * FRAME)
    parts = list(exposure_fields(Modulator(camera.panel, WAVELENGTH), seen, shown.pictures, tol))
    assert sum(share for share, _ in parts) == pytest.approx(1, abs=1e-9)
    return sum(share * far_field(field) for share, field in parts)


SPANS = ((0.0, 3.0), (0.0, 6.0), (0.0, 1.0), (1.25, 0.5), (2.5, 1.0), (0.75, 3.5))


@pytest.mark.parametrize(
    ("tau", "span"),
    some(itertools.product([2e-3, 5e-3, 40e-3], SPANS), 1, 2, 4, 5, 12, 15),
)
def test_a_video_is_seen_on_its_way(tau, span):
    """Whole periods, single frames, and parts of frames that begin anywhere."""
    start, length = span
    truth = stepped(STILLS, tau, start, length)
    assert relative(rendered(STILLS, slow(tau), start, length), truth) <= 5e-4
    standing = stepped(STILLS, 0.0, start, length, steps=4)
    assert relative(standing, truth) > 5e-3


def test_a_flickering_video_ripples_on_its_way():
    truth = stepped(STILLS[:2], 5e-3, 0.0, 2.0, steps=60, flicker=0.15)
    camera = slow(5e-3, flicker=0.15)
    assert relative(rendered(STILLS[:2], camera, 0.0, 2.0), truth) <= 1e-3
    assert relative(rendered(STILLS[:2], slow(5e-3), 0.0, 2.0), truth) > 3e-3


def test_whole_periods_are_those_of_the_modulators_own_cycle():
    camera = slow(8e-3, coupling=4e-6)
    modulator = Modulator(camera.panel, WAVELENGTH)
    phases = torch.stack([modulator.phase(torch.from_numpy(grey)) for grey in STILLS])
    cycle = list(modulator.video_cycle_fields(phases, FRAME, tol=1e-5))
    expected = sum(share * far_field(field) for _, share, field in cycle)
    assert relative(rendered(STILLS, camera, 0.0, 3.0, tol=1e-5), expected) <= 1e-5


def test_a_flickering_still_is_the_mean_over_its_ripple():
    panel = replace(CAMERA.panel, flicker=0.08)
    shown = PanelContent.of(STILLS[1][None], math.inf)
    parts = exposure_fields(
        Modulator(panel, WAVELENGTH), shown.picture_shares(0.0, 0.1), shown.pictures, tol=1e-4
    )
    phase = grey_to_phase(panel, STILLS[1], WAVELENGTH)
    ripples = 0.08 * np.sin(2 * np.pi * np.arange(500) / 500)
    truth = np.mean([far_field(np.exp(1j * phase * (1 + r))) for r in ripples], axis=0)
    assert relative(sum(share * far_field(field) for share, field in parts), truth) <= 1e-4


@pytest.mark.parametrize("n", [1, 2, 3, 7])
@pytest.mark.parametrize("length", [1e-3, 0.3, 1.0, 2.9, 7.0, 100.37])
def test_spans_of_time_are_where_an_interval_falls(n, length, rng):
    """Moments of the interval, and the frame and the part of it that each falls in."""
    for start in (0.0, 0.5, n - 0.1, 2.0, *rng.uniform(0, 1000, 4)):
        spans = spans_of_time(n, start, length)
        moments = start + (np.arange(20_000) + 0.5) / 20_000 * length
        frame, place = np.floor(moments % n).astype(int), moments % 1
        for k in range(n):
            seen = np.histogram(place[frame == k], 10, (0, 1))[0] / 20_000
            told = np.zeros(10)
            for at, a, b, share in spans:
                overlap = np.clip(
                    np.minimum(b, np.arange(1, 11) / 10) - np.maximum(a, np.arange(10) / 10), 0, 1
                )
                told += (at == k) * share * overlap / (b - a)
            assert np.abs(seen - told).max() <= 2e-4
        assert sum(share for *_, share in spans) == pytest.approx(1, abs=1e-12)
        by_frame = [sum(share for at, _, _, share in spans if at == k) for k in range(n)]
        assert np.allclose(by_frame, shares_of_time(n, start, length), atol=1e-12)


# In the world.


def slow_world(tau: float, **forced):
    """Of one colour: nothing of a crystal's way is told by the band."""
    return world(slow(tau), forced={"filter bandwidth": "1"} | forced)


def video_of(w, frames, exposure, moment=0.0):
    w.wavelength, w.target = WAVELENGTH, "star"
    w.begin_frame(1, 2, 3, start_time=moment)
    w.play(np.stack(frames), FRAME)
    return w.electron_rates(exposure)[0].numpy().astype(np.float64)


def test_the_order_of_frames_counts_where_the_crystal_is_slow():
    frames = [*STILLS, ring_pattern(120e-6)]
    other = [frames[0], frames[2], frames[1], frames[3]]
    for tau, differ in ((0.0, False), (5e-3, True)):
        lights = [video_of(slow_world(tau), f, 4 * FRAME) for f in (frames, other)]
        assert (relative(*lights) > 1e-3) == differ


def test_whole_periods_are_alike_whenever_they_begin():
    w = slow_world(5e-3)
    first = video_of(w, STILLS, 6 * FRAME)
    assert np.array_equal(video_of(w, STILLS, 3 * FRAME, moment=0.4 * FRAME), first)
    assert np.array_equal(video_of(slow_world(5e-3), STILLS, 3 * FRAME), first)


def test_a_cut_period_is_seen_as_far_as_it_lasts():
    """Long exposures see whole periods and a part: weighed by what each of them lasts."""
    w = slow_world(5e-3, **{"liquid-crystal response": True})
    whole = video_of(w, STILLS, 3 * FRAME)
    part = video_of(w, STILLS, 0.7 * FRAME, moment=1.5 * FRAME)
    both = video_of(w, STILLS, 3.7 * FRAME, moment=1.5 * FRAME)
    assert relative(both, (3 * whole + 0.7 * part) / 3.7) <= 1e-3
    assert relative(part, whole) > 0.05


def test_a_still_stands_however_slow_the_crystal_is():
    w = world(slow(0.1))
    assert np.array_equal(light_of(w, STILLS[1]), fresh_light(STILLS[1]))
    equal = video_of(w, [STILLS[1]] * 3, 0.7 * FRAME)
    assert np.array_equal(equal, fresh_light(STILLS[1], exposure=0.7 * FRAME))


def test_a_crystal_that_is_at_once_is_not_followed(monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("called for nothing")

    for name in ("first_start_phase", "relaxed_phase"):
        monkeypatch.setattr(simulator.formation.kernels, name, never)
        monkeypatch.setattr(optics.slm.modulator, name, never)
    for name in ("time_nodes", "time_node_count", "flicker_nodes"):
        monkeypatch.setattr(optics.slm.modulator, name, never)
    video_of(world(), STILLS, 3 * FRAME)
    video_of(world(slow(5e-3), forced={"liquid-crystal response": False}), STILLS, FRAME)


def test_a_moving_video_may_be_given_up_between_its_moments():
    class Enough(Exception):
        pass

    calls = []

    def check():
        calls.append(1)
        if len(calls) == 5:
            raise Enough

    w = slow_world(5e-3)
    w.wavelength, w.target = WAVELENGTH, "star"
    w.play(np.stack(STILLS), FRAME)
    with pytest.raises(Enough):
        w.electron_rates(3 * FRAME, check)
    assert np.array_equal(
        w.electron_rates(3 * FRAME)[0].numpy(), video_of(slow_world(5e-3), STILLS, 3 * FRAME)
    )


def test_a_psf_of_a_moving_video_adds_up():
    """All light that leaves the panel arrives, whatever the phase was in between."""
    camera = slow(5e-3, unmodulated=0.0)
    modulator = Modulator(camera.panel, WAVELENGTH)
    shown = PanelContent.of(np.stack(STILLS), FRAME)
    plane = CAMERA.sensor.window_plane((256, 256))
    operator = PSFOperator(camera, 2.0, WAVELENGTH, plane, integrate=False, tol=1e-4)
    moving, standing = (
        modulated_psf(operator, modulator, exposure_fields(modulator, seen, shown.pictures, 1e-3))
        for seen in (shown.frame_sequence(0.0, 0.0), shown.picture_shares(0.0, 0.0))
    )
    assert float(moving.sum()) == pytest.approx(float(standing.sum()), rel=0.02)
