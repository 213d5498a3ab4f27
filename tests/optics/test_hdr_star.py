"""A merged star against its light: rings and apertures around it, decade by decade."""

import itertools

import numpy as np
import pytest
import scipy.special

from optics.camera import Sensor
from optics.hdr import CLIPPED, Bracket, merge

SENSOR = Sensor(
    bits=12, full_well=1e6, gain=2.6, read_noise=2.4, dark_current=1.0, black_level=64.0
)
TIMES = 1e-3 * 8.0 ** np.arange(5)
DARKS = 4
DECADES = 6
SEEDS = 8


def airy_star(peak):
    """Airy's pattern (Born and Wolf, section 8.5.2) with rings of eight pixels, and its radii."""
    rows, columns = np.indices((257, 257)) - 128
    radius = np.hypot(rows, columns)
    x = np.pi * np.maximum(radius, 1e-9) / 8
    return peak * (2 * scipy.special.j1(x) / x) ** 2, radius


def star_bracket(light, seed):
    """Frames and mean darks of a star by the definitions of EMVA 1288."""
    rng = np.random.default_rng(seed)

    def seen(rate, time):
        electrons = rng.poisson((rate + 1.0) * time) + rng.normal(0, 2.4, rate.shape)
        return np.clip(np.round(electrons / 2.6 + 64), 0, 4095)

    frames = [seen(light, time) for time in TIMES]
    darks = [np.mean([seen(0 * light, t) for _ in range(DARKS)], axis=0) for t in TIMES]
    return Bracket(frames, TIMES, darks, [DARKS] * len(TIMES), SENSOR)


def decade_radii(light, radius):
    """Radii from which on all light is below a tenth of the peak, a hundredth, and so on."""
    return [
        radius[light > light.max() / 10**decade].max() + 0.5 for decade in range(1, DECADES + 1)
    ]


def test_energy_in_rings_and_apertures_is_the_light_within_the_stated_deviation():
    light, radius = airy_star(5e6)
    edges = [0.0, *np.unique(decade_radii(light, radius))]
    assert len(edges) >= 6
    away = []
    for seed in range(SEEDS):
        found = merge(star_bracket(light, seed))
        error = found.rate.numpy().astype(np.float64) - light
        variance = found.variance.numpy().astype(np.float64)
        assert not (found.state.numpy() == CLIPPED).any()
        for inner, outer in itertools.pairwise(edges):
            for least in {0.0, inner}:
                part = (least <= radius) & (radius < outer)
                away.append(error[part].sum() / np.sqrt(variance[part].sum()))
    # There are 88 deviations: in one of five such tests, chance takes one beyond three.
    assert np.abs(away).max() <= 4
    assert np.sqrt(np.mean(np.square(away))) == pytest.approx(1, abs=0.3)
