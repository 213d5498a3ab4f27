"""Bounds of the effects of optics against what they change, by chance; floors against pictures."""

import math
from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from optical_situations import (
    CAMERA,
    EFFECTS,
    PANEL,
    STAR,
    finest,
    pattern,
    random_situation,
    recipe,
    rendered,
    situation,
)

from optics.caching import ByteCache
from optics.camera import Camera, Lens, Panel, Sensor
from optics.light import Band, Waveform
from optics.polarisation import PathEffect
from optics.psf import PSFOperator
from simulator.effects.band_effects import Bandwidth
from simulator.effects.field_effects import FieldPosition
from simulator.effects.glare import LensGhosts
from simulator.effects.lens_effects import Distortion, LateralColour
from simulator.effects.panel_effects import Interference
from simulator.effects.picture_norms import minimum_norms
from simulator.effects.rendering_work import rendering_operations
from simulator.effects.time_effects import LampFlicker
from simulator.formation import expected_electrons
from simulator.ledger import Ledger
from simulator.panel_content import PanelContent
from simulator.planning import Effect
from simulator.probing.pattern_probe import PatternProbe
from simulator.recipe import Recipe
from simulator.scene import Flat, PhotographPrint, Star

NUMERICS = 2e-4
"""Relative, of pictures rendered for NUMERICS / 2."""

STRUCTURE = ("PSF reach", "light sampling", "diffraction")


def seeds(count: int, sweeps: Collection[int]) -> list[Any]:
    """So many, of which some, the dear ones or the last, are left to sweeps."""
    sweep = pytest.mark.sweep
    return [pytest.param(n, marks=sweep) if n in sweeps else n for n in range(count)]


def capped(s):
    """All effects that are caused at their finest, or at as fine as these tests can wait for."""
    most = {"filter bandwidth": 4, "panel orders": 1, "light sampling": 2, "out-of-band leak": 2}
    return {name: min(level, most.get(name, level)) for name, level in finest(s).items()}


def broken(s, effect: Effect, context, cache):
    """What an effect changes beyond its bound, from each level to its top in a context."""
    top = capped(s)[effect.name]
    with_it = rendered(s, {**context, effect.name: top}, cache)
    whole, found = np.linalg.norm(with_it), []
    for level in range(top):
        bound = effect.error_bound(s, level).mean
        if math.isinf(bound):
            continue
        without = rendered(s, {**context, effect.name: level}, cache)
        changed = np.linalg.norm(without - with_it)
        if changed > bound + NUMERICS * whole:
            found.append((effect.name, level, changed / whole, bound / whole))
    return found


@pytest.mark.parametrize("seed", seeds(6, sweeps=(0, 2, 5)))
def test_no_effect_changes_more_than_its_bound(seed):
    """By itself, and behind others that it acts on, at as few wavelengths and orders as do."""
    s, cache = random_situation(1000 + seed), ByteCache()
    full = capped(s)
    bare = {name: level if name in STRUCTURE else 0 for name, level in full.items()}
    few = {name: min(level, 1) for name, level in full.items()} | {"panel orders": 0}
    for effect in EFFECTS:
        if effect.name in full:
            assert not broken(s, effect, bare, cache)
            if effect.kind == "stage":
                assert not broken(s, effect, few, cache)


def test_nor_does_a_lamp_where_gaps_add_to_the_light():
    """Gaps in phase with pixels make a picture brighter than ideal pixels would."""
    bright = replace(CAMERA.panel, fill_factor=0.5, gap_reflection=0.7)
    lamp = Waveform("sine", 100.0, 0.4, 0.3)
    even = PhotographPrint(torch.full((40, 60, 3), 0.5), 1.0, 1e7, cover=3.0, lamp=lamp)
    s = situation(even, replace(CAMERA, panel=bright), exposure=1.3e-3)
    cache, full = ByteCache(), capped(s)
    ideal = {name: level if name in STRUCTURE else 0 for name, level in full.items()}
    with_gaps = {**ideal, "gap light": 1}
    assert rendered(s, with_gaps, cache).sum() > 1.5 * rendered(s, ideal, cache).sum()
    made = recipe(s, with_gaps)
    lit, mean = (
        expected_electrons(s, made.with_changes(lamp=on), cache, Ledger()) for on in (True, False)
    )
    changed = float(torch.linalg.vector_norm(lit - mean, dtype=torch.float64))
    assert changed <= LampFlicker().error_bound(s, 0).mean <= 2.5 * changed


@pytest.mark.sweep
@pytest.mark.parametrize("seed", range(6))
def test_nor_does_any_among_all_others_at_their_finest(seed):
    s, cache = random_situation(1000 + seed), ByteCache()
    full = capped(s)
    for effect in EFFECTS:
        if effect.name in full and effect.kind == "stage":
            assert not broken(s, effect, full, cache)


@pytest.mark.parametrize("seed", [3, 4])
def test_nor_does_a_crystal_on_its_way(seed):
    s, cache = random_situation(seed, video=True), ByteCache()
    full = capped(s)
    bare = {name: level if name in STRUCTURE else 0 for name, level in full.items()}
    crystal = next(one for one in EFFECTS if one.name == "liquid-crystal response")
    assert not broken(s, crystal, bare, cache)


@pytest.mark.parametrize("seed", seeds(12, sweeps=range(4, 12)))
def test_bounds_fall_with_the_level_and_are_nothing_at_the_finest(seed):
    s = random_situation(seed, video=seed % 2 == 0)
    for effect in EFFECTS:
        if not effect.is_present(s):
            continue
        levels = range(effect.finest_level(s) + 1)
        bounds = [effect.error_bound(s, level) for level in levels]
        for name in ("mean", "variance", "sigma"):
            values = [getattr(one, name) for one in bounds]
            assert values == sorted(values, reverse=True)
            assert values[-1] == 0
        assert all(one.how.startswith(("proved", "audited")) for one in bounds)
        assert all(0 <= effect.estimated_error(s, level) < math.inf for level in levels)
        assert effect.explain(s)
        names = {one.name: one.finest_level(s) for one in EFFECTS if one.is_present(s)}
        assert effect.added_operations(s, names) >= 0
        assert effect.added_operations(s, {**names, effect.name: 0}) == 0


def test_what_interferes_stays_within_its_bound():
    path = PathEffect(torch.tensor(0.5), torch.tensor(0.05), torch.tensor(0.3 + 0.2j))
    grey = pattern(np.random.default_rng(8), PANEL)
    s = situation(path=path, shown=PanelContent.of(grey[None], math.inf), numerics=1e-4)
    bare = {name: level if name in STRUCTURE else 0 for name, level in capped(s).items()}
    bare["unmodulated light"] = 1
    assert not broken(s, Interference(), bare, ByteCache())
    assert Interference().is_present(s)
    assert not Interference().is_present(situation())


def test_places_in_the_field_stay_within_their_bound():
    camera = replace(CAMERA, separation=0.02)
    star = Star(40e-6, 1.0, 2e12, (3e-3, 3e-3))
    s = situation(star, camera, numerics=1e-3)
    effect = FieldPosition()
    waves = Recipe(PANEL, 64, 2, diffraction=True)
    one, many = (
        expected_electrons(s, waves.with_changes(places=n), ByteCache(), Ledger()).double().numpy()
        for n in (1, 3)
    )
    assert np.linalg.norm(one - many) <= effect.error_bound(s, 0).mean
    assert not effect.is_present(situation())


def test_wide_bands_take_more_wavelengths_than_narrow_ones():
    counts = [
        Bandwidth().finest_level(situation(band=Band(550e-9, w))) for w in (1e-9, 20e-9, 80e-9)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_a_dark_scene_causes_nothing():
    s = situation(Flat(1.0, 0.0))
    assert not [one.name for one in EFFECTS if one.is_present(s)]


@pytest.mark.parametrize("seed", seeds(16, sweeps=range(2, 16)))
def test_the_floor_lies_below_the_picture_with_everything(seed):
    s = random_situation(200 + seed)
    sensor = s.camera.sensor
    light = rendered(s, {**capped(s), "filter bandwidth": 2, "panel orders": 0}, ByteCache())
    known = minimum_norms(s)
    electrons = light + sensor.dark_current * s.exposure
    variance = electrons + sensor.read_noise**2
    # Of full wells, as if they were deeper.
    assert 0 <= known.mean <= np.linalg.norm(electrons)
    assert 0 < known.variance <= np.linalg.norm(variance)
    assert 0 < known.sigma <= np.linalg.norm(np.sqrt(variance))


def test_a_floor_isnt_far_below_a_photograph_nor_an_even_field():
    camera = Camera(
        Panel(shape=(96, 128), pitch=20e-6, unmodulated=0.0),
        Lens(0.05, 20.0, 1.0),
        Sensor(shape=(90, 96), pitch=10e-6, full_well=1e7, bits=16, gain=200.0),
    )
    image = torch.full((9, 9, 3), 0.5)
    for target in (PhotographPrint(image, 1.0, 1e7, cover=1.5), Flat(1.0, 1e7)):
        s = situation(target, camera, numerics=1e-4)
        light = rendered(s, {"PSF reach": 2, "light sampling": 2, "diffraction": 1}, ByteCache())
        assert minimum_norms(s).mean >= 0.3 * np.linalg.norm(light)


def test_a_dark_frames_floor_is_its_dark_current_and_read_noise():
    s = situation(Flat(1.0, 0.0), exposure=2.0)
    sensor, n = s.camera.sensor, 20 * 24
    assert minimum_norms(s).mean == pytest.approx(sensor.dark_current * 2.0 * math.sqrt(n))
    noise = sensor.dark_current * 2.0 + sensor.read_noise**2
    assert minimum_norms(s).variance == pytest.approx(noise * math.sqrt(n))
    assert minimum_norms(s).sigma == pytest.approx(math.sqrt(noise * n))


@pytest.mark.parametrize("seed", seeds(8, sweeps=(2, 5, 6)))
@pytest.mark.parametrize("on", [True, False])
def test_predicted_work_is_what_is_counted(seed, on):
    """But for sizes of transforms that are rounded up, orders that don't come near, and what
    little even light takes."""
    s, ledger = random_situation(seed), Ledger()
    levels = capped(s) if on else dict.fromkeys(finest(s), 0)
    expected_electrons(s, recipe(s, levels), ByteCache(), ledger)
    # What moves light and ghosts come after what rendering takes, and predict their own work.
    moving = Distortion(), LateralColour()
    moved = [ledger.operations_of(one.name) for one in moving]
    reflecting = ledger.operations_of("lens ghosts")
    rest = ledger.operations - sum(moved) - reflecting
    assert rendering_operations(s, levels) == pytest.approx(rest, rel=0.3, abs=1.5e5)
    for one, counted in zip(moving, moved, strict=True):
        if one.name in levels:
            predicted = one.added_operations(s, levels)
            assert predicted == pytest.approx(counted, rel=0.3, abs=1.5e5)
    if "lens ghosts" in levels:
        # With the larger picture that they take.
        straight = rendering_operations(s, levels | {"lens ghosts": 0})
        predicted = LensGhosts().added_operations(s, levels)
        predicted -= rendering_operations(s, levels) - straight
        assert predicted == pytest.approx(reflecting, rel=0.3, abs=1.5e5)


# What is known of a pattern.


def probe(grey, camera=CAMERA, distances=(1.0,)):
    return PatternProbe(camera, PanelContent.of(grey[None], math.inf), 550e-9, distances)


@pytest.mark.parametrize("neutral", [False, True])
def test_a_probes_light_is_that_of_the_rendered_psf(neutral):
    """What falls beyond squares, by PSFs rendered over three orders."""
    grey = pattern(np.random.default_rng(2), PANEL)
    if neutral:
        grey = np.full_like(grey, 40)
    known = probe(grey, distances=(0.9,))
    camera = replace(CAMERA, panel=replace(PANEL, unmodulated=0.0))
    plane = camera.sensor.window_plane((121, 121)).with_finer_pitch(2)
    operator = PSFOperator(camera, 0.9, 550e-9, plane, integrate=False)
    lights = [operator(None, known.fields[0]), operator.unmodulated_psf()]
    y, x = (at.abs().numpy() for at in plane.mesh())
    half = known.period / 2
    inside = (y < half) & (x < half)
    for side in (60e-6, 150e-6, 250e-6):
        worst = 0.0
        for light in lights:
            central = light.double().numpy() * inside
            within = central[(y <= side) & (x <= side)].sum() / central.sum()
            worst = max(worst, 1 - within)
        assert known.share_beyond(side) == pytest.approx(worst, abs=0.05)
        assert known.share_beyond(side) >= worst - 0.01
    aside = 1 - min(float((light.double().numpy() * inside).sum()) for light in lights)
    assert known.side_order_share == pytest.approx(aside, abs=0.01)


@pytest.mark.parametrize("periods", [0.5, 1.0])
def test_a_transfer_function_between_its_samples_is_that_of_the_rendered_psf(periods):
    """By the Fourier sum over PSFs of the middle order, and of parts of those beside it, on finer
    samples."""
    known = probe(pattern(np.random.default_rng(2), PANEL), distances=(0.9,))
    camera = replace(CAMERA, panel=replace(PANEL, unmodulated=0.0))
    plane = camera.sensor.window_plane((121, 121)).with_finer_pitch(2)
    operator = PSFOperator(camera, 0.9, 550e-9, plane, integrate=False)
    y, x = (at.numpy() for at in plane.mesh())
    half = periods * known.period
    light = operator(None, known.fields[0]).double().numpy() * ((abs(y) < half) & (abs(x) < half))
    ky, kx = np.array([700.0, -2100.0, 5000.0, 0.0]), np.array([300.0, 1500.0, 0.0, -6300.0])
    found, whole = (known.transfers_at(*at, (half, half))[0] for at in ((ky, kx), np.zeros((2, 1))))
    # Samples on the edge of the light that is transformed count in one of the two only.
    for at, v, u in zip(found / whole, ky, kx, strict=True):
        direct = (light * np.exp(2j * np.pi * (v * y + u * x))).sum() / light.sum()
        assert abs(at - direct) < 0.03


def test_a_transfer_function_is_nothing_beyond_what_the_panel_resolves():
    known = probe(pattern(np.random.default_rng(2), PANEL))
    finest = PANEL.shape[0] / known.period
    assert not known.transfers_at(np.array([1.01 * finest]), np.zeros(1), (1.0, 1.0))[0].any()


@pytest.mark.parametrize("width", [pytest.param(10e-9, marks=pytest.mark.sweep), 40e-9])
def test_what_few_wavelengths_miss_isnt_told_to_be_much_larger_than_it_is(width):
    """Nor smaller, on a panel and a sensor that are nearly like real ones."""
    camera = Camera(
        Panel(shape=(270, 480), pitch=8e-6, unmodulated=0.05),
        Lens(0.05, 10.0, 1.0),
        Sensor(shape=(96, 128), pitch=5e-6, full_well=1e7, bits=16, gain=200.0),
    )
    blocks = np.random.default_rng(3).integers(0, 60, (27, 48))
    grey = np.kron(blocks, np.ones((10, 10))).astype(np.uint8)
    s = situation(
        STAR, camera, Band(550e-9, width), PanelContent.of(grey[None], math.inf), numerics=1e-4
    )
    full = {name: level for name, level in finest(s).items() if name in STRUCTURE}
    full |= {"filter bandwidth": 7, "panel dispersion": 1, "panel orders": 0}
    cache, effect = ByteCache(), Bandwidth()
    whole = rendered(s, full, cache)
    for level in (0, 1, 2):
        changed = np.linalg.norm(rendered(s, {**full, "filter bandwidth": level}, cache) - whole)
        assert changed <= effect.error_bound(s, level).mean
        assert effect.error_bound(s, level).mean <= max(40 * changed, 1e-3 * np.linalg.norm(whole))


def test_reach_is_where_so_much_falls_beyond():
    known = probe(pattern(np.random.default_rng(2), PANEL))
    for share in (0.5, 0.1, 0.01):
        assert known.share_beyond(known.reach_of_share(share)) <= share
    assert known.share_beyond(known.period) == 0
    assert known.share_beyond(0.0) == 1
    with pytest.raises(ValueError, match="share"):
        known.reach_of_share(0.0)


def test_the_transfer_function_is_the_apertures_autocorrelation():
    """Of a square pupil in focus a triangle along each axis."""
    panel = replace(PANEL, shape=(32, 32), unmodulated=0.0)
    camera = replace(CAMERA, panel=panel, lens=replace(CAMERA.lens, f_number=10.0))
    transfer = probe(np.zeros((32, 32), np.uint8), camera).transfer_bounds
    end = 32 * 40e-6 / (550e-9 * camera.lens.image_distance)
    for low, high, mean in zip(transfer.low, transfer.high, transfer.mean_square, strict=True):
        middle = (low + high) / 2
        if 0.2 * end < middle < 0.5 * end and high - low < 0.05 * end:
            angle = np.linspace(0, 2 * np.pi, 400)
            along = [np.clip(1 - middle * np.abs(f(angle)) / end, 0, 1) for f in (np.sin, np.cos)]
            mean = mean / transfer.mean_square[0]
            assert mean == pytest.approx(((along[0] * along[1]) ** 2).mean(), rel=0.3, abs=0.02)
    aside = probe(np.zeros((32, 32), np.uint8), camera).side_order_share
    assert transfer.least[0] == pytest.approx(1 - aside, abs=1e-4)
    assert transfer.loss_bound(np.array([1e9]))[0] == 2


def test_a_probe_without_distances_is_refused():
    with pytest.raises(ValueError, match="distances"):
        probe(np.zeros(PANEL.shape, np.uint8), distances=())


def test_a_star_is_the_default_and_shines():
    assert situation().picture_probe.total > 0
    assert STAR.distance == 1.0
