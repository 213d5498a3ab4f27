"""Patterns on panels, raw frames, and brackets of exposures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from judges.view import WAVELENGTH

from hard_cases.panels import CAMERA
from hard_cases.table import DOUBLE, ONCE, SINGLE, Case, Holds
from optics.camera import Panel, Sensor
from optics.hdr import CLIPPED, DARK, Bracket, merge
from optics.retrieval.gerchberg_saxton import gerchberg_saxton
from optics.retrieval.goal import design_plane
from optics.sensor import expose
from optics.slm import grey_to_phase, max_phase, phase_to_grey

SENSOR = Sensor(shape=(8, 8))
BITS = (SINGLE, DOUBLE)


def dtype_for(tol: float) -> torch.dtype:
    return torch.float32 if tol > 1e-7 else torch.float64


def one_bright_sample(tol: float) -> None:
    """angle(0) must not poison the pattern; one focus is a blazed grating."""
    plane = design_plane(CAMERA, WAVELENGTH, (16, 16))
    target = torch.zeros(16, 16)
    target[8, 11] = 1
    phase = gerchberg_saxton(
        CAMERA, target, plane, WAVELENGTH, iterations=5, generator=torch.Generator()
    )
    assert torch.isfinite(phase).all()
    # With 2 x 15 samples an order, 3 samples are 3/30 turn a pixel; a twin may win.
    field = np.exp(1j * phase.numpy())
    ramp = np.exp(2j * np.pi * 3 / 30 * np.arange(15))
    shares = [abs((field * each).sum()) / field.size for each in (ramp, ramp.conj())]
    assert max(shares) > 0.95


def next_to_a_whole_wave(tol: float) -> None:
    """2 pi less a rounding error is grey level 0 or the wave's last, never in between."""
    panel = Panel()
    waves = torch.tensor([0.0, 2 * math.pi, -1e-17, 2 * math.pi - 1e-12, 4 * math.pi + 1e-12])
    shown = grey_to_phase(panel, phase_to_grey(panel, waves.double(), WAVELENGTH), WAVELENGTH)
    level = max_phase(panel, WAVELENGTH) / 255
    assert np.abs(np.angle(np.exp(1j * shown.numpy()))).max() <= 0.5 * level


def one_photon(tol: float) -> None:
    """The counts of 1e5 pixels, within five standard deviations of Poisson's."""
    sensor = replace(SENSOR, gain=1.0, read_noise=0.0, dark_current=0.0, black_level=0.0)
    rate = torch.ones(100_000, dtype=dtype_for(tol))
    numbers = expose(rate, 1.0, sensor, torch.Generator().manual_seed(1)).double()
    for k in range(5):
        expected = math.exp(-1) / math.factorial(k)
        spread = math.sqrt(expected / 1e5)
        assert abs(float((numbers == k).double().mean()) - expected) <= 5 * spread


def far_too_bright(tol: float) -> None:
    """The highest number everywhere."""
    light = torch.full((8, 8), 1e30, dtype=dtype_for(tol))
    assert (expose(light, 30.0, SENSOR, torch.Generator()) == 4095).all()


def merged(frames: Any, exposures: list[float], darks: float, count: int, dtype: Any) -> Any:
    frames = torch.as_tensor(np.array(frames), dtype=dtype)[:, None].numpy()
    number = len(exposures)
    return merge(Bracket(frames, exposures, [darks] * number, [count] * number, SENSOR))


def dark_and_clipped(tol: float) -> None:
    """Bounds and states in place of rates; no division by nothing."""
    answer = merged([[64, 4095], [64, 4095]], [0.1, 1.0], 64.0, 4, dtype_for(tol))
    assert answer.state[0].tolist() == [DARK, CLIPPED]
    assert torch.isfinite(answer.rate).all()
    assert float(answer.rate[0, 0]) == 0
    brightest = (4095 - 0.5 - 64) * SENSOR.gain / 0.1
    assert abs(float(answer.rate[0, 1]) / brightest - 1) <= 1e-6
    assert math.isfinite(float(answer.variance[0, 0]))


def darker_than_dark(tol: float) -> None:
    """A negative rate, unchanged, and said to be dark."""
    answer = merged([[60.0], [40.0]], [0.1, 1.0], 64.0, 4, dtype_for(tol))
    assert float(answer.rate[0, 0]) < 0
    assert answer.state[0, 0] == DARK
    assert math.isfinite(float(answer.variance[0, 0]))


def fifteen_stops(tol: float) -> None:
    """Only rounding is left: a twelfth of a step, and sixteen frames of it."""
    exposures = [2.0**-k for k in range(16)]
    rates = np.geomspace(50, 1e8, 60)
    numbers = [(np.round(rates * t / SENSOR.gain) + 64).clip(0, 4095) for t in exposures]
    answer = merged(numbers, exposures, 64.0, 100, dtype_for(tol))
    seen = answer.state[0].numpy() == 0
    assert seen.sum() > 50
    assert np.abs(answer.rate[0].numpy() / rates - 1)[seen].max() < 0.02


def law(
    name: str, why: str, given: str, function: Callable[[float], None], judge: str, **row: Any
) -> Holds:
    return Holds(name, why, given, function, judge, **{"tols": BITS, **row})


CASES: list[Case] = [
    law("one bright sample on black", "amplitudes of exactly zero have no angle",
        "target of 16x16", one_bright_sample, "a blazed grating", tols=ONCE),
    law("a phase next to a whole wave", "rounding takes it to the wrong end of the range",
        "2 pi ± 1e-12", next_to_a_whole_wave, "half a grey level", tols=ONCE),
    law("one photon", "a rounded Gaussian isn't Poisson's distribution", "mean 1 electron",
        one_photon, "exp(-1) / k!"),
    law("more light than any sensor takes", "Poisson's generator and int32 overflow",
        "1e30 electrons a second", far_too_bright, "the highest number"),
    law("dark and clipped in every exposure", "nothing to divide by on either side",
        "64 and 4095, twice", dark_and_clipped, "bounds and states"),
    law("a dark frame brighter than the picture", "the square root of a negative rate",
        "60 and 40 less 64", darker_than_dark, "its state"),
    law("twelve bits and fifteen stops", "the small must survive beside the large",
        "50 to 1e8 electrons a second", fifteen_stops, "the rates that were exposed"),
]  # fmt: skip
