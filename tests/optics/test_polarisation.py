"""Polarisation: what the panel can't turn, what passes, and what the sum in intensity leaves."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
import torch

from optics.polarisation import (
    BeamSplitter,
    PolarisedPath,
    Polariser,
    SourcePolarisation,
    linear_jones_vector,
)

LINEAR = SourcePolarisation(1.0)
POLARISING = BeamSplitter((1.0, 0.0), (0.0, 1.0))


def power(vector: torch.Tensor) -> float:
    return float((vector.abs() ** 2).sum())


@pytest.mark.parametrize("degrees", [0, 20, 45, 70, 90, 135])
def test_malus_law(degrees):
    angle = math.radians(degrees)
    passed = power(Polariser(angle).jones_matrix @ linear_jones_vector(0.0))
    assert passed == pytest.approx(math.cos(angle) ** 2, abs=1e-15)


@pytest.mark.parametrize("extinction", [1.0, 50.0, 1e4, math.inf])
def test_crossed_polarisers_pass_what_their_extinction_leaves(extinction):
    """Of natural light, half along and half across: each is dimmed once, 1 / extinction."""
    first, second = (Polariser(angle, extinction) for angle in (0.3, 0.3 + math.pi / 2))
    natural = [(float(share), wave) for share, wave in SourcePolarisation().incoherent_components]
    passed = sum(
        share * power(second.jones_matrix @ first.jones_matrix @ wave) for share, wave in natural
    )
    assert passed == pytest.approx(1 / extinction, abs=1e-15)


def test_a_polariser_of_natural_light_passes_half_whatever_its_angle():
    for angle in (0.0, 0.7, 2.0):
        effect = PolarisedPath(polariser=Polariser(angle, transmission=0.8)).effect()
        assert float(effect.transmission) == pytest.approx(0.4)


@pytest.mark.parametrize("degrees", [0.0, 3.0, 12.9, 45.0, 90.0, -12.9])
def test_the_unmodulated_share_is_the_squared_sine_of_a_misaligned_polariser(degrees):
    angle = math.radians(degrees)
    effect = PolarisedPath(polariser=Polariser(angle)).effect()
    assert float(effect.unmodulated) == pytest.approx(math.sin(angle) ** 2, abs=1e-15)
    assert float(effect.transmission) == pytest.approx(0.5)


def test_an_aligned_polariser_leaves_what_its_extinction_says():
    effect = PolarisedPath(polariser=Polariser(0.0, 99.0)).effect()
    assert float(effect.unmodulated) == pytest.approx(0.01)
    assert float(effect.transmission) == pytest.approx((1 + 1 / 99) / 2)


def test_light_without_a_polariser_is_modulated_as_far_as_it_is_polarised():
    """Intensities along and across of linear light of a degree: (1 ± degree cos 2a) / 2."""
    degree, angle = 0.6, 0.5
    effect = PolarisedPath(SourcePolarisation(degree, angle)).effect()
    assert float(effect.unmodulated) == pytest.approx((1 - degree * math.cos(2 * angle)) / 2)
    assert float(effect.transmission) == pytest.approx(1.0)
    assert float(PolarisedPath().effect().unmodulated) == pytest.approx(0.5)


def test_a_splitter_that_does_not_polarise_dims_and_does_nothing_else():
    alone = PolarisedPath(polariser=Polariser(0.2, 500.0)).effect()
    cube = BeamSplitter((0.45, 0.45), (0.4, 0.4), angle=0.9)
    through = PolarisedPath(polariser=Polariser(0.2, 500.0), splitter=cube).effect()
    assert float(through.transmission) == pytest.approx(0.45 * 0.4 * float(alone.transmission))
    assert float(through.unmodulated) == pytest.approx(float(alone.unmodulated))
    assert abs(complex(through.interference)) < 1e-15


@pytest.mark.parametrize("first", ["transmitted", "reflected"])
def test_a_splitter_along_the_panel_weighs_both_polarisations(first):
    """Powers of the axes multiply: cos² tp rp modulated, and sin² ts rs unmodulated."""
    angle, cube = 0.3, BeamSplitter((0.6, 0.4), (0.3, 0.5))
    effect = PolarisedPath(LINEAR, Polariser(angle), cube, first=first).effect()
    m, u = math.cos(angle) ** 4 * 0.6 * 0.3, math.cos(angle) ** 2 * math.sin(angle) ** 2 * 0.2
    assert float(effect.transmission) == pytest.approx(m + u)
    assert float(effect.unmodulated) == pytest.approx(u / (m + u))
    assert abs(complex(effect.interference)) < 1e-15


def test_a_polarising_splitter_along_the_panel_passes_nothing_back():
    """What it passes to the panel it reflects none of; only a panel that turned light would."""
    path = PolarisedPath(polariser=Polariser(0.1), splitter=POLARISING)
    with pytest.raises(ValueError, match="no light passes"):
        path.effect()


def test_a_polarising_splitter_at_45_degrees_makes_the_panel_a_switch():
    """p at 45° excites both axes alike; s takes half of each, in opposite sign: an intensity
    modulator, whose light is (1 - cos pattern) / 2."""
    cube = BeamSplitter((1.0, 0.0), (0.0, 1.0), angle=math.pi / 4)
    effect = PolarisedPath(SourcePolarisation(1.0, math.pi / 4), splitter=cube).effect()
    assert float(effect.transmission) == pytest.approx(0.5)
    assert float(effect.unmodulated) == pytest.approx(0.5)
    assert complex(effect.interference) == pytest.approx(-1.0)
    for pattern in (0.0, 1.0, math.pi):
        light = 0.5 + 0.5 + (effect.interference * np.exp(-1j * pattern)).real
        passed = float(effect.transmission * light)
        assert passed == pytest.approx((1 - math.cos(pattern)) / 2, abs=1e-15)


def test_a_polariser_between_splitter_and_panel_is_passed_twice():
    """cos⁴ and sin⁴ of the light; the two interfere as far as they can."""
    angle = 0.25
    effect = PolarisedPath(polariser=Polariser(angle), analyser=Polariser(angle)).effect()
    c, s = math.cos(angle) ** 4, math.sin(angle) ** 4
    share = s / (c + s)
    assert float(effect.unmodulated) == pytest.approx(share)
    assert float(effect.transmission) == pytest.approx((c + s) / 2)
    assert complex(effect.interference) == pytest.approx(2 * math.sqrt(share * (1 - share)))


def elements():
    for angle, turn, extinction in product((0.0, 0.4), (0.0, 0.6), (30.0, math.inf)):
        cube = BeamSplitter((0.9, 0.2), (0.05, 0.75), angle=turn)
        for analyser in (None, Polariser(0.8, extinction)):
            yield PolarisedPath(
                SourcePolarisation(0.3, 1.0), Polariser(angle, extinction), cube, analyser
            )
            yield PolarisedPath(SourcePolarisation(), None, cube, analyser, first="reflected")


@pytest.mark.parametrize("path", list(elements()))
def test_no_light_is_made_and_the_two_cannot_interfere_beyond_their_powers(path):
    effect = path.effect()
    share = float(effect.unmodulated)
    assert 0 < float(effect.transmission) <= 1
    assert 0 <= share <= 1
    assert abs(complex(effect.interference)) <= 2 * math.sqrt(share * (1 - share)) + 1e-14


def brute_force(path: PolarisedPath, phase: np.ndarray, delay: float) -> np.ndarray:
    """Light in the far field, both polarisations of each wave carried pixel by pixel."""

    def matrix(angle, along, across):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s], [s, c]])
        return turn @ np.diag([along, across]) @ turn.T

    def polariser(one):
        along = math.sqrt(one.transmission)
        return matrix(one.angle, along, along / math.sqrt(one.extinction))

    cube = path.splitter
    passed = matrix(cube.angle, *np.sqrt(cube.transmitted))
    turned = matrix(cube.angle, *np.sqrt(cube.reflected))
    light = np.zeros(phase.shape)
    degree, angle = path.light.degree, path.light.angle
    for share, at in (((1 + degree) / 2, angle), ((1 - degree) / 2, angle + math.pi / 2)):
        wave = passed @ polariser(path.polariser) @ [math.cos(at), math.sin(at)]
        field = np.stack([wave[0] * np.exp(1j * phase), wave[1] * np.exp(1j * delay + 0 * phase)])
        field = np.einsum("ij,j...->i...", turned, field)
        if path.analyser is not None:
            field = np.einsum("ij,j...->i...", polariser(path.analyser), field)
        light += share * (np.abs(np.fft.fft2(field)) ** 2).sum(0)
    return light / phase.size


@pytest.mark.parametrize("analyser", [None, Polariser(0.7, 200.0)])
@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_the_light_behind_a_pattern_is_that_of_both_polarisations_carried_through(analyser, turn):
    cube = BeamSplitter((0.7, 0.3), (0.2, 0.6), angle=turn)
    path = PolarisedPath(SourcePolarisation(0.4, 0.2), Polariser(0.3, 40.0), cube, analyser)
    phase = np.random.default_rng(0).uniform(0, 2, (6, 8))
    delay = 1.1
    p = np.fft.fft2(np.exp(1j * phase)) / math.sqrt(phase.size)
    q = np.fft.fft2(np.exp(1j * delay) * np.ones_like(phase)) / math.sqrt(phase.size)
    passed, u, mixed = (one.numpy() for one in path.effect())
    incoherent = (1 - u) * np.abs(p) ** 2 + u * np.abs(q) ** 2
    whole = passed * (incoherent + (mixed * p.conj() * q).real)
    truth = brute_force(path, phase, delay)
    assert np.abs(whole - truth).max() <= 1e-13 * truth.max()
    # The sum in intensity is enough just where nothing brings the two polarisations together.
    enough = np.abs(passed * incoherent - truth).max() <= 1e-13 * truth.max()
    assert enough == (analyser is None and turn == 0)


def made(angle, extinction, transmission, tp, ts, rp, rs, turn, degree, at, second):
    cube = BeamSplitter((tp, ts), (rp, rs), turn)
    analyser = Polariser(second, 50.0)
    return PolarisedPath(
        SourcePolarisation(degree, at), Polariser(angle, extinction, transmission), cube, analyser
    )


def test_everything_is_differentiable_in_every_number():
    numbers = (0.3, 40.0, 0.9, 0.7, 0.3, 0.2, 0.6, 0.5, 0.4, 0.2, 0.7)
    given = [torch.tensor(n, dtype=torch.float64, requires_grad=True) for n in numbers]

    def parts(*values):
        effect = made(*values).effect()
        return (*effect[:2], effect.interference.real, effect.interference.imag)

    assert torch.autograd.gradcheck(parts, given)


def test_ideal_elements_have_finite_derivatives():
    angle, transmission, degree, extinction = (
        torch.tensor(n, dtype=torch.float64, requires_grad=True) for n in (0.0, 1.0, 1.0, math.inf)
    )
    path = PolarisedPath(
        SourcePolarisation(degree, 0.2), Polariser(angle, extinction, transmission)
    )
    sum(path.effect()[:2]).backward()
    for one in (angle, transmission, degree, extinction):
        assert torch.isfinite(one.grad)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Polariser(extinction=0.5), "extinction is 0.5"),
        (lambda: Polariser(extinction=math.nan), "extinction is nan"),
        (lambda: Polariser(transmission=0.0), "transmission is 0"),
        (lambda: Polariser(transmission=1.1), "transmission is 1.1"),
        (lambda: Polariser(math.inf), "angle is inf"),
        (lambda: SourcePolarisation(1.5), "degree is 1.5"),
        (lambda: SourcePolarisation(0.5, math.nan), "angle is nan"),
        (lambda: BeamSplitter((0.7, 0.5), (0.4, 0.5)), "of p light sum to 1.1"),
        (lambda: BeamSplitter((0.5, 0.5), (-0.1, 0.5)), "reflected is -0.1"),
        (lambda: BeamSplitter((0.5,), (0.5, 0.5)), "transmitted has 1 shares"),
        (lambda: BeamSplitter(angle=math.inf), "angle is inf"),
        (lambda: PolarisedPath(first="through"), "first is 'through'"),
        (
            lambda: BeamSplitter((torch.tensor(0.0, requires_grad=True), 0.5)),
            "transmitted is 0 and its derivative",
        ),
        (
            lambda: PolarisedPath(
                polariser=Polariser(0.0), analyser=Polariser(math.pi / 2)
            ).effect(),
            "no light passes",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make()
