"""Bounds of what follows from the target alone, against pictures summed up the long way."""

import math
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.fft

from optics.camera import Camera, Lens, Panel, Sensor
from optics.light import Band, Spectrum, Waveform
from simulator.effects.depths import DepthLayers
from simulator.effects.lamp import LampFlicker
from simulator.effects.moving import Motion
from simulator.effects.occlusion import Occlusion
from simulator.formation.nodes import depth_nodes
from simulator.mount import Mount
from simulator.probing.picture import MARGIN
from simulator.scene import Even, Flat, Sheet, Sheets, Star
from simulator.scene.polygons import Polygons, rectangle
from simulator.shown import Shown
from simulator.situation import Situation

WAVELENGTH, PITCH, SIDE, ACROSS = 550e-9, 5e-6, 32, 48
PLANE = SIDE + 2 * MARGIN
LENS = Lens(focal_length=0.125, f_number=5.0, focus_distance=2.0)
PANEL = Panel(shape=(ACROSS, ACROSS), pitch=WAVELENGTH * LENS.image_distance / (PLANE * PITCH))
"""A far field's period is the plane of the probe: a PSF is whole on it."""


def camera(**sensor):
    # A converter of an electron a step, which nothing fills: means are read as they are.
    sound = {"bits": 16, "full_well": 6e4, "gain": 1.0, "black_level": 100.0}
    return Camera(PANEL, LENS, Sensor(shape=(SIDE, SIDE), pitch=PITCH, **sound, **sensor))


def psf(rng, distance, pattern):
    """|sum over the panel of exp(i pattern + i k (1/d - 1/f) u²/2) exp(-2πi u x / λz)|², at every
    pixel of the plane: a matrix for each axis. It sums up to 1."""
    u = (np.arange(ACROSS) - ACROSS / 2 + 0.5) * PANEL.pitch
    x = (np.arange(PLANE) - PLANE // 2) * PITCH
    turns = np.exp(-2j * np.pi * np.outer(x, u) / (WAVELENGTH * LENS.image_distance))
    vergence = 1 / distance - 1 / LENS.focus_distance
    wave = np.pi / WAVELENGTH * vergence * (u[:, None] ** 2 + u**2)
    light = np.abs(turns @ np.exp(1j * (pattern + wave)) @ turns.T) ** 2
    return light / light.sum()


def blurred(light, spread):
    product = scipy.fft.rfft2(np.asarray(light, dtype=float)) * transfer(spread.tobytes())
    return scipy.fft.irfft2(product)


@lru_cache(maxsize=16)
def transfer(spread):
    return scipy.fft.rfft2(np.fft.ifftshift(np.frombuffer(spread).reshape(PLANE, PLANE)))


def frame(picture):
    return picture[MARGIN:-MARGIN, MARGIN:-MARGIN]


def random_pattern(rng):
    kind = rng.integers(3)
    if kind == 0:
        return np.zeros((ACROSS, ACROSS))
    if kind == 1:
        return rng.uniform(0, 2 * np.pi, (ACROSS, ACROSS))
    slope = rng.normal(size=2) * 0.5
    y, x = np.mgrid[:ACROSS, :ACROSS] - ACROSS / 2
    return slope[0] * y + slope[1] * x + 0.01 * rng.normal() * (y**2 + x**2)


def paint(rng):
    return Spectrum.even(float(rng.uniform(0.1, 1)))


def sheets(rng, count, background=True):
    """Rectangles at distances before an even background, all about in the frame."""
    distances = np.sort(rng.uniform(1.2, 3.5, count))
    found = []
    for k, distance in enumerate(distances.tolist()):
        scale = LENS.image_distance / distance
        size, middle = rng.uniform(2e-5, 2e-4, 2) / scale, rng.uniform(-8e-5, 8e-5, 2) / scale
        shape = Polygons((rectangle(tuple(middle), tuple(size), rng.uniform(0, 3)),), (1.0,))
        if background and k == count - 1:
            shape = Even()
        found.append(Sheet(distance, ((paint(rng), shape),), shape))
    return Sheets(tuple(found), float(10 ** rng.uniform(6, 8)))


def situation(target, cam=None, *, exposure=0.01, moment=0.0, moves=False, reach=None):
    cam = cam or camera()
    grey = np.zeros((2 if moves else 1, ACROSS, ACROSS), dtype=np.uint8)
    if moves:
        grey[1] += 100
    # As if all light could fall on a pixel.
    pattern = SimpleNamespace(
        reach=reach, order_light=0.0, period=1.0, peak=math.inf, energy=math.inf, middle=1.0,
        transfer=SimpleNamespace(most_at=lambda k, spread: np.ones_like(k)),
    )  # fmt: skip
    shown = Shown.of(grey, 1 / 60 if moves else math.inf)
    s = Situation(cam, Mount(), target, Band(WAVELENGTH, 7e-9), shown, moment, exposure)
    # What would be found when first asked for.
    vars(s)["pattern"] = pattern
    return s


def holds(effect, s, level, measured):
    """A bound is never below what was measured, and not absurdly above it."""
    bound = effect.bound(s, level)
    assert bound.mean >= measured * (1 - 1e-5)
    return bound.mean


def falls(effect, s):
    """No level's bound is above a coarser one's, the finest's is nothing."""
    bounds = [effect.bound(s, level).mean for level in range(effect.finest(s) + 1)]
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[-1] == 0
    assert all(effect.why(s))
    assert all(effect.estimate(s, k) >= 0 for k in range(effect.finest(s) + 1))


@pytest.mark.parametrize("seed", range(8))
def test_depth_layers(seed):
    rng = np.random.default_rng(seed)
    s = situation(sheets(rng, int(rng.integers(2, 5))))
    effect, pattern = DepthLayers(), random_pattern(rng)
    assert effect.caused(s)

    def picture(count):
        nodes = depth_nodes(s.picture.distances, count)
        seen = np.zeros((PLANE, PLANE))
        for k in reversed(range(len(s.picture.lights))):
            spread = sum(
                share * psf(rng, node, pattern) for node, share in nodes[s.picture.distances[k]]
            )
            cover = s.picture.covers[k]
            front = blurred(s.picture.lights[k], spread)
            seen = front + (seen if cover is None else seen * (1 - blurred(cover, spread)))
        return frame(seen) * s.exposure

    exact = picture(33)
    for level in range(effect.finest(s)):
        measured = np.linalg.norm(picture(int(effect.levels[level])) - exact)
        holds(effect, s, level, measured)
    falls(effect, s)


@pytest.mark.parametrize("seed", range(8))
def test_occlusion(seed):
    rng = np.random.default_rng(100 + seed)
    pattern = random_pattern(rng)
    target = sheets(rng, int(rng.integers(2, 4)), background=bool(rng.integers(2)))
    spreads = [psf(rng, layer.distance, pattern) for layer in target.layers]

    def reach(share):
        """By counting: the smallest square that leaves out less than the share of any PSF."""
        away = np.abs(np.arange(PLANE) - PLANE // 2)
        square = np.maximum(away[:, None], away)
        sums = [np.bincount(square.ravel(), one.ravel()) for one in spreads]
        worst = np.max([1 - np.cumsum(one) for one in sums], axis=0)
        return float(np.argmax(worst <= share) + 1) * PITCH

    s = situation(target, reach=reach)
    effect = Occlusion()
    if not effect.caused(s):
        return
    seen, transparent = np.zeros((PLANE, PLANE)), np.zeros((PLANE, PLANE))
    for k in reversed(range(len(spreads))):
        front = blurred(s.picture.lights[k], spreads[k])
        cover = s.picture.covers[k]
        hidden = 0.0 if cover is None else blurred(cover, spreads[k])
        seen, transparent = seen * (1 - hidden) + front, transparent + front
    measured = np.linalg.norm(frame(transparent - seen)) * s.exposure
    bound = holds(effect, s, 0, measured)
    # It is of use: no more than all the light that is behind.
    behind = sum(float(one.double().norm()) for one in s.picture.lights[1:])
    assert bound <= behind * s.exposure * 1.02
    falls(effect, s)


def test_occlusion_of_things_far_apart_is_nothing_much():
    """Two small sharp things on either side of the frame; a PSF of two pixels."""
    left = Polygons((rectangle((0.0, -9e-4), (3e-4, 3e-4)),), (1.0,))
    right = Polygons((rectangle((0.0, 1.2e-3), (3e-4, 3e-4)),), (1.0,))
    target = Sheets((Sheet(1.9, ((None, left),), left), Sheet(2.1, ((None, right),), right)), 1e8)
    s = situation(target, reach=lambda share: 2 * PITCH)
    bound = Occlusion().bound(s, 0).mean
    assert bound <= 3e-4 * float(s.picture.lights[1].double().norm()) * s.exposure
    assert Occlusion().estimate(s, 0) == 0


LAMPS = [
    Waveform("sine", 100.0, 0.3, 0.4), Waveform("square", 500.0, 1.0, 1.0, duty=0.25),
    Waveform("filament", 100.0, 0.08),
]  # fmt: skip


@pytest.mark.parametrize("lamp", LAMPS)
@pytest.mark.parametrize("exposure", [3e-4, 7.3e-3, 0.05])
def test_lamp_flicker_of_rows(lamp, exposure):
    """Each row sees the lamp's mean over its own exposure: summed up over many instants."""
    cam = camera(shutter="rolling", line_time=3e-5)
    s = situation(Flat(2.0, 1e8, lamp=lamp), cam, exposure=exposure, moment=0.123)
    light = frame(s.picture.picture.double().numpy())
    instants = (np.arange(20_000) + 0.5) / 20_000 * exposure
    seen = np.array([lamp.at(0.123 + 3e-5 * row + instants).mean() for row in range(SIDE)])
    for rows in (seen, np.full(SIDE, seen[0])):
        measured = np.linalg.norm(light * (rows - 1)[:, None]) * exposure
        holds(LampFlicker(), s, 0, measured * (1 - 1e-3))
    falls(LampFlicker(), s)


@pytest.mark.parametrize("seed", range(6))
def test_lamp_flicker_of_a_video(seed):
    """Frames of 1/60 s, each with a PSF of its own, under a lamp that favours some of them."""
    rng = np.random.default_rng(seed)
    lamp = LAMPS[seed % 3]
    exposure = float(10 ** rng.uniform(-3, -1))
    target = Star(1e-3, 2.0, 1e8, lamp=lamp)
    s = situation(target, exposure=exposure, moment=float(rng.uniform(0, 1)), moves=True)
    spreads = [psf(rng, 2.0, random_pattern(rng)) for _ in range(2)]
    pictures = [frame(blurred(s.picture.lights[0], one)) for one in spreads]
    times = s.moment + (np.arange(20_000) + 0.5) / 20_000 * exposure
    first = np.floor(times * 60).astype(int) % 2
    lit = lamp.at(times) - 1
    shares = [(lit * (first == k)).mean() * exposure for k in range(2)]
    change = shares[0] * pictures[0] + shares[1] * pictures[1]
    holds(LampFlicker(), s, 0, np.linalg.norm(change) * (1 - 1e-3))
    falls(LampFlicker(), s)


def test_a_steady_lamp_causes_nothing():
    assert not LampFlicker().caused(situation(Flat(2.0, 1e8)))
    assert not LampFlicker().caused(situation(Flat(2.0, 1e8, lamp=Waveform())))
    assert not Motion().caused(situation(Flat(2.0, 1e8)))
    assert not DepthLayers().caused(situation(Flat(2.0, 1e8)))
    assert not Occlusion().caused(situation(Flat(2.0, 1e8)))


def moving(rng, lamp=None):
    """A star in the middle of the frame at the exposure's middle."""
    speed = rng.normal(size=2) * 10 ** rng.uniform(-3, -1.3)
    return Star(float(rng.uniform(2e-4, 1e-3)), 2.0, 1e8, velocity=tuple(speed.tolist()), lamp=lamp)


def at(s, time):
    """The sharp picture at a time."""
    shift = tuple(v * time for v in s.target.velocity)
    return replace(s.picture, shift=shift).lights[0].double().numpy()


@pytest.mark.parametrize(
    "seed", [0, 3, 5, 7, *(pytest.param(n, marks=pytest.mark.sweep) for n in (1, 2, 4, 6))]
)
@pytest.mark.parametrize("rolling", [False, True])
def test_motion(seed, rolling):
    """By very many instants, each with its own place, lamp and PSF; rows in turn where rolling."""
    rng = np.random.default_rng(seed)
    lamp = LAMPS[seed % 3] if seed % 2 else None
    video = seed >= 6
    cam = camera(shutter="rolling", line_time=4e-5) if rolling else camera()
    exposure = 4e-3
    s = situation(moving(rng, lamp), cam, exposure=exposure, moment=0.0, moves=video)
    spreads = [psf(rng, 2.0, random_pattern(rng)) for _ in range(2 if video else 1)]
    starts = 4e-5 * np.arange(SIDE) if rolling else np.zeros(SIDE)
    whole = exposure + starts[-1]

    def frames(time):
        return int(time // 1e-3) % len(spreads)

    def summed(count, path):
        """Of instants; path(time) is the place where it counts as being."""
        total = np.zeros((SIDE, SIDE))
        step = whole / count
        cached = {}
        for k in range(count):
            time = (k + 0.5) * step
            rows = (starts <= time) & (time < starts + exposure)
            weight = step * (lamp.at(time) if lamp else 1.0)
            place = path(time)
            key = (round(place, 9), frames(time))
            if key not in cached:
                cached = {key: frame(blurred(at(s, place), spreads[key[1]]))}
            total += cached[key] * weight * rows[:, None]
        return total

    count = 96
    exact = summed(count, lambda time: time)
    effect = Motion()
    measured = np.linalg.norm(summed(count, lambda time: exposure / 2) - exact)
    holds(effect, s, 0, measured * 0.99)
    falls(effect, s)


def test_a_path_in_parts_is_nearer_the_finer_they_are():
    """Under a lamp that flickers, each part lit evenly by its own mean light."""
    rng = np.random.default_rng(5)
    lamp = LAMPS[1]
    s = situation(moving(rng, lamp), exposure=4e-3)
    spread = psf(rng, 2.0, random_pattern(rng))
    count = 128
    times = (np.arange(count) + 0.5) / count * 4e-3
    pictures = np.array([frame(blurred(at(s, time), spread)) for time in times])
    weights = lamp.at(times)
    exact = np.tensordot(weights, pictures, 1) * 4e-3 / count
    for level in range(1, 5):
        means = np.repeat(weights.reshape(2**level, -1).mean(1), count // 2**level)
        measured = np.linalg.norm(np.tensordot(means, pictures, 1) * 4e-3 / count - exact)
        holds(Motion(), s, level, measured)


def test_an_even_path_is_exact_in_one_piece():
    s = situation(moving(np.random.default_rng(1)))
    assert Motion().finest(s) == 1
    assert Motion().bound(s, 1).mean == 0


def test_work_grows_with_the_level():
    s = situation(sheets(np.random.default_rng(0), 4), reach=lambda share: 2 * PITCH)
    for effect in (DepthLayers(), Occlusion()):
        done = [effect.work(s, {effect.name: k}) for k in range(effect.finest(s) + 1)]
        assert done == sorted(done)
        assert done[0] == 0
    s = situation(moving(np.random.default_rng(1), LAMPS[0]))
    for effect in (Motion(), LampFlicker()):
        done = [effect.work(s, {effect.name: k}) for k in range(effect.finest(s) + 1)]
        assert done == sorted(done)
        assert done[0] == 0


def test_recipes_have_what_effects_add():
    class Kept:
        def having(self, **changes):
            return changes

    assert LampFlicker().apply(Kept(), None, 1) == {"lamp": True}
    assert Motion().apply(Kept(), None, 3) == {"motion": 8}
    assert DepthLayers().apply(Kept(), None, 4) == {"depths": 9}
    assert Occlusion().apply(Kept(), None, 1) == {"occlusion": True}
