"""The bound over depth against closed forms, and against patterns of many kinds by direct sums."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from optics.camera import Camera, Lens, Panel, Sensor
from optics.camera.stop import Circle, Polygon, Stop, rectangle
from optics.edof.depth_bound import (
    convex_pupil,
    known_depth_bound,
    overlap_integrals,
    rms_transfer_limit,
)
from optics.edof.dioptres import midpoint_dioptres
from optics.edof.panel_transfer import FullTransfer
from optics.edof.pattern_rating import rate_pattern
from optics.edof.picture_spectrum import NATURAL_SPECTRUM, FrequencyGrid
from optics.edof.transfer_design import TransferDesign

WAVELENGTH = 520e-9
STUDY = Camera(Panel(), Lens(0.1, 5.6, math.inf), Sensor(pitch=3.45e-6))
WIDTH, HEIGHT = 1920 * 8e-6, 1080 * 8e-6


def _rectangle_integrals(sy, sx, height, width):
    """Area of the overlap of two rectangles, and the integral of its squared chord, in closed form.

    The overlap is a rectangle a x b, and its chord across a direction is a trapezoid: the
    convolution of two boxes.
    """
    b, a = max(height - abs(sy), 0), max(width - abs(sx), 0)
    length = math.hypot(sy, sx)
    long, short = sorted((a * abs(sx) / length, b * abs(sy) / length), reverse=True)
    top = a * b / long if long else 0.0
    return a * b, top**2 * (long - short + 2 * short / 3)


@pytest.mark.parametrize("rule", ["gauss-legendre", "midpoint"])
def test_overlap_of_rectangles_has_its_closed_form(rule):
    shifts = [(0.0, 1e-3), (2e-3, 0.0), (3e-3, 5e-3), (-8e-3, 1e-3), (1e-3, -14e-3), (9e-3, 1e-3)]
    sy, sx = torch.tensor(shifts, dtype=torch.float64).T
    areas, squares = overlap_integrals(convex_pupil(STUDY), sy, sx, nodes=400, rule=rule)
    for shift, area, square in zip(shifts, areas, squares, strict=True):
        expected = _rectangle_integrals(*shift, HEIGHT, WIDTH)
        assert float(area) == pytest.approx(expected[0], rel=2e-4, abs=1e-14)
        assert float(square) == pytest.approx(expected[1], rel=2e-4, abs=1e-17)


def test_overlap_of_discs_is_a_lens():
    lens = replace(STUDY.lens, f_number=20.0)
    pupil, radius = convex_pupil(replace(STUDY, lens=lens)), 2.5e-3
    s = torch.tensor([1e-3, 3e-3, 4.5e-3], dtype=torch.float64)
    area, square = overlap_integrals(pupil, 0.6 * s, 0.8 * s, nodes=400)
    half = s / 2 / radius
    expected = 2 * radius**2 * (torch.acos(half) - half * torch.sqrt(1 - half**2))
    np.testing.assert_allclose(area, expected, rtol=1e-4, atol=1e-14)
    # The chord at t is 2 sqrt(r² - (|t| + s / 2)²).
    reach, start = radius - s / 2, s / 2
    inner = radius**2 * reach - ((start + reach) ** 3 - start**3) / 3
    np.testing.assert_allclose(square, 8 * inner, rtol=1e-4, atol=1e-17)


def test_polygonal_stop_cuts_the_panel():
    stop = Stop(rectangle(0.5, 0.5, centre=(0.1, 0.2)))
    camera = replace(STUDY, lens=replace(STUDY.lens, f_number=50.0, stop=stop))
    s = torch.tensor([0.2e-3, 0.45e-3], dtype=torch.float64)
    area, square = overlap_integrals(convex_pupil(camera), s, 0.5 * s, nodes=400)
    for n in (0, 1):
        expected = _rectangle_integrals(float(s[n]), 0.5 * float(s[n]), 0.5e-3, 0.5e-3)
        assert float(area[n]) == pytest.approx(expected[0], rel=1e-3)
        assert float(square[n]) == pytest.approx(expected[1], rel=1e-3)


@pytest.mark.parametrize(
    ("fy", "fx", "expected"),
    # From an independent derivation and program, to three digits.
    [
        (0, 1, (0.187, 0.130, 0.089, 0.058, 0.034)),
        (1, 0, (0.246, 0.169, 0.112, 0.067, 0.023)),
    ],
)
def test_limit_has_the_values_of_another_program(fy, fx, expected):
    grid = FrequencyGrid(32, quarter=True)
    limit = rms_transfer_limit(STUDY, WAVELENGTH, grid, folded=False)
    found = [float(limit[fy * n, fx * n]) for n in (1, 2, 4, 8, 16)]
    assert found == pytest.approx(expected, abs=6e-4)


def test_folded_orders_raise_the_limit():
    grid = FrequencyGrid(16, quarter=True)
    alone = rms_transfer_limit(STUDY, WAVELENGTH, grid, folded=False)
    folded = rms_transfer_limit(STUDY, WAVELENGTH, grid)
    assert bool((folded >= alone - 1e-12).all())
    # At the Nyquist frequency of x, the orders of both signs are alike.
    assert float(folded[0, 8]) == pytest.approx(2 * float(alone[0, 8]), rel=0.01)
    assert float(folded[0, 0]) == 1


def _pupils(rows, columns):
    """Pupils of many kinds, by name: a lens, a cubic, an axicon, noise, an absorbing mask."""
    rng = np.random.default_rng(7)
    y, x = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    phases = {
        "lens": 0 * x,
        "cubic": 20 * (x**3 + y**3),
        "quartic": 25 * (x**2 + y**2) ** 2,
        "random": 2 * np.pi * rng.random(x.shape),
    }
    found = {name: np.exp(1j * phase) for name, phase in phases.items()}
    found["absorbing"] = rng.random(x.shape) * np.exp(20j * x**3)
    return found


@pytest.mark.parametrize("name", ["lens", "cubic", "quartic", "random", "absorbing"])
@pytest.mark.parametrize("shift", [(0, 3), (4, 0), (5, 10)])
def test_no_pupil_passes_more_over_depth_than_the_limit(name, shift):
    rows, columns, pitch = 24, 40, 50e-6
    pupil = _pupils(rows, columns)[name]
    y, x = (np.arange(n) * pitch for n in pupil.shape)
    my, mx = shift
    product = pupil[my:, mx:] * pupil[: rows - my, : columns - mx].conj()
    sy, sx = my * pitch, mx * pitch
    along = y[: rows - my, None] * sy + x[None, : columns - mx] * sx
    # The range holds whole periods of the direct sum in its depth.
    whole = WAVELENGTH / (pitch**2 * math.gcd(my, mx))
    depths = (np.arange(512) / 512) * whole
    phasors = np.exp(2j * np.pi / WAVELENGTH * depths[:, None, None] * along)
    transfer = (product * phasors).sum((1, 2)) / (rows * columns)
    found = math.sqrt((np.abs(transfer) ** 2).mean())
    panel = Panel(shape=(rows, columns), pitch=pitch)
    camera = Camera(panel, Lens(0.1, 5.6, math.inf), Sensor(pitch=0.1 * WAVELENGTH / pitch / 64))
    grid = FrequencyGrid(64 * 2)
    limit = rms_transfer_limit(
        camera, WAVELENGTH, grid, depth_range=(0.0, float(whole)), folded=False
    )
    # A shift by one pixel is two frequencies of 128.
    bound = float(limit[2 * my, 2 * mx])
    # Sums over pixels stand for integrals over the chord's trapezoid.
    assert found <= bound * 1.06
    if name == "lens" or (name == "cubic" and 0 in shift):
        assert found > 0.94 * bound


def test_no_pattern_passes_the_bound():
    panel = Panel(shape=(24, 32), pitch=60e-6)
    camera = Camera(panel, Lens(0.1, 5.6, math.inf), Sensor(pitch=3.45e-6))
    depth_range = (0.0, 40.0)
    transfer = FullTransfer(TransferDesign(camera, WAVELENGTH, 64, reach=125, pixel_size=True))
    spectrum, shares = NATURAL_SPECTRUM.on_grid(transfer.grid), transfer.grid.shares()
    limit = rms_transfer_limit(camera, WAVELENGTH, transfer.grid, depth_range=depth_range)
    bound = known_depth_bound(limit, spectrum, shares, 0.01)
    y, x = panel.plane.mesh()
    lens = -math.pi / WAVELENGTH * 20 * (y**2 + x**2)
    for strength in (0.0, 5.0, 20.0, 60.0):
        phase = lens + strength * ((y / 9e-4) ** 3 + (x / 9e-4) ** 3)
        rating = rate_pattern(transfer, phase, spectrum, 0.01, midpoint_dioptres(32, depth_range))
        assert rating.blind <= rating.known_depth <= bound


def test_both_quadratures_give_the_same_bound():
    grid = FrequencyGrid(32, quarter=True)
    spectrum, shares = NATURAL_SPECTRUM.on_grid(grid), grid.shares()
    levels = [
        known_depth_bound(
            rms_transfer_limit(STUDY, WAVELENGTH, grid, rule=rule, nodes=nodes),
            spectrum,
            shares,
            0.008,
        )
        for rule, nodes in (("gauss-legendre", 100), ("midpoint", 333))
    ]
    assert levels[0] == pytest.approx(levels[1], abs=2e-3)


def test_binned_pixels_raise_the_bound():
    levels = []
    for binning in (1, 2, 4):
        grid = FrequencyGrid(16, quarter=True)
        limit = rms_transfer_limit(STUDY, WAVELENGTH, grid, binning=binning, nodes=40)
        spectrum = NATURAL_SPECTRUM.on_grid(grid)
        levels.append(known_depth_bound(limit, spectrum, grid.shares(), 0.008))
    assert levels[0] < levels[1] < levels[2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera": replace(STUDY, separation=0.1)}, "separation"),
        ({"wavelength": 0.0}, "wavelength"),
        ({"depth_range": (1.0, 1.0)}, "depth_range"),
        ({"binning": 0}, "binning"),
        ({"nodes": 0}, "nodes"),
        ({"rule": "simpson"}, "rule"),
        (
            {
                "camera": replace(
                    STUDY,
                    lens=replace(
                        STUDY.lens,
                        stop=Stop(Polygon(((0.0, 0.0), (-0.5, 0.5), (0.5, 0.0), (-0.5, -0.5)))),
                    ),
                )
            },
            "convex",
        ),
        (
            {"camera": replace(STUDY, lens=replace(STUDY.lens, aberrations=((4, 0, 1e-7),)))},
            "aberrations",
        ),
    ],
)
def test_cases_without_a_bound_are_refused(change, message):
    given = {"camera": STUDY, "wavelength": WAVELENGTH, "grid": FrequencyGrid(8)}
    with pytest.raises(ValueError, match=message):
        rms_transfer_limit(**(given | change))


def test_obscured_stop_has_the_bound_of_its_opening_and_its_own_light():
    grid = FrequencyGrid(16, quarter=True)
    clear = replace(STUDY, lens=replace(STUDY.lens, f_number=20.0))
    stop = Stop(obscurations=(Circle(0.5),))
    obscured = replace(clear, lens=replace(clear.lens, stop=stop))
    limits = [rms_transfer_limit(one, WAVELENGTH, grid, folded=False) for one in (clear, obscured)]
    assert float(limits[1][0, 2] / limits[0][0, 2]) == pytest.approx(1 / 0.75, rel=1e-3)
