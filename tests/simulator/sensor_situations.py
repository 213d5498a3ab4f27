"""Situations that have only what the sensor's effects look at: a sharp picture on its pixels."""

from types import SimpleNamespace

import numpy as np
import torch

from optics.camera import Camera, Panel, Sensor
from optics.plane import Plane
from optics.sensor import moments
from optics.sensor.readout import frame_duration
from simulator.effects.sensor_effects import (
    Clipping,
    DarkCurrent,
    FixedPattern,
    Quantisation,
    ReadNoise,
)
from simulator.effects.shot_noise import ShotNoise
from simulator.probing.sampled_frequencies import RadialProfile
from simulator.recipe import Recipe
from simulator.situation import SituationCache

EFFECTS = [DarkCurrent(), ShotNoise(), Clipping(), ReadNoise(), FixedPattern(), Quantisation()]
BARE = Recipe(Panel(), 64, 1)
UNEVEN = {"prnu": 0.02, "dsnu": 1.5, "dead": 0.02, "hot": 0.02, "hot_current": 300.0}


def read(light, one, exposure, recipe):
    """Mean and variance of what a sensor reads, electrons, with the stages of a recipe."""
    stages = {
        name: getattr(recipe.stages, name)
        for name in ("dark_current", "fixed_pattern", "shot", "clipping",
                     "read_noise", "quantisation")
    }  # fmt: skip
    return moments(light * exposure, exposure, one, **stages)


def changes(one, other):
    """L2 norms of what two pairs of mean and variance differ by: in mean, variance and σ."""
    mean, variance = one[0] - other[0], one[1] - other[1]
    sigma = one[1].sqrt() - other[1].sqrt()
    return tuple(float(torch.linalg.vector_norm(part)) for part in (mean, variance, sigma))


def sensor(rng: np.random.Generator, **more) -> Sensor:
    """Any sensor of 12 x 12 pixels, with small wells, so that they are often full."""
    bits = int(rng.integers(6, 11))
    gain = float(np.exp(rng.uniform(np.log(0.3), np.log(8))))
    return Sensor(**{
        "shape": (12, 12), "bits": bits, "gain": gain,
        "full_well": float(gain * 2**bits * rng.uniform(0.3, 1.2)),
        # A well ends above its read noise, or nothing could be seen of it.
        "read_noise": float(rng.choice([0.0, 0.3, 1.0, 2.5])),
        "dark_current": float(rng.choice([0.0, 0.1, 5.0, 60.0])),
        "black_level": float(rng.choice([0.0, 2.0, 2 ** (bits - 3)])),
        "fixed_seed": int(rng.integers(1000)),
    } | more)  # fmt: skip


def picture(rng: np.random.Generator, most: float) -> torch.Tensor:
    """Electrons per second: a star, a gradient, an edge, or noise."""
    kind = rng.integers(4)
    light = np.zeros((12, 12))
    if kind == 0:
        light[tuple(rng.integers(12, size=2))] = most
    elif kind == 1:
        light += np.linspace(0, most, 12)
    elif kind == 2:
        light[:, 6:] = most
    else:
        light = rng.random((12, 12)) * most
    return torch.from_numpy(light)


class Known(SimpleNamespace):
    """What a test says of a situation; as a real one, it is equal to nothing but itself."""

    __eq__ = object.__eq__
    __hash__ = object.__hash__


def situation(light: torch.Tensor, one: Sensor, exposure: float = 0.5, **more) -> Known:
    """light: electrons per second on each pixel, as sharp as it is."""
    plane = Plane(tuple(light.shape), (one.pitch, one.pitch))
    probe = SimpleNamespace(
        norm_bound=float(light.square().sum().sqrt()),
        brightest=float(light.max()),
        total=float(light.sum()),
        total_with_margin=float(light.sum()),
        off_plane_star_rate=0.0,
        excess_over=lambda level: tuple(
            float(((light - level).clamp(min=0) ** power).sum()) for power in (1, 2)
        ),
        dim_decile=float(light.min()),
        # Of two distances no PSF is known: any blur may be.
        distances=(1.0, 2.0),
        is_dark=not bool(light.any()),
        power_spectrum=RadialProfile.of(torch.fft.rfft2(light), plane),
    )
    return Known(**{
        "camera": Camera(sensor=one), "picture_probe": probe,
        "exposure": exposure, "exposure_start": 0.0,
        "exposure_span": frame_duration(one, exposure),
        "target": SimpleNamespace(speckle=None, lamp=None, is_moving=False, layers=()),
        "panel_content": SimpleNamespace(is_changing=False), "interference": 0j,
        "pattern_probe": SimpleNamespace(max_relative_power=1.0),
        "cache": SituationCache(),
    } | more)  # fmt: skip
