"""Patterns of several foci against formulas, pixel counts, and sums over the pupil."""

import itertools
import math

import numpy as np
import pytest
import torch
from scipy.integrate import quad
from sweeps import some

from optics.camera import Panel
from optics.patterns import (
    even_vergences,
    focal_sweep_axicon,
    fresnel_lens,
    lattice_focal_lens,
    multi_focus_rings,
)

WAVE = 520e-9
PANEL = Panel(shape=(96, 128), pitch=40e-6)
SHAPES = [(12, 16), (13, 16), (12, 17), (13, 17)]


def squared_radius(panel: Panel = PANEL) -> np.ndarray:
    """From the centre of the pixels, m²."""
    y, x = ((np.arange(n) - (n - 1) / 2) * panel.pitch for n in panel.shape)
    return y[:, None] ** 2 + x**2


def on_axis(phase: torch.Tensor, depth: float, panel: Panel = PANEL) -> float:
    """The light on the axis, of that in focus, of a point at a depth; by the sum over pixels."""
    wave = np.exp(1j * (phase.numpy() + math.pi / WAVE * depth * squared_radius(panel)))
    return float(abs(wave.mean()) ** 2)


def contrast(phase: torch.Tensor, depth: float, shift: int, panel: Panel = PANEL) -> complex:
    """The transfer function, of the pupil's area, at a frequency along x: wave times shifted."""
    wave = np.exp(1j * (phase.numpy() + math.pi / WAVE * depth * squared_radius(panel)))
    return complex((wave[:, shift:] * wave[:, :-shift].conj()).sum() / wave.size)


def vergence_along_x(phase: torch.Tensor, panel: Panel) -> tuple[np.ndarray, np.ndarray]:
    """Radius and depth in focus on the right of the middle row, by differences of the phase."""
    rows, columns = panel.shape
    assert (rows % 2, columns % 2) == (1, 1)
    x = np.arange(columns // 2 + 1) * panel.pitch
    ray = phase.numpy()[rows // 2, columns // 2 :]
    # A difference is that of squares of the radii times the depth in the middle.
    return (x[1:] + x[:-1]) / 2, -WAVE / math.pi * np.diff(ray) / np.diff(x**2)


def test_even_vergences_are_the_middles_of_equal_parts():
    assert even_vergences(2.0, 0.0, 4) == pytest.approx((1.75, 1.25, 0.75, 0.25))
    assert even_vergences(1.0, -1.0, 1) == (0.0,)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    "pattern",
    [
        lambda panel: multi_focus_rings(panel, (2.0, 0.3, 1.1), WAVE, 3),
        lambda panel: focal_sweep_axicon(panel, 2.0, 0.0, WAVE, 2),
    ],
)
def test_round_patterns_equal_their_mirror_images_bit_for_bit(pattern, shape):
    phase = pattern(Panel(shape=shape, pitch=100e-6))
    assert phase.shape == shape
    assert phase.dtype == torch.float64
    assert torch.equal(phase, phase.flip(0))
    assert torch.equal(phase, phase.flip(1))


def test_rings_of_one_focus_are_a_lens_about_the_centre_of_the_pixels():
    centre = (-PANEL.pitch / 2, -PANEL.pitch / 2)
    lens = fresnel_lens(PANEL, 1 / (1.7 - 0.5), WAVE, centre)
    rings = multi_focus_rings(PANEL, [1.7], WAVE, 10, focus=0.5)
    assert np.allclose(rings.numpy(), lens.numpy(), atol=1e-9)


def matches(phase: torch.Tensor, vergence: np.ndarray, panel: Panel) -> np.ndarray:
    """Where a pattern is that of lenses, but for whole waves."""
    lenses = np.exp(-1j * math.pi / WAVE * vergence * squared_radius(panel))
    return np.abs(np.exp(1j * phase.numpy()) - lenses) < 1e-6


def test_rings_have_equal_areas_on_the_panel():
    """Pixels in the order of their radii, in 40 equal groups."""
    panel, vergences = Panel(), np.linspace(0.5, 2.0, 40)
    order = squared_radius(panel).argsort(axis=None, kind="stable")
    ring = np.empty(order.size, dtype=int)
    ring[order] = np.arange(order.size) * 40 // order.size
    truth = vergences[ring.reshape(panel.shape)]
    phase = multi_focus_rings(panel, vergences, WAVE, 40, order="cyclic")
    assert matches(phase, truth, panel).mean() > 0.999


def test_rings_within_a_radius_have_equal_areas_there():
    """Within the panel's shorter side they are those of a circle: radii go as roots."""
    panel, vergences = Panel(shape=(541, 961), pitch=16e-6), np.linspace(0.1, 1.0, 8)
    share = squared_radius(panel) / 4e-3**2 * 8
    truth = vergences[np.minimum(share, 7).astype(int)]
    phase = multi_focus_rings(panel, vergences, WAVE, 8, radius=4e-3, order="cyclic")
    off_the_edges = (np.abs(share % 1 - 0.5) < 0.49) | (share > 8)
    assert matches(phase, truth, panel)[off_the_edges].all()


def test_the_phase_jumps_by_half_a_wave_at_most_between_rings():
    panel = Panel(shape=(601, 601), pitch=4e-6)
    phase = multi_focus_rings(panel, (3.0, 0.0, 1.5), WAVE, 12).numpy()
    slope = 2 * math.pi / WAVE * 3.0 * 300 * panel.pitch**2
    largest = max(np.abs(np.diff(phase, axis=axis)).max() for axis in (0, 1))
    assert 0.5 * math.pi < largest < math.pi + 2 * slope < 1.5 * math.pi


def test_every_focus_of_the_rings_is_in_focus():
    """By the light on the axis: a third of the field each, and hardly any between them."""
    foci = (3.0, 1.0, 2.0)
    phase = multi_focus_rings(PANEL, foci, WAVE, 3, focus=0.5, order="cyclic")
    # The sum over the pupil sees the lens' own focus as a shift of depth.
    seen = {depth: on_axis(phase, depth - 0.5) for depth in (*foci, 4.5, -1.0)}
    for depth in foci:
        assert seen[depth] == pytest.approx(1 / 9, rel=0.4)
    assert max(seen[4.5], seen[-1.0]) < 0.2 / 9


def orders(order: str, generator: torch.Generator | None = None) -> list[float]:
    """The depths in focus of 20 rings of five foci, from the centre outwards."""
    panel = Panel(shape=(601, 601), pitch=16e-6)
    foci = (0.2, 0.4, 0.6, 0.8, 1.0)
    phase = multi_focus_rings(panel, foci, WAVE, 20, 0.0, 4.8e-3, order, generator)
    r, vergence = vergence_along_x(phase, panel)
    edges = 4.8e-3 * np.sqrt(np.arange(21) / 20)
    return [
        round(float(np.median(vergence[(r > low) & (r < high)])), 6)
        for low, high in itertools.pairwise(edges)
    ]


def test_foci_take_turns_in_the_order_asked_for():
    assert orders("cyclic") == [0.2, 0.4, 0.6, 0.8, 1.0] * 4
    # A step of 3 is nearest to the golden ratio's share of five.
    assert orders("interleaved") == [0.2, 0.8, 0.4, 1.0, 0.6] * 4


def test_random_orders_come_from_the_generator_and_use_every_focus_alike():
    seeds = (1, 1, 2)
    one, same, other = (orders("random", torch.Generator().manual_seed(seed)) for seed in seeds)
    assert one == same != other
    for cycle in range(4):
        assert sorted(one[5 * cycle : 5 * cycle + 5]) == [0.2, 0.4, 0.6, 0.8, 1.0]


@pytest.mark.parametrize("sweeps", [1, 2, 5])
def test_a_focal_sweep_goes_to_and_fro_evenly_in_the_radius(sweeps):
    panel = Panel(shape=(601, 1001), pitch=16e-6)
    phase = focal_sweep_axicon(panel, 1.8, 0.2, WAVE, sweeps, focus=0.5, radius=6e-3)
    r, vergence = vergence_along_x(phase, panel)
    turns = np.minimum(r / 6e-3, 1) * sweeps
    truth = 1.8 - 1.6 * np.where(turns % 2 <= 1, turns % 2, 2 - turns % 2) - 0.5
    # Differences over the turning points are neither side's.
    away = np.abs(turns - np.rint(turns)) > sweeps * panel.pitch / 6e-3
    assert np.allclose(vergence[away], truth[away], atol=2e-3)
    assert np.allclose(vergence[r > 6.1e-3], truth[-1], atol=2e-3)


def test_the_phase_of_a_focal_sweep_is_the_integral_of_its_slope():
    """Against adaptive quadrature, in the panel's corner and on the way to it."""
    panel = Panel()
    corner = 0.5 * math.hypot(*panel.shape) * panel.pitch
    phase = focal_sweep_axicon(panel, 2.0, 0.0, WAVE, 6)
    legs = corner * np.arange(1, 6) / 6

    def slope(r: float) -> float:
        turns = 6 * r / corner % 2
        return (2 - 2 * min(turns, 2 - turns)) * 2 * r

    for row, column in ((0, 0), (200, 333), (539, 1919), (540, 960)):
        r = math.hypot(row - 539.5, column - 959.5) * panel.pitch
        path = quad(slope, 0, r, points=legs[legs < r], epsabs=1e-20, epsrel=1e-13)[0]
        assert float(phase[row, column]) == pytest.approx(-math.pi / WAVE * path, abs=1e-6)


def test_one_sweep_even_in_area_is_the_quartic_axicon_within_a_circle():
    radius = 48 * PANEL.pitch
    phase = focal_sweep_axicon(PANEL, 3.0, 1.0, WAVE, 1, radius=radius, even_in="area").numpy()
    area = squared_radius()
    inside = area < radius**2
    truth = -math.pi / WAVE * (3.0 * area - (3.0 - 1.0) * area**2 / (2 * radius**2))
    assert np.allclose(phase[inside], truth[inside], atol=1e-5)


def test_a_sweep_even_in_area_gives_both_halves_of_the_range_half_the_pixels():
    panel = Panel(shape=(601, 1001), pitch=16e-6)
    phase = focal_sweep_axicon(panel, 2.0, 0.0, WAVE, 1, even_in="area")
    r, vergence = vergence_along_x(phase, panel)
    half = math.sqrt(np.median(squared_radius(panel)))
    assert np.interp(half, r, vergence) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("sweeps", some([2, 1, 3]))
def test_the_contrast_of_a_focal_sweep_is_that_of_stationary_phase(sweeps):
    """wavelength R / (s range) of the pupil's area, on both sides, at near and far depths alike;
    in the mean, about which the contrast ripples. A lens has hardly any where it isn't in focus."""
    panel = Panel(shape=(256, 256), pitch=30e-6)
    radius, side = 128 * panel.pitch, 256 * panel.pitch
    phase = focal_sweep_axicon(panel, 2.0, -2.0, WAVE, sweeps, radius=radius)
    depths = np.linspace(-1.6, 1.6, 32)
    seen = np.zeros(32)
    for shift in (6, 8, 12, 17, 24):
        truth = 2 * WAVE * radius / (shift * panel.pitch * 4.0) / side**2
        seen += np.array([contrast(phase, one, shift, panel).real for one in depths]) / truth / 5
    assert seen[:16].mean() == pytest.approx(1, abs=0.2)
    assert seen[16:].mean() == pytest.approx(1, abs=0.2)
    lens = multi_focus_rings(panel, [0.0], WAVE, 1)
    assert abs(contrast(lens, 1.6, 12, panel)) < 0.3 * 2 * truth


def test_all_rectangles_of_a_lattice_share_the_axis_and_have_foci_in_even_steps():
    phase = lattice_focal_lens(PANEL, 2.0, 0.0, WAVE, 4, 2, focus=0.5).numpy()
    for number, depth in enumerate(1.875 - 0.25 * np.arange(8)):
        row, column = divmod(number, 4)
        cell = np.s_[48 * row : 48 * row + 48, 32 * column : 32 * column + 32]
        lens = fresnel_lens(PANEL, 1 / (depth - 0.5), WAVE)
        assert np.allclose(phase[cell], lens.numpy()[cell], atol=1e-9)


def test_a_lattice_that_does_not_divide_the_panel_differs_by_a_pixel():
    panel = Panel(shape=(7, 1), pitch=1e-3)
    phase = lattice_focal_lens(panel, 1e-3, 0.0, WAVE, 1, 3)
    y = (np.arange(7) - 3) * panel.pitch
    depth = -phase.numpy()[:, 0] * WAVE / math.pi / np.where(y, y, 1) ** 2
    heights = np.unique(np.delete(depth, 3).round(9), return_counts=True)[1]
    # Without the row on the axis, whose phase is 0 for every lens.
    assert sorted(heights) == [1, 2, 3]


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: even_vergences(0.0, 2.0, 3), "near is 0 dioptres; it must be more than far, 2"),
        (lambda: even_vergences(math.inf, 0.0, 3), r"near is inf dioptres; .*infinity is 0"),
        (lambda: even_vergences(2.0, 0.0, 0), "count is 0; choose 1 or more"),
        (lambda: multi_focus_rings(PANEL, [], WAVE), "vergences is empty"),
        (lambda: multi_focus_rings(PANEL, [math.nan], WAVE), "vergences has nan; .* finite"),
        (lambda: multi_focus_rings(PANEL, [1, 2, 3], WAVE, 2), "rings is 2; choose 3 or more"),
        (lambda: multi_focus_rings(PANEL, [1], WAVE, 41), "rings is 41; choose at most 40"),
        (lambda: multi_focus_rings(PANEL, [1], WAVE, 25, 0, 1e-3), "rings is 25; .* at most 12"),
        (lambda: multi_focus_rings(PANEL, [1], WAVE, 0), "rings is 0; choose 1 or more"),
        (lambda: multi_focus_rings(PANEL, [1], 0.0), "wavelength is 0 m"),
        (lambda: multi_focus_rings(PANEL, [1], WAVE, 4, math.inf), "focus is inf dioptres"),
        (lambda: multi_focus_rings(PANEL, [1], WAVE, 4, 0, -1.0), "radius is -1 m"),
        (lambda: multi_focus_rings(PANEL, [1], WAVE, 4, order="any"), "order is 'any'; choose"),
        (lambda: multi_focus_rings(PANEL, [1], WAVE, 4, order="random"), "generator is None"),
        (
            lambda: multi_focus_rings(PANEL, [1, 9], WAVE, 4, 1.0),
            r"vergences has one that changes .* choose depths within 2.53 dioptres of focus, 1$",
        ),
        (lambda: focal_sweep_axicon(PANEL, 1.0, 1.0, WAVE), "near is 1 dioptres"),
        (lambda: focal_sweep_axicon(PANEL, 1.0, 0.0, WAVE, 0), "sweeps is 0; choose 1 to 40"),
        (lambda: focal_sweep_axicon(PANEL, 1.0, 0.0, WAVE, 41), "sweeps is 41; choose 1 to 40"),
        (
            lambda: focal_sweep_axicon(PANEL, 1.0, 0.0, WAVE, even_in="light"),
            "even_in is 'light'; choose 'radius' or 'area'",
        ),
        (
            lambda: focal_sweep_axicon(PANEL, 9.0, 0.0, WAVE),
            "near 9 or far 0 changes .* choose depths within 2.53 dioptres of focus, 0$",
        ),
        (lambda: lattice_focal_lens(PANEL, 0.0, 1.0, WAVE), "near is 0 dioptres"),
        (lambda: lattice_focal_lens(PANEL, 1.0, math.nan, WAVE), "far is nan dioptres"),
        (lambda: lattice_focal_lens(PANEL, 1.0, 0.0, WAVE, 0), "columns is 0; choose 1 to 128"),
        (lambda: lattice_focal_lens(PANEL, 1.0, 0.0, WAVE, 4, 97), "rows is 97; choose 1 to 96"),
        (
            lambda: lattice_focal_lens(PANEL, 12.0, 0.0, WAVE),
            "near 12 or far 0 changes .* choose depths within 2.53 dioptres of focus, 0$",
        ),
    ],
)
def test_what_cannot_be_shown_is_refused_with_the_limit(ask, words):
    with pytest.raises(ValueError, match=words):
        ask()


@pytest.mark.parametrize(
    "pattern",
    [
        lambda limit: multi_focus_rings(PANEL, [1.0 - limit, 1.0 + limit], WAVE, 9, 1.0),
        lambda limit: focal_sweep_axicon(PANEL, 1.0 + limit, 1.0 - limit, WAVE, 3, 1.0),
        lambda limit: lattice_focal_lens(PANEL, 1.0 + limit, 1.0 - limit, WAVE, 8, 4, 1.0),
    ],
)
def test_the_limit_of_a_refusal_can_be_shown(pattern):
    pattern(2.53)
