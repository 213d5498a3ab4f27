"""Panel, space, lens and stop, space, sensor: against sums over nodes, limits and differences."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import positions, relative
from judges.chain_sums import direct_chain, open_power
from scipy.special import fresnel

from optics.accuracy import Budget, ToleranceError
from optics.camera import Camera, Lens, Panel
from optics.plane import Plane
from optics.psf import PolychromaticPSF, PSFOperator, modulated_psf
from optics.psf.chain_choice import CHAIN_METHODS
from optics.psf.many import PSFStack
from optics.psf.to_lens import PanelToLensPropagator, PropagatorAxis, TaperedBand
from optics.slm.modulator import Modulator

WAVELENGTH = 550e-9
SHAPE, PIXELS = (12, 16), Plane((9, 10), (8e-6, 8e-6))
Y, X = positions(9, 8e-6), positions(10, 8e-6)


def camera(stop: float = 0.4e-3, separation=0.02, **changes) -> Camera:
    """A panel of 0.24 mm by 0.32 mm; its corners reach 0.2 mm from the axis."""
    panel = Panel(SHAPE, 20e-6, fill_factor=0.8, unmodulated=0.0)
    lens = replace(Lens(0.03, 0.03 / stop, 0.8), **changes)
    return Camera(panel, lens, separation=separation)


@pytest.fixture
def phase(rng) -> np.ndarray:
    return rng.uniform(0, 2 * np.pi, SHAPE)


def light(phase: np.ndarray, *arguments, **settings) -> np.ndarray:
    return PSFOperator(*arguments, integrate=False, **settings)(phase)


CASES = {
    "on the axis": (camera(), 0.5, (0.0, 0.0)),
    "far away": (camera(), math.inf, (0.0, 0.0)),
    "off the axis": (camera(), 0.7, (1.2e-4, -2e-4)),
    "far away and off the axis": (camera(), math.inf, (-3e-4, 1e-4)),
    "very near": (camera(), 0.1, (1e-4, 1e-4)),
    "stopped down": (camera(0.15e-3), 0.5, (0.0, 1e-4)),
    "aberrated": (camera(aberrations=((4, 0, 150e-9),)), 0.5, (1e-4, 0.0)),
    "focused at infinity": (camera(focus_distance=math.inf), 0.5, (0.0, 1e-4)),
    "far from its lens": (camera(separation=0.1), 0.5, (1e-4, 0.0)),
}


SLOW_CASES = ("far away", "very near", "focused at infinity", "far from its lens")


@pytest.mark.parametrize(
    "case",
    [pytest.param(one, marks=pytest.mark.sweep if one in SLOW_CASES else ()) for one in CASES],
)
def test_every_method_keeps_its_tolerance_against_a_sum_over_nodes(case, phase):
    optics, distance, field = CASES[case]
    truth = direct_chain(optics, np.exp(1j * phase), distance, WAVELENGTH, Y, X, field=field)
    truth = truth * 64e-12
    question = (optics, distance, WAVELENGTH, PIXELS)
    for method, tol in (("chain", 1e-2), ("chain", 1e-3), ("chain, quadrature", 1e-6)):
        value = light(phase, *question, field=field, tol=tol, method=method)
        assert relative(value, truth) <= tol, method


@pytest.mark.parametrize(
    ("distance", "field"),
    [
        pytest.param(0.02, (0.0, 0.0), marks=pytest.mark.sweep),
        pytest.param(0.1, (1e-3, -1.5e-3), marks=pytest.mark.sweep),
        (math.inf, (0.0, 1.6e-3)),
    ],
)
def test_an_exact_sphere_is_that_of_the_thesis(distance, field, phase):
    """Eq. 5.1 and 5.2. Off the axis it isn't its parabola, and tilted by another angle."""
    optics = camera(separation=1e-2)
    nodes = {"across_pixel": 12, "rings": 72}
    args = (optics, np.exp(1j * phase), distance, WAVELENGTH, Y, X)
    truth = direct_chain(*args, field=field, sphere=True, **nodes) * 64e-12
    question = (optics, distance, WAVELENGTH, PIXELS)
    for method, tol in (("chain", 5e-3), ("chain, quadrature", 2e-3)):
        value = light(phase, *question, field=field, sphere=True, tol=tol, method=method)
        assert relative(value, truth) <= tol
    if any(field):
        assert relative(light(phase, *question, field=field, tol=1e-3), truth) > 2e-3


def test_a_sphere_over_a_panel_at_the_lens_is_refined_where_it_bends(phase):
    """The difference of r⁴ / 8 d³ of path, and the amplitude d / r, by a sum over fine nodes."""
    optics, distance = replace(camera(2e-3), separation=0.0), 2e-3
    n, w = np.polynomial.legendre.leggauss(20)
    half = optics.panel.active_side / 2
    y, x = ((positions(k, 20e-6)[:, None] + half * n).ravel() for k in SHAPE)
    r = np.sqrt(y[:, None] ** 2 + x**2 + distance**2)
    path = (y[:, None] ** 2 + x**2) * (1 / (r + distance) - 1 / (2 * 0.8))
    wave = distance / r * np.exp(2j * np.pi / WAVELENGTH * path)
    wave = wave * np.outer(np.tile(w * half, 12), np.tile(w * half, 16))
    wave = wave * np.kron(np.exp(1j * phase), np.ones((20, 20)))
    scale = WAVELENGTH * optics.lens.image_distance
    kernel = [np.exp(-2j * np.pi / scale * np.outer(u, s)) for u, s in ((Y, y), (X, x))]
    truth = np.abs(kernel[0] @ wave @ kernel[1].T) ** 2 / scale**2 / (192 * 4 * half**2) * 64e-12
    value = light(phase, optics, distance, WAVELENGTH, PIXELS, sphere=True, tol=1e-3)
    assert relative(value, truth) <= 1e-3
    parabola = light(phase, optics, distance, WAVELENGTH, PIXELS, tol=1e-3)
    assert relative(parabola, truth) > 3e-3


def test_the_cheapest_method_that_keeps_the_tolerance_is_taken(phase):
    question = (camera(), 0.5, WAVELENGTH, PIXELS)
    truth = light(phase, *question, tol=1e-7, method="chain, quadrature")
    for tol in (0.3, 1e-2, 1e-4, 1e-8):
        operator = PSFOperator(*question, integrate=False, tol=tol)
        assert relative(operator(phase), truth) <= max(tol, 1e-7)
        assert operator.account.error <= tol
        assert operator.account.method in CHAIN_METHODS


def test_another_method_stands_in_for_one_that_a_pattern_leaves_too_little_light(
    phase, monkeypatch
):
    """Unless that one was asked for by its name."""
    question = (camera(), 0.5, WAVELENGTH, PIXELS)
    truth = direct_chain(camera(), np.exp(1j * phase), 0.5, WAVELENGTH, Y, X) * 64e-12

    def dim(*given):
        raise ToleranceError("the window gets so little of the light")

    for method in (None, "chain"):
        operator = PSFOperator(*question, integrate=False, tol=1e-4, method=method)
        monkeypatch.setattr(operator.engine, "intensity", dim)
        if method:
            with pytest.raises(ToleranceError, match="so little"):
                operator(phase)
        else:
            assert relative(operator(phase), truth) <= 1e-4


def test_whole_pixels_get_the_mean_of_their_points(phase):
    """Gauss-Legendre points in every pixel, each by the judge."""
    n, w = np.polynomial.legendre.leggauss(6)
    y, x = ((c[:, None] + 4e-6 * n).ravel() for c in (Y, X))
    density = direct_chain(camera(), np.exp(1j * phase), 0.5, WAVELENGTH, y, x)
    truth = np.einsum("iajb,a,b->ij", density.reshape(9, 6, 10, 6), w / 2, w / 2) * 64e-12
    value = PSFOperator(camera(), 0.5, WAVELENGTH, PIXELS, tol=1e-5)(phase)
    assert relative(value, truth) <= 1e-5


def test_a_panel_that_touches_its_lens_is_the_limit_of_one_that_is_close(phase):
    """A wide stop: what is left is the change of the way, of the order separation / focus."""
    near, at = camera(2e-3, separation=2e-5), camera(2e-3, separation=0.0)
    value = light(phase, near, 0.5, WAVELENGTH, PIXELS, tol=1e-3)
    assert relative(value, light(phase, at, 0.5, WAVELENGTH, PIXELS, tol=1e-4)) <= 2e-3


def test_a_stop_wider_than_all_light_is_the_collapsed_camera(phase):
    question = (camera(4e-3, separation=0.01), 0.5, WAVELENGTH, PIXELS)
    one = light(phase, *question, tol=2e-2, method="collapsed")
    assert relative(light(phase, *question, tol=2e-3, method="chain"), one) <= 1e-2


@pytest.mark.parametrize("method", ["chain", "chain, quadrature"])
def test_an_object_at_infinity_is_the_limit_of_a_far_one(method, phase):
    settings = {"field": (1e-4, 2e-4), "tol": 1e-3, "method": method}
    far = light(phase, camera(), 1e9, WAVELENGTH, PIXELS, **settings)
    assert relative(far, light(phase, camera(), math.inf, WAVELENGTH, PIXELS, **settings)) <= 1e-4


def test_a_field_changes_nothing_for_a_panel_at_the_lens(phase):
    at = camera(separation=0.0)
    one = light(phase, at, 0.5, WAVELENGTH, PIXELS)
    assert np.array_equal(light(phase, at, 0.5, WAVELENGTH, PIXELS, field=(1e-3, 2e-3)), one)


def leaves(values: dict[str, float]) -> dict[str, torch.Tensor]:
    return {
        name: torch.tensor(value, dtype=torch.float64, requires_grad=True)
        for name, value in values.items()
    }


LENGTHS = {
    "focal_length": 0.03,
    "f_number": 0.03 / 0.25e-3,
    "focus_distance": 0.8,
    "separation": 0.02,
    "distance": 0.6,
    "wavelength": 550e-9,
    "field_y": 1e-4,
    "field_x": -5e-5,
    "centre": 1e-5,
    "aberration": 40e-9,
}


def weighed(v: dict, weights: torch.Tensor, pattern: torch.Tensor, **settings) -> torch.Tensor:
    lens = Lens(
        v["focal_length"],
        v["f_number"],
        v["focus_distance"],
        aberrations=((3, 1, v["aberration"]),),
    )
    optics = Camera(camera().panel, lens, separation=v["separation"])
    operator = PSFOperator(
        optics,
        v["distance"],
        v["wavelength"],
        Plane((9, 10), (8e-6, 8e-6), (v["centre"], 0.0)),
        field=(v["field_y"], v["field_x"]),
        integrate=False,
        **settings,
    )
    return (operator(pattern) * weights).sum()


@pytest.mark.parametrize("sphere", [False, True])
def test_derivatives_in_every_length_are_differences(sphere, phase, rng):
    weights = torch.from_numpy(rng.uniform(size=(9, 10)))
    pattern = torch.from_numpy(phase)
    settings = {"tol": 1e-5, "method": "chain, quadrature", "sphere": sphere}
    v = leaves(LENGTHS)
    weighed(v, weights, pattern, **settings).backward()
    for name, value in LENGTHS.items():
        step = 1e-10 if name == "aberration" else 2e-5 * abs(value)
        ends = [
            float(weighed({**LENGTHS, name: value + s * step}, weights, pattern, **settings))
            for s in (1, -1)
        ]
        difference = (ends[0] - ends[1]) / (2 * step)
        assert float(v[name].grad) == pytest.approx(difference, rel=1e-3), name


def test_derivatives_on_a_grid_are_those_of_the_quadrature(phase, rng):
    weights, pattern = torch.from_numpy(rng.uniform(size=(9, 10))), torch.from_numpy(phase)
    found = []
    for method, tol in (("chain, quadrature", 1e-6), ("chain", 3e-4)):
        v, p = leaves(LENGTHS), pattern.clone().requires_grad_()
        weighed(v, weights, p, tol=tol, method=method).backward()
        found.append([*(float(one.grad) for one in v.values()), p.grad.numpy()])
    for name, exact, value in zip([*LENGTHS, "phase"], *found, strict=True):
        assert relative(value, exact) <= 2e-2, name


@pytest.mark.parametrize("method", ["chain", "chain, quadrature"])
def test_derivatives_in_the_pattern_are_differences(method, phase, rng):
    pattern = torch.from_numpy(phase).requires_grad_()
    strength = torch.from_numpy(rng.uniform(0.2, 0.9, SHAPE)).requires_grad_()
    weights = torch.from_numpy(rng.uniform(size=(9, 10)))
    operator = PSFOperator(
        camera(), 0.5, WAVELENGTH, PIXELS, integrate=False, tol=1e-3, method=method
    )
    (operator(pattern, strength) * weights).sum().backward()
    for leaf in (pattern, strength):
        way, step = torch.from_numpy(rng.normal(size=SHAPE)), 1e-3
        ends = []
        for sign in (1, -1):
            moved = [
                p.detach() + (sign * step * way if p is leaf else 0) for p in (pattern, strength)
            ]
            ends.append(float((operator(*moved) * weights).sum()))
        difference = (ends[0] - ends[1]) / (2 * step)
        assert float((leaf.grad * way).sum()) == pytest.approx(difference, rel=2e-3, abs=1e-7)


def test_a_pattern_at_infinity_has_derivatives_without_gaps(phase):
    v = leaves({"separation": 0.02, "wavelength": 550e-9})
    operator = PSFOperator(
        Camera(camera().panel, camera().lens, separation=v["separation"]),
        math.inf,
        v["wavelength"],
        PIXELS,
        tol=1e-2,
    )
    operator(torch.from_numpy(phase)).max().backward()
    assert all(math.isfinite(float(one.grad)) for one in v.values())


def test_batches_amplitudes_and_unmodulated_light(phase, rng):
    optics = camera()
    strength = rng.uniform(0, 1, SHAPE)
    settings = {"integrate": False, "tol": 1e-4}
    operator = PSFOperator(optics, 0.5, WAVELENGTH, PIXELS, unmodulated=0.1, **settings)
    both = operator(np.stack([phase, 0 * phase]), strength)
    truth = [
        direct_chain(optics, strength * np.exp(1j * p), 0.5, WAVELENGTH, Y, X) * 64e-12
        for p in (phase, 0 * phase)
    ]
    assert relative(both[0], 0.9 * truth[0] + 0.1 * truth[1]) <= 1e-4
    assert relative(both[1], truth[1]) <= 1e-4
    # Six times the amplitude is 36 times the light.
    assert relative(operator(phase, 6 * strength), 36 * both[0]) <= 1e-6


def test_a_modulators_light_goes_through_the_chain(phase):
    panel = replace(camera().panel, unmodulated=0.1)
    optics = replace(camera(), panel=panel)
    modulator = Modulator(panel, WAVELENGTH)
    grey = np.round(phase / (2 * np.pi) * 255).astype(np.uint8)
    operator = PSFOperator(optics, 0.5, WAVELENGTH, PIXELS, unmodulated=0.0, tol=1e-3)
    value = modulated_psf(operator, modulator, modulator.still_fields(torch.from_numpy(grey)))
    assert torch.isfinite(value).all()
    assert 0 < float(value.sum()) < 1


def test_colours_add_behind_a_chain(phase):
    waves, weights = (500e-9, 600e-9), (0.25, 0.75)
    psf = PolychromaticPSF(camera(), 0.5, waves, weights, PIXELS, tol=1e-2, field=(1e-4, 0.0))
    parts = [
        w * PSFOperator(camera(), 0.5, c, PIXELS, tol=1e-2, field=(1e-4, 0.0))(phase)
        for c, w in zip(waves, weights, strict=True)
    ]
    assert relative(psf(np.stack([phase, phase])), sum(parts)) <= 1e-6


@pytest.mark.parametrize("away", [0.0, 3e-3])
def test_light_is_lost_at_the_stop_off_the_axis(away):
    """A large Fresnel number and no pattern: what passes is the shadow's overlap with the stop."""
    panel = Panel((101, 101), 40e-6, fill_factor=1.0, unmodulated=0.0)
    optics = Camera(panel, Lens(0.1, 0.1 / 3e-3, 1.0), separation=0.05)
    window = Plane((16, 16), (20e-6, 20e-6))
    operator = PSFOperator(optics, math.inf, WAVELENGTH, window, field=(0.0, away), tol=3e-2)
    seen = operator.light_budget()
    line = (np.arange(4000) + 0.5) / 4000 * 3e-3 - 1.5e-3
    inside = np.hypot(line[:, None], line) <= 1.5e-3
    lit = np.abs(line + 0.05 * away / optics.lens.image_distance) <= 2.02e-3
    share = (inside & lit).sum() / inside.sum()
    assert (share < 0.9) == bool(away)
    assert seen.through_stop == pytest.approx(share, abs=5e-3)
    assert seen.vignetting == pytest.approx(share, abs=5e-3)
    assert seen.panel == pytest.approx(4.04e-3**2 / (math.pi * 1.5e-3**2), rel=1e-3)
    assert seen.through_stop + seen.blocked == pytest.approx(seen.panel)
    assert seen.window == pytest.approx(float(operator().sum()), rel=1e-6)
    assert seen.window <= 1.01 * seen.through_stop


def test_all_light_behind_the_stop_arrives_somewhere(phase):
    """A window of all the orders gets what passes, and what is blocked doesn't."""
    optics = camera(0.3e-3, separation=0.01)
    wide = Plane((130, 130), (40e-6, 40e-6))
    operator = PSFOperator(optics, 0.5, WAVELENGTH, wide, tol=1e-2)
    seen = operator.light_budget(phase)
    assert seen.window == pytest.approx(seen.through_stop, rel=2e-2)
    assert seen.blocked > 0.1 * seen.panel
    assert open_power(optics) * seen.panel == pytest.approx(192 * 20e-6**2 * 0.8, rel=1e-3)


def test_light_of_a_panel_at_the_lens_is_told_by_its_open_pixels(phase):
    at = camera(0.3e-3, separation=0.0)
    seen = PSFOperator(at, 0.5, WAVELENGTH, PIXELS).light_budget(phase)
    assert seen.through_stop == pytest.approx(1.0, rel=1e-6)
    assert seen.vignetting == 1.0
    with pytest.raises(ValueError, match="lens alone"):
        PSFOperator(at.lens, 0.5, WAVELENGTH, PIXELS).light_budget()


def test_a_propagator_is_fresnels_integral(rng):
    """Two strips of light 0.1 mm wide, after 20 mm, by Fresnel's integrals C and S."""
    pitch, side, bend = 0.1e-3, 0.09e-3, WAVELENGTH * 0.02
    values = rng.normal(size=2) + 1j * rng.normal(size=2)
    band = TaperedBand(-1.5e6, 1.5e6, 4e4, 5.0)
    axis = PropagatorAxis(2, pitch, side, 400, 61, 400, bend, -0.3e-3 + 1e-5, band)
    one = PropagatorAxis(1, pitch, side, 400, 1, 400, bend, 0.0, band)
    propagator = PanelToLensPropagator(axis, one, torch.complex128)
    field = propagator(torch.from_numpy(values[:, None]))
    stretch = math.sqrt(2 / bend)

    def strip(c: np.ndarray, middle: float) -> np.ndarray:
        low, high = (
            np.stack(fresnel(stretch * (middle + h - c)))[::-1] for h in (-side / 2, side / 2)
        )
        c_s = high - low
        return (c_s[0] + 1j * c_s[1]) / np.sqrt(2j)

    c = axis.first_sample_position + axis.step * np.arange(61)
    truth = values[0] * strip(c, -pitch) + values[1] * strip(c, 0.0)
    assert relative(field.numpy()[:, 0], truth * strip(np.zeros(1), 0.0)) <= 1e-3


@pytest.mark.parametrize("shape", [(5, 6), (7, 8)])
def test_a_propagators_adjoint_is_its_conjugate_transpose(shape, rng):
    """Also where frequencies turn around more than once, in the panel's and the lens' samples."""
    band = TaperedBand(-2.3e5, 1.7e5, 1e3, 4.0)
    y = PropagatorAxis(shape[0], 20e-6, 18e-6, 9, 12, 15, 1e-9, -1e-4, band)
    x = PropagatorAxis(shape[1], 20e-6, 18e-6, 60, 11, 140, 1e-9, 2e-5, band)
    propagator = PanelToLensPropagator(y, x, torch.complex128)
    panel = torch.from_numpy(rng.normal(size=shape) + 1j * rng.normal(size=shape))
    lens = torch.from_numpy(rng.normal(size=(12, 11)) + 1j * rng.normal(size=(12, 11)))
    forward = propagator(panel)
    back = propagator.adjoint(lens)
    assert complex((lens.conj() * forward).sum()) == pytest.approx(
        complex((back.conj() * panel).sum()), rel=1e-12
    )


def test_a_stack_gives_what_its_operators_give(phase, rng):
    distances, waves, fields = (0.4, math.inf), (500e-9, 600e-9), ((0.0, 0.0), (1e-4, -1e-4))
    optics = replace(camera(), panel=replace(camera().panel, unmodulated=0.05))
    stack = PSFStack(optics, distances, waves, PIXELS, fields=fields, tol=1e-2, method="chain")
    phases, strength = np.stack([phase, 0.5 * phase]), rng.uniform(0, 2, SHAPE)
    value = stack(phases, strength)
    assert value.shape == (2, 2, 2, 9, 10)
    # Three of the eight tell all axes apart.
    for i, k, j in ((0, 0, 1), (1, 0, 0), (0, 1, 0)):
        question = optics, distances[i], waves[k], PIXELS
        one = PSFOperator(*question, field=fields[j], tol=1e-2, method="chain")
        assert relative(value[i, k, j], one(phases[k], strength)) <= 1e-2


@pytest.mark.parametrize("memory", [4 << 30, 1 << 22])
def test_a_stack_has_derivatives_with_little_memory(memory, phase, rng):
    weights = torch.from_numpy(rng.uniform(size=(2, 1, 1, 9, 10)))
    pattern = torch.from_numpy(phase).requires_grad_()
    stack = PSFStack(
        camera(), (0.4, 2.0), (WAVELENGTH,), PIXELS, tol=1e-2, budget=Budget(memory=memory)
    )
    (stack(pattern) * weights).sum().backward()
    way, step = torch.from_numpy(rng.normal(size=SHAPE)), 1e-2
    with torch.no_grad():
        ends = [float((stack(pattern + s * step * way) * weights).sum()) for s in (1, -1)]
    difference = (ends[0] - ends[1]) / (2 * step)
    assert float((pattern.grad * way).sum()) == pytest.approx(difference, rel=1e-2)


def test_what_cannot_be_asked_is_named(phase):
    question = (camera(), 0.5, WAVELENGTH, PIXELS)
    with pytest.raises(ValueError, match="choose one of collapsed, chain, 'chain, quad"):
        PSFOperator(*question, method="sampled")
    with pytest.raises(ValueError, match="field is"):
        PSFOperator(*question, field=(0.0, math.nan))
    with pytest.raises(ValueError, match="a lens has none"):
        PSFOperator(camera().lens, 0.5, WAVELENGTH, PIXELS, sphere=True)
    with pytest.raises(ValueError, match="sine"):
        PSFOperator(*question, field=(0.0, 0.05), sphere=True)
    with pytest.raises(ValueError, match="thin lenses without aberrations"):
        PSFOperator(camera(aberrations=((4, 0, 1e-7),)), *question[1:], method="collapsed", tol=0.5)
    with pytest.raises(ValueError, match="distances is empty"):
        PSFStack(camera(), (), (WAVELENGTH,), PIXELS)
    stack = PSFStack(camera(), (0.5,), (WAVELENGTH,), PIXELS, tol=1e-2)
    with pytest.raises(ValueError, match="each of the 1"):
        stack(np.stack([phase, phase]))


def test_what_cannot_be_kept_is_refused_before_anything_is_made():
    thesis = Camera(Panel(), Lens(0.1, 5.6, 2.0), separation=0.05)
    window = thesis.sensor.window_plane((256, 256))
    with pytest.raises(ToleranceError):
        PSFOperator(thesis, 1.0, WAVELENGTH, window, tol=1e-12)
    with pytest.raises(ToleranceError):
        PSFOperator(thesis, 1.0, WAVELENGTH, window, tol=1e-3, budget=Budget(memory=10 << 20))


def test_a_window_in_the_dark_is_dark_by_its_own_measure(phase):
    """The panel's shadow misses the stop: a part in 1e11 of the light arrives, and is right."""
    question = (camera(separation=0.1), math.inf, WAVELENGTH, PIXELS)
    value = light(phase, *question, field=(0.0, 2e-3), tol=1e-3)
    nodes = {"across_pixel": 12, "rings": 80}
    args = (question[0], np.exp(1j * phase), math.inf, WAVELENGTH, Y, X)
    truth = direct_chain(*args, field=(0.0, 2e-3), **nodes) * 64e-12
    assert truth.sum() < 1e-10
    assert relative(value, truth) <= 1e-3


def test_numbers_that_change_after_planning_are_named(phase):
    v = leaves({"separation": 0.02})
    optics = Camera(camera().panel, camera().lens, separation=v["separation"])
    operator = PSFOperator(optics, 0.5, WAVELENGTH, PIXELS, tol=1e-2)
    with torch.no_grad():
        v["separation"] += 0.01
    with pytest.raises(ValueError, match="separation has changed"):
        operator(torch.from_numpy(phase))
