"""The light of the virtual world against the camera equation and slow sums."""

import gc
import math
import weakref
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from judges import line_share, quadrature_psf, relative
from small_bench.world import (
    CAMERA,
    GREY_CARD,
    NEUTRAL,
    WIDE_OPEN,
    fresh_light,
    lens_pattern,
    light_of,
    ring_pattern,
    world,
)

import optics.slm
import optics.slm.modulator
import simulator.formation.kernels
import simulator.formation.sample_grid
import simulator.mount
from optics.slm import Modulator, grey_to_phase
from simulator.effects.registry import EFFECTS
from simulator.panel_content import shares_of_time
from simulator.scene import Dark, PhotographPrint, Scene, Star
from simulator.world import TYPICAL_EXPOSURE, countable_exposure

WAVELENGTH = 550e-9

BAND = 7e-9 * 0.5 * math.sqrt(math.pi / math.log(2))
"""The integral over a Gaussian band of 7 nm at half maximum: 6.4 % more than its width."""


def electrons_by_hand(radiance: float, area: float, camera=WIDE_OPEN, band=BAND) -> float:
    """Electrons per second that `area` of sensor collects from a diffuse source, written out."""
    panel = 48 * 40e-6 * 64 * 40e-6
    z = 1 / (1 / 0.125 - 1 / 2.0)
    watts = radiance * band * panel / z**2 * area * 0.6 * 0.6
    return watts * WAVELENGTH / (6.62607015e-34 * 299792458) * 0.62


def window_share(half_y: float, half_x: float, camera=WIDE_OPEN) -> float:
    rows, columns = camera.panel.shape
    return line_share(camera, rows, WAVELENGTH, -half_y, half_y) * line_share(
        camera, columns, WAVELENGTH, -half_x, half_x
    )


def test_a_uniform_card_gives_the_rate_of_the_camera_equation():
    """Half of white, times the share of the light in the orders of the panel's pixels up to the
    second, which are all that are rendered."""
    light = light_of(world(WIDE_OPEN), target="card")
    reach = 2.5 * WAVELENGTH * WIDE_OPEN.lens.image_distance / WIDE_OPEN.panel.pitch
    expected = electrons_by_hand(0.5 * 1e7, (14e-6) ** 2) * window_share(reach, reach)
    assert light.mean() == pytest.approx(expected, rel=0.01)
    assert light.std() <= 1e-3 * light.mean()


def test_a_star_sends_radiance_times_its_solid_angle():
    """L x area of the pinhole x solid angle of the panel, the share within the sensor."""
    light = light_of(world(WIDE_OPEN), target="star")
    z = 1 / (1 / 0.125 - 1 / 2.0)
    image_of_pinhole = math.pi / 4 * (20e-6 * z / 2.0) ** 2
    expected = electrons_by_hand(2e12, image_of_pinhole)
    assert light.sum() == pytest.approx(expected * window_share(20 * 14e-6, 22.5 * 14e-6), rel=0.01)


def test_a_star_has_the_shape_of_the_psf():
    """Quadrature over panel and sensor pixels, for a pattern that spreads the light."""
    grey = ring_pattern(120e-6, WIDE_OPEN)
    scene = Scene({"star": Star(1e-6, 2.0, 1e12)})
    light = light_of(
        world(WIDE_OPEN, scene, forced={"unmodulated light": False, "filter bandwidth": False}),
        grey,
    )
    phase = grey_to_phase(WIDE_OPEN.panel, torch.from_numpy(grey), WAVELENGTH).numpy()
    truth = quadrature_psf(WIDE_OPEN, phase, 2.0, WAVELENGTH, (40, 45))
    assert relative(light / light.sum(), truth / truth.sum()) <= 0.002


def test_coarse_sensor_pixels_do_not_alias_the_psf():
    """Pixels of several fringes: the rendered light must be sampled finer than twice a pixel."""
    camera = replace(WIDE_OPEN, sensor=replace(WIDE_OPEN.sensor, shape=(12, 13), pitch=60e-6))
    grey = ring_pattern(120e-6, camera)
    scene = Scene({"star": Star(1e-6, 2.0, 1e12)})
    off = {"unmodulated light": False, "filter bandwidth": False}
    light = light_of(world(camera, scene, forced=off), grey)
    phase = grey_to_phase(camera.panel, torch.from_numpy(grey), WAVELENGTH).numpy()
    truth = quadrature_psf(camera, phase, 2.0, WAVELENGTH, (12, 13), across_sensor_pixel=16)
    assert relative(light / light.sum(), truth / truth.sum()) <= 0.002


@pytest.mark.parametrize(
    ("change", "least"),
    [
        ({"grey": ring_pattern(100e-6)}, 0.5),
        ({"grey": lens_pattern(3.0)}, 0.02),
        ({"wavelength": 600e-9}, 0.05),
        ({"target": "card"}, 0.5),
        ({"target": "near star"}, 0.02),
    ],
)
def test_every_setting_changes_the_light(change, least):
    w = world(tol=0.05)
    assert relative(light_of(w, **change), light_of(w)) > least


def test_the_description_of_the_camera_changes_the_light():
    light = fresh_light()
    for lens in (replace(CAMERA.lens, f_number=80.0), replace(CAMERA.lens, focus_distance=1.5)):
        assert relative(light_of(world(replace(CAMERA, lens=lens), tol=0.1)), light) > 0.02
    darker = replace(CAMERA, transmission=0.3)
    # Of less light a plan may leave out more.
    assert relative(light_of(world(darker)), light / 2) <= 1e-3


def test_nothing_is_replayed():
    """A, B, A gives the light of A again, bit for bit, and that of a world that never saw B."""
    a, b = ring_pattern(80e-6), ring_pattern(120e-6)
    w = world()
    first, other, again = light_of(w, a), light_of(w, b), light_of(w, a)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert np.array_equal(first, light_of(world(), a))
    assert np.array_equal(other, light_of(world(), b))


def test_targets_seen_one_after_the_other_are_those_of_fresh_worlds():
    w = world(tol=0.05)
    for target in ("card", "star", "near star", "card"):
        assert np.array_equal(light_of(w, target=target), light_of(world(tol=0.05), target=target))


def test_more_states_than_the_caches_hold_stay_apart():
    w = world()
    wavelengths = np.linspace(500e-9, 600e-9, 6)
    once = [light_of(w, wavelength=v) for v in wavelengths]
    for v, light in zip(wavelengths, once, strict=True):
        assert np.array_equal(light_of(w, wavelength=v), light)
    assert len({light.tobytes() for light in once}) == len(once)


def test_the_bandwidth_of_the_filter_changes_the_light():
    w = world()
    narrow = light_of(w)
    w.bandwidth = 14e-9
    assert relative(light_of(w), 2 * narrow) < 0.02


def test_no_light_comes_from_nothing():
    light = fresh_light(target="dark")
    assert light.shape == CAMERA.sensor.shape
    assert not light.any()


def test_light_is_never_negative():
    for target in ("star", "card"):
        assert fresh_light(ring_pattern(100e-6), target=target).min() >= 0


@pytest.mark.parametrize(
    ("bandwidth", "radius"),
    [
        (40e-9, 200e-6),
        *(
            pytest.param(bandwidth, radius, marks=pytest.mark.sweep)
            for bandwidth, radius in (
                (7e-9, 60e-6), (40e-9, 0.0), (7e-9, 0.0), (7e-9, 200e-6), (20e-9, 0.0),
                (20e-9, 60e-6), (20e-9, 200e-6), (40e-9, 60e-6),
            )
        ),
    ],
)  # fmt: skip
def test_the_band_is_sampled_as_finely_as_the_tolerance_asks(bandwidth, radius):
    """41 wavelengths across four standard deviations, each a narrow band of its own."""
    grey = ring_pattern(radius)
    one = world(tol=1e-3, forced={"filter bandwidth": False})
    # Narrow, for a wide band's mean photon is longer than its centre: by 0.5 nm if it has 40 nm.
    one.bandwidth = 0.1e-9
    x = np.linspace(-4, 4, 41)
    weights = np.exp(-(x**2) / 2)
    sigma = bandwidth / (2 * math.sqrt(2 * math.log(2)))
    wavelengths = WAVELENGTH + sigma * x
    # The longest has the widest light, so its plan serves all of them.
    light_of(one, grey, wavelengths[-1])
    recipe = one.imaging.plan(one.situation()).recipe

    def shape(wavelength):
        """Each has all of the band's photons, at its own wavelength: longer waves have more."""
        one.wavelength = wavelength
        electrons = one.imaging.electrons(one.situation(), recipe).numpy().astype(np.float64)
        return electrons / TYPICAL_EXPOSURE * bandwidth / one.bandwidth

    truth = np.tensordot(weights / weights.sum(), [shape(w) for w in wavelengths], 1)
    for tol in (1e-2, 1e-3):
        w = world(tol=tol)
        w.bandwidth = bandwidth
        assert relative(light_of(w, grey), truth) <= tol


class Counted:
    """A callable that counts its calls."""

    def __init__(self, function):
        self.function, self.calls = function, 0

    def __call__(self, *args, **kwargs):
        self.calls += 1
        return self.function(*args, **kwargs)


def test_effects_that_are_off_are_not_computed(monkeypatch):
    aperture = Counted(simulator.formation.sample_grid.pixel_transfer)
    operators = Counted(simulator.formation.kernels.PSFOperator)
    monkeypatch.setattr(simulator.formation.sample_grid, "pixel_transfer", aperture)
    monkeypatch.setattr(simulator.formation.kernels, "PSFOperator", operators)
    off = {"filter bandwidth": "1", "pixel aperture": False, "panel orders": False}
    w = world(forced=off)
    light_of(w, ring_pattern(200e-6))
    assert (aperture.calls, operators.calls) == (0, 1)
    on = world(forced={"filter bandwidth": "3", "pixel aperture": True, "panel orders": False})
    light_of(on, ring_pattern(200e-6))
    assert aperture.calls >= 1
    assert operators.calls == 1 + 3
    assert "pixel aperture" not in w.imaging.ledger.effects_called


def test_what_the_panel_has_not_got_costs_nothing(monkeypatch):
    """No code of the panel's effects is called, neither to render them nor to judge them."""

    def never(*args, **kwargs):
        raise AssertionError("called for nothing")

    for name in (
        "fringing_field_mean",
        "flatness_phase",
        "gap_amplitude",
        "scattered_share",
        "flicker_nodes",
    ):
        monkeypatch.setattr(optics.slm.modulator, name, never)
    monkeypatch.setattr(optics.slm.modulator, "time_nodes", never)
    monkeypatch.setattr(optics.slm.PanelMap, "at_pixels", never)
    monkeypatch.setattr(optics.slm.PhaseResponse, "at", never)
    monkeypatch.setattr(simulator.formation.kernels, "first_start_phase", never)
    there = {"illumination", "front reflection", "panel response", "neighbour coupling",
             "flicker", "jitter", "gap light", "flatness", "liquid-crystal response"}  # fmt: skip
    absent = [effect for effect in EFFECTS if effect.name in there]
    assert len(absent) == len(there)
    for effect in absent:
        for name in ("error_bound", "estimated_error", "added_operations", "add_to_recipe"):
            monkeypatch.setattr(type(effect), name, never)
    monkeypatch.setattr(simulator.mount.Mount, "to_sensor_axes", never)
    w = world()
    light_of(w, ring_pattern(80e-6))
    video_of(w, STILLS, 2 * FRAME)


def test_the_same_state_is_computed_once():
    w = world()
    light_of(w)
    once = w.imaging.ledger.operations
    for exposure in (0.01, 0.01, 0.011):
        light_of(w, exposure=exposure)
    assert w.imaging.ledger.operations == once
    light_of(w, ring_pattern(90e-6))
    assert w.imaging.ledger.operations > once


def test_each_effect_moves_the_light_when_it_is_forced():
    grey = ring_pattern(200e-6)
    w = world(
        forced=dict.fromkeys(("filter bandwidth", "pixel aperture", "unmodulated light"), True)
    )
    w.bandwidth = 30e-9
    full = light_of(w, grey)
    for effect in ("filter bandwidth", "pixel aperture", "unmodulated light"):
        without = world(forced={**w.imaging.forced, effect: False})
        without.bandwidth = 30e-9
        assert relative(light_of(without, grey), full) > 0.005


@pytest.mark.parametrize("tol", [math.nan, -1.0, math.inf])
def test_a_tolerance_that_is_none_is_refused(tol):
    with pytest.raises(ValueError, match=r"tol is .*; "):
        light_of(world(tol=tol))


def test_an_unknown_effect_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"effect 'fog' is unknown; choose among .*shot noise"):
        light_of(world(forced={"fog": True}))


@pytest.mark.parametrize(("effect", "level"), [("shot noise", "some"), ("filter bandwidth", "4")])
def test_an_unknown_level_is_refused_with_the_known_ones(effect, level):
    with pytest.raises(
        ValueError, match=rf"effect '{effect}' has no level '{level}'; choose among"
    ):
        world(forced={effect: level})


def test_an_effect_that_needs_one_that_is_forced_off_is_refused():
    words = "'panel orders' is forced on, and requires 'diffraction', which is forced off"
    with pytest.raises(ValueError, match=words):
        world(forced={"panel orders": True, "diffraction": False})


@pytest.mark.parametrize("exposure", [0.0, -0.01, math.inf, math.nan])
def test_an_exposure_that_is_none_is_refused(exposure):
    with pytest.raises(ValueError, match=r"exposure is .* s; it must be positive and finite"):
        world().electron_rates(exposure)


def test_a_wavelength_that_the_panel_does_not_know_is_refused():
    with pytest.raises(ValueError, match=r"wavelength 900 nm is outside the panel's table"):
        fresh_light(wavelength=900e-9)


@pytest.mark.parametrize("distance", [pytest.param(0.8, marks=pytest.mark.sweep), 1.2, 50.0])
def test_a_star_out_of_focus_is_as_large_as_geometric_optics_says(distance):
    """A blur of side x |1/d - 1/focus| x image distance along each side of the panel.

    With several waves of defocus the edge of the blur is a knife edge's: a quarter of the
    plateau's light (Fresnel).
    """
    scene = Scene({"star": Star(1e-6, distance, 1e12), "dark": Dark()})
    panel = replace(CAMERA.panel, pitch=160e-6, fill_factor=1.0)
    sensor = replace(CAMERA.sensor, shape=(120, 120))
    camera = replace(WIDE_OPEN, panel=panel, sensor=sensor)
    light = light_of(world(camera, scene, forced={"unmodulated light": False}))
    vergence = abs(1 / distance - 1 / camera.lens.focus_distance)
    for axis, count in enumerate(camera.panel.shape):
        profile = light.sum(1 - axis)
        lit = profile > 0.25 * np.median(profile[profile > 0.3 * profile.max()])
        side = count * camera.panel.pitch * vergence * camera.lens.image_distance
        assert lit.sum() == pytest.approx(side / camera.sensor.pitch, abs=1.5)


def test_defocus_loses_no_light():
    """A large grey card is as bright far out of focus as in focus."""
    cards = {
        name: PhotographPrint(GREY_CARD, distance, 1e7, cover=30.0)
        for name, distance in (("sharp", 2.0), ("blurred", 0.8))
    }
    bench = world(scene=Scene(cards))
    sharp, blurred = (light_of(bench, target=name)[15:25, 15:30] for name in cards)
    assert blurred.mean() == pytest.approx(sharp.mean(), rel=0.02)


def test_a_star_blurred_over_far_more_than_the_frame_is_even():
    """The panel's shadow is 475 x 357 pixels; its light, less what the panel's pixels send into
    orders whose shadows, 131 pixels apart, don't meet the frame: beyond the first."""
    distance, z = 0.05, CAMERA.lens.image_distance
    light = light_of(world(scene=Scene({"star": Star(1e-4, distance, 1e11)})))
    shadow = (1 / distance - 1 / CAMERA.lens.focus_distance) * z
    area = 48 * 40e-6 * 64 * 40e-6 * shadow**2
    image = math.pi / 4 * (1e-4 * z / distance) ** 2
    side = math.sqrt(CAMERA.panel.fill_factor)
    met = (side**2 * (1 + 2 * np.sinc(side) ** 2)) ** 2 / side**2
    expected = electrons_by_hand(1e11, image) * (14e-6) ** 2 / area * met
    assert light.mean() == pytest.approx(expected, rel=0.01)
    assert light.std() <= 0.02 * light.mean()


# Videos.

FRAME = 1 / 60
"""Seconds that each frame of a video stands."""

STILLS = (NEUTRAL, ring_pattern(60e-6), lens_pattern(3.0))


def video_of(w, frames, exposure, moment=0.0, target="star"):
    """The light of a video during an exposure that begins at a moment of the plan."""
    w.wavelength, w.target = WAVELENGTH, target
    w.begin_frame(1, 2, 3, start_time=moment)
    w.play(np.stack(frames), FRAME)
    return w.electron_rates(exposure)[0].numpy().astype(np.float64)


def one_coloured():
    """Nothing of a video's time depends on the band, and a wavelength is soon rendered."""
    return world(forced={"filter bandwidth": "1"})


@cache
def lights_of_stills():
    """Each from a world of its own."""
    return [light_of(one_coloured(), grey) for grey in STILLS]


def mean_of(weights):
    """The weighted mean of the lights of stills in one colour."""
    return np.tensordot(np.asarray(weights) / np.sum(weights), lights_of_stills(), 1)


@pytest.mark.parametrize("exposure", [1e-4, 0.7 * FRAME, 3 * FRAME, 10.0])
def test_a_video_of_equal_frames_is_a_still(exposure):
    w, grey = world(), ring_pattern(80e-6)
    still = fresh_light(grey, exposure=exposure)
    assert np.array_equal(video_of(w, [grey] * 3, exposure, moment=0.01), still)


@pytest.mark.parametrize("target", ["star", "card"])
@pytest.mark.parametrize("periods", [1, pytest.param(2, marks=pytest.mark.sweep), 7])
def test_a_video_over_whole_periods_is_the_mean_of_its_frames(periods, target):
    seen = video_of(world(), STILLS, periods * 3 * FRAME, moment=0.4 * FRAME, target=target)
    lights = [fresh_light(grey, target=target) for grey in STILLS]
    # A video's plan may be finer than a still's, by what the tolerance leaves out.
    assert relative(seen, np.mean(lights, axis=0)) <= 1e-3
    if target == "star":
        assert min(relative(light, seen) for light in lights) > 0.05


def test_a_frame_that_comes_twice_counts_twice():
    seen = video_of(one_coloured(), [STILLS[0], STILLS[1], STILLS[0]], 3 * FRAME)
    assert relative(seen, mean_of([2, 1, 0])) <= 1e-3


@pytest.mark.parametrize(
    ("start", "length", "weights"),
    [
        (0.0, 1.0, [1, 0, 0]),
        (1.0, 1.0, [0, 1, 0]),
        (0.5, 1.0, [0.5, 0.5, 0]),
        (2.5, 1.0, [0.5, 0, 0.5]),
        (0.25, 2.0, [0.75, 1, 0.25]),
        (1.0, 4.0, [1, 2, 1]),
        (31.5, 3.5, [1, 1.5, 1]),
    ],
)
def test_a_cut_period_weighs_frames_by_the_time_that_they_are_seen(start, length, weights):
    """In units of a frame: what is on the panel from `start` on, counted by hand."""
    seen = video_of(one_coloured(), STILLS, length * FRAME, moment=start * FRAME)
    assert relative(seen, mean_of(weights)) <= 1e-3


@pytest.mark.parametrize("n", [1, 2, 3, 7])
@pytest.mark.parametrize("length", [1e-3, 0.3, 1.0, 2.9, 7.0, 100.37])
def test_shares_of_time_are_those_of_a_slow_sum(n, length, rng):
    """A hundred thousand moments of the interval, and the frame that each falls in."""
    for start in (0.0, 0.5, n - 0.1, *rng.uniform(0, 1000, 4)):
        moments = start + (np.arange(100_000) + 0.5) / 100_000 * length
        counted = np.bincount(np.floor(moments % n).astype(int), minlength=n) / 100_000
        shares = shares_of_time(n, start, length)
        assert np.abs(np.asarray(shares) - counted).max() <= 1e-4 * max(1, 1 / n)
        assert sum(shares) == pytest.approx(1, abs=1e-12)


def test_the_order_of_frames_is_irrelevant_over_whole_periods():
    w = world()
    one = video_of(w, STILLS, 3 * FRAME)
    once = w.imaging.ledger.operations
    other = video_of(w, STILLS[::-1], 3 * FRAME)
    assert np.array_equal(one, other)
    assert w.imaging.ledger.operations == once
    # Exact but for the rounding of a mean over twice the time.
    assert relative(video_of(w, STILLS, 6 * FRAME), one) <= 1e-6
    assert w.imaging.ledger.operations == once


def test_the_order_of_frames_counts_within_a_period():
    one, other = (video_of(world(), frames, 1.5 * FRAME) for frames in (STILLS, STILLS[::-1]))
    assert relative(one, other) > 0.05


def test_an_exposure_in_whole_microseconds_counts_as_whole_periods():
    """A camera can't be set to 1/60 s; the light must not depend on when it begins."""
    w = world()
    exposure = round(2 * FRAME * 1e6) * 1e-6
    assert exposure != 2 * FRAME
    frames = STILLS[:2]
    first = video_of(w, frames, exposure)
    once = w.imaging.ledger.operations
    for moment in (0.3 * FRAME, 1.7 * FRAME):
        assert np.array_equal(video_of(w, frames, exposure, moment), first)
    assert w.imaging.ledger.operations == once
    # A hundredth of a frame more is seen.
    video_of(w, frames, 2.01 * FRAME)
    assert w.imaging.ledger.operations > once


def test_a_short_look_at_a_long_video_sees_one_frame():
    """Nearly no period at all is not a whole number of periods."""
    frames = [STILLS[1], *[NEUTRAL] * 3999]
    # A video may be planned with more wavelengths than a still.
    alike = {"filter bandwidth": "3"}
    seen = video_of(world(forced=alike), frames, 20e-6)
    assert 20e-6 / (4000 * FRAME) < 1e-6
    assert relative(seen, light_of(world(forced=alike), STILLS[1])) <= 1e-4


def test_frames_that_are_not_seen_are_not_computed(monkeypatch):
    """A plan looks at all of them; what is rendered is what is seen."""
    fields = Counted(Modulator.iterate_still_fields)
    monkeypatch.setattr(Modulator, "iterate_still_fields", lambda *a, **k: fields(*a, **k))
    w = world(forced={"filter bandwidth": "1", "panel orders": False})
    video_of(w, STILLS, FRAME)
    assert fields.calls == 1


def test_a_video_that_was_seen_does_not_linger():
    w = world()
    still = light_of(w, STILLS[1])
    video_of(w, STILLS, 3 * FRAME)
    assert np.array_equal(light_of(w, STILLS[1]), still)
    assert np.array_equal(video_of(w, STILLS, 3 * FRAME), video_of(world(), STILLS, 3 * FRAME))


@pytest.mark.parametrize(
    ("shown", "exposure"),
    [(STILLS[1], 0.01), (np.stack(STILLS), 3 * FRAME)],
    ids=["still", "video"],
)
def test_what_was_planned_is_found_again_whenever_it_is_shown(shown, exposure):
    w = world()
    w.camera = replace(w.camera, panel=replace(w.camera.panel, frame_rate=1 / FRAME))
    planned = w.effect_plan(shown, WAVELENGTH, exposure, "star")
    w.wavelength, w.target = WAVELENGTH, "star"
    for moment in (0.0, 0.3 * FRAME):
        w.play(shown.reshape(-1, *shown.shape[-2:]), FRAME)
        w.begin_frame(1, 2, 3, start_time=moment)
        assert w.electron_rates(exposure)[1] is planned
    assert w.imaging.plan_count == 1


def test_a_plan_is_for_the_exposure_that_a_camera_takes():
    w = world()
    w.wavelength, w.target, w.grey = WAVELENGTH, "star", STILLS[1]
    planned = w.effect_plan(STILLS[1], WAVELENGTH, 1 / 300, "star")
    assert w.electron_rates(0.003333)[1] is planned
    assert countable_exposure(1e-7) == 1e-7


def test_the_start_of_an_exposure_counts_where_it_sees_part_of_a_video():
    w = world()
    pictures = [video_of(w, STILLS, 0.5 * FRAME, start) for start in (0.0, FRAME)]
    assert not np.array_equal(*pictures)


def test_a_video_calls_for_what_its_widest_frame_calls_for():
    """The plan is the same whichever way round it is shown, and whichever part is seen."""
    w = world()
    w.bandwidth = 20e-9
    wide = ring_pattern(200e-6)
    still, ring = (w.effect_plan(grey, WAVELENGTH, target="star") for grey in (NEUTRAL, wide))
    assert still.levels != ring.levels
    for video in (np.stack([NEUTRAL, wide]), np.stack([wide, NEUTRAL])):
        plan = w.effect_plan(video, WAVELENGTH, target="star")
        assert plan.level("filter bandwidth") >= ring.level("filter bandwidth")
        w.wavelength, w.target = WAVELENGTH, "star"
        w.play(video, FRAME)
        for moment in (0.0, 0.5 * FRAME, FRAME):
            w.begin_frame(1, 2, 3, start_time=moment)
            assert w.electron_rates()[1].levels == plan.levels
    assert w.effect_plan(NEUTRAL[None], WAVELENGTH, target="star").levels == still.levels


def test_light_belongs_to_the_settings_with_which_it_was_begun():
    """A device may be set while a camera that was given up still computes."""
    w = world()
    w.wavelength, w.target = WAVELENGTH, "star"

    def meddle():
        w.wavelength, w.bandwidth, w.target = 600e-9, 20e-9, "card"
        w.grey = ring_pattern(100e-6)

    seen = w.electron_rates(0.01, meddle)[0].numpy()
    assert np.array_equal(seen, fresh_light())
    # And what it leaves behind is neither.
    w.bandwidth = 7e-9
    assert np.array_equal(light_of(w, wavelength=600e-9), fresh_light(wavelength=600e-9))
    assert np.array_equal(light_of(w), fresh_light())


def test_a_check_may_end_a_computation_and_nothing_is_left():
    class Enough(Exception):
        pass

    calls = []

    def check():
        calls.append(1)
        if len(calls) == 2:
            raise Enough

    w = world()
    w.wavelength, w.target = WAVELENGTH, "star"
    with pytest.raises(Enough):
        w.electron_rates(0.01, check)
    assert np.array_equal(light_of(w), fresh_light())


# Chance.


def draws(w, count=2):
    return [torch.rand(4, generator=w.random_generator()).tolist() for _ in range(count)]


def test_the_same_frame_of_the_same_run_has_the_same_chance():
    w, other = world(), world()
    w.begin_frame(1, 2, 3)
    other.begin_frame(9, 9, 9)
    draws(other)
    other.begin_frame(1, 2, 3, index=17, start_time=3.5)
    assert draws(w) == draws(other)


@pytest.mark.parametrize(
    "frame", [(2, 2, 3), (1, 3, 3), (1, 2, 4), (3, 2, 1), (2, 1, 3), (2**40, 2, 3), (1, 2, 0)]
)
def test_every_part_of_what_a_frame_is_counts_for_its_chance(frame):
    w, other = world(), world()
    w.begin_frame(1, 2, 3)
    other.begin_frame(*frame)
    mine, others = draws(w, 3), draws(other, 3)
    assert not any(draw in others for draw in mine)


def test_each_picture_of_a_frame_has_its_own_chance():
    """As when it is taken again; and that, too, can be repeated."""
    w = world()
    w.begin_frame(1, 2, 3)
    first = draws(w, 5)
    assert len({tuple(draw) for draw in first}) == 5
    w.begin_frame(1, 2, 3)
    assert draws(w, 5) == first


def test_many_frames_have_different_chances():
    w, seen = world(), set()
    for run in range(6):
        for step in range(6):
            for frame in range(6):
                w.begin_frame(run, step, frame)
                seen.update(tuple(draw) for draw in draws(w))
    assert len(seen) == 2 * 6**3


def test_a_world_that_forgets_keeps_no_light_and_computes_the_same_again():
    w = world(WIDE_OPEN)
    light = w.electron_rates()[0]
    kept, seen, once = weakref.ref(light), light.clone(), w.imaging.ledger.operations
    del light
    w.forget()
    gc.collect()
    assert kept() is None
    assert torch.equal(w.electron_rates()[0], seen)
    assert w.imaging.ledger.operations == 2 * once


def test_what_one_tolerance_has_found_out_another_need_not():
    w, other = world(WIDE_OPEN), world(WIDE_OPEN)
    trial = w.imaging.with_tolerance(0.1)
    one, two = w.situation(), w.situation()
    first, second = trial.plan(one), w.imaging.plan(two)
    assert one.pattern_probe is two.pattern_probe
    assert (first.tol, second.tol) == (0.1, w.imaging.tol)
    assert second.levels == other.imaging.plan(other.situation()).levels
    with pytest.raises(ValueError, match="tol is -1"):
        w.imaging.with_tolerance(-1.0)


def test_patterns_that_were_shown_leave_nothing_behind():
    """Plans of many patterns are kept, but what was known of each isn't: that's far more."""
    one, refs = world(), []
    for level in range(8):
        one.grey = np.full_like(NEUTRAL, level)
        s = one.situation()
        one.imaging.plan(s)
        refs.append((weakref.ref(s), weakref.ref(s.pattern_probe)))
        del s
    gc.collect()
    assert not any(s() for s, _ in refs)
    # Those of the last three may be asked for again.
    assert sum(pattern() is not None for _, pattern in refs) <= 3
