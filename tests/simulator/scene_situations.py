"""Situations of which the target alone matters: things at distances, lamps, what moves; and their
pictures summed up the long way, by PSFs that are whole on the plane of the probe."""

import math
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import scipy.fft

from optics.camera import Camera, Lens, Panel, Sensor
from optics.light import Band, Spectrum, Waveform
from simulator.formation.nodes import depth_nodes
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.probing.picture_probe import MARGIN
from simulator.scene import Sheet, Sheets, Star, UniformLight
from simulator.scene.polygons import Polygons, rectangle
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


def psf(distance, pattern):
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
    return Spectrum.flat(float(rng.uniform(0.1, 1)))


def sheets(rng, count, background=True):
    """Rectangles at distances before an even background, all about in the frame."""
    distances = np.sort(rng.uniform(1.2, 3.5, count))
    found = []
    for k, distance in enumerate(distances.tolist()):
        scale = LENS.image_distance / distance
        size, middle = rng.uniform(2e-5, 2e-4, 2) / scale, rng.uniform(-8e-5, 8e-5, 2) / scale
        shape = Polygons((rectangle(tuple(middle), tuple(size), rng.uniform(0, 3)),), (1.0,))
        if background and k == count - 1:
            shape = UniformLight()
        found.append(Sheet(distance, ((paint(rng), shape),), shape))
    return Sheets(tuple(found), float(10 ** rng.uniform(6, 8)))


def situation(target, cam=None, *, exposure=0.01, moment=0.0, moves=False, reach=None):
    cam = cam or camera()
    grey = np.zeros((2 if moves else 1, ACROSS, ACROSS), dtype=np.uint8)
    if moves:
        grey[1] += 100
    # As if all light could fall on a pixel.
    pattern = SimpleNamespace(
        reach_of_share=reach, side_order_share=0.0, period=1.0, peak=math.inf,
        squared_density=math.inf, zeroth_order_share=1.0,
        max_relative_power=1.0,
        transfer_bounds=SimpleNamespace(modulus_bound=lambda k, spread: np.ones_like(k)),
    )  # fmt: skip
    shown = PanelContent.of(grey, 1 / 60 if moves else math.inf)
    s = Situation(cam, Mount(), target, Band(WAVELENGTH, 7e-9), shown, moment, exposure)
    # What would be found when first asked for.
    s.cache.pattern_probe = pattern
    return s


def at_depths(s, pattern, count):
    """What is seen with so many depths, electrons on the frame; what is near hides what is far."""
    nodes = depth_nodes(s.picture_probe.distances, count)
    seen = np.zeros((PLANE, PLANE))
    for k in reversed(range(len(s.picture_probe.lights))):
        spread = sum(
            share * psf(node, pattern) for node, share in nodes[s.picture_probe.distances[k]]
        )
        cover = s.picture_probe.covers[k]
        front = blurred(s.picture_probe.lights[k], spread)
        seen = front + (seen if cover is None else seen * (1 - blurred(cover, spread)))
    return frame(seen) * s.exposure


def seen_and_transparent(s, spreads):
    """What is seen with a PSF for each layer, and as if no layer hid any other; electrons."""
    seen, transparent = np.zeros((PLANE, PLANE)), np.zeros((PLANE, PLANE))
    for k in reversed(range(len(spreads))):
        front = blurred(s.picture_probe.lights[k], spreads[k])
        cover = s.picture_probe.covers[k]
        hidden = 0.0 if cover is None else blurred(cover, spreads[k])
        seen, transparent = seen * (1 - hidden) + front, transparent + front
    return frame(seen) * s.exposure, frame(transparent) * s.exposure


LAMPS = [
    Waveform("sine", 100.0, 0.3, 0.4), Waveform("square", 500.0, 1.0, 1.0, duty=0.25),
    Waveform("filament", 100.0, 0.08),
]  # fmt: skip


def moving(rng, lamp=None):
    """A star in the middle of the frame at the exposure's middle."""
    speed = rng.normal(size=2) * 10 ** rng.uniform(-3, -1.3)
    return Star(float(rng.uniform(2e-4, 1e-3)), 2.0, 1e8, velocity=tuple(speed.tolist()), lamp=lamp)


def at(s, time):
    """The sharp picture at a time."""
    shift = tuple(v * time for v in s.target.velocity)
    return replace(s.picture_probe, shift=shift).lights[0].double().numpy()
