import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from optics.slm import (
    Modulator,
    Panel,
    PanelMap,
    PhaseResponse,
    grey_to_phase,
    max_phase,
    phase_to_grey,
)
from optics.slm.lut import whole_waves

PANEL = Panel((12, 20))
WAVELENGTH = 532e-9
LEVELS = np.arange(256) / 255


def bent(power):
    """Shares that grow as a power of the level, which is steep at one end."""
    return LEVELS**power


def s_shaped(share):
    return LEVELS + share / (2 * np.pi) * np.sin(2 * np.pi * LEVELS)


def regional(*shape):
    """A response of regions that all differ, at two wavelengths."""
    powers = np.linspace(0.7, 1.6, 2 * math.prod(shape)).reshape(2, *shape)
    shares = np.stack([bent(p) for p in powers.ravel()]).reshape(2, *shape, 256)
    return PhaseResponse((450e-9, 600e-9), torch.from_numpy(shares))


def curve_at(response, panel, row, column, wavelength):
    """Phase of all levels at one pixel: every step of the interpolation written out."""
    x = [1 / w**2 for w in response.wavelengths]
    share = np.clip((1 / wavelength**2 - x[0]) / (x[1] - x[0]), 0, 1)
    shares = response.shares.numpy()
    shares = (1 - share) * shares[0] + share * shares[1]
    regions = shares.shape[:2]
    (r, fr), (c, fc) = (
        divmod(np.clip((i + 0.5) * k / n - 0.5, 0, k - 1), 1)
        for i, k, n in zip((row, column), regions, panel.shape, strict=True)
    )
    r, c = int(r), int(c)
    r1, c1 = min(r + 1, regions[0] - 1), min(c + 1, regions[1] - 1)
    upper = (1 - fc) * shares[r, c] + fc * shares[r, c1]
    lower = (1 - fc) * shares[r1, c] + fc * shares[r1, c1]
    return max_phase(panel, wavelength) * ((1 - fr) * upper + fr * lower)


# Grey to phase


def test_a_measured_response_is_followed_level_by_level():
    panel = replace(PANEL, response=PhaseResponse.from_curve(WAVELENGTH, s_shaped(0.8)))
    grey = np.arange(240, dtype=np.uint8).reshape(12, 20)
    phase = grey_to_phase(panel, grey, 560e-9)
    assert np.allclose(phase, max_phase(panel, 560e-9) * s_shaped(0.8)[grey], rtol=1e-14)


def test_phases_that_were_measured_are_met_at_their_wavelengths():
    phases = np.stack([20 * bent(1.2), 15 * bent(0.9)])
    panel = replace(PANEL, response=PhaseResponse.from_phases(PANEL, [480e-9, 600e-9], phases))
    grey = torch.arange(256, dtype=torch.uint8)
    for wavelength, phase in zip((480e-9, 600e-9), phases, strict=True):
        assert np.allclose(grey_to_phase(panel, grey, wavelength).numpy(), phase, rtol=1e-12)


@pytest.mark.parametrize("wavelength", [430e-9, 450e-9, 500e-9, 590e-9, 650e-9])
@pytest.mark.parametrize("regions", [(1, 1), (2, 1), (3, 4), (12, 20)])
def test_between_regions_and_wavelengths_the_response_is_interpolated(regions, wavelength):
    panel = replace(PANEL, response=regional(*regions))
    grey = np.random.default_rng(0).integers(0, 256, PANEL.shape).astype(np.uint8)
    phase = grey_to_phase(panel, grey, wavelength)
    for row in range(12):
        for column in range(20):
            curve = curve_at(panel.response, panel, row, column, wavelength)
            assert phase[row, column] == pytest.approx(curve[grey[row, column]], rel=1e-12)


def test_regions_have_no_seams():
    """Across a tall panel, whose rows are looked up in blocks, one level's phase changes as
    slowly as the regions do."""
    panel = Panel((300, 8), response=regional(3, 1))
    phase = grey_to_phase(panel, torch.full((300, 8), 128, dtype=torch.uint8), WAVELENGTH)
    regions = max_phase(panel, WAVELENGTH) * panel.response.at(WAVELENGTH)[:, 0, 128]
    steepest = float(regions.diff().abs().max()) / 100
    assert float(phase.diff(dim=0).abs().max()) <= steepest * (1 + 1e-9)


def test_wavelengths_may_come_in_any_order():
    shares = torch.from_numpy(np.stack([bent(0.8), bent(1.0), bent(1.5)]))[:, None, None]
    sorted_ = PhaseResponse((450e-9, 550e-9, 650e-9), shares)
    mixed = PhaseResponse((650e-9, 450e-9, 550e-9), shares[[2, 0, 1]])
    for wavelength in np.linspace(400e-9, 700e-9, 13):
        assert torch.equal(sorted_.at(wavelength), mixed.at(wavelength))


def test_the_phase_is_differentiable_in_the_response():
    start = torch.rand(1, 2, 2, 4, dtype=torch.float64).cumsum(-1).requires_grad_()
    grey = torch.tensor([[0, 1, 2], [3, 2, 1]], dtype=torch.uint8)

    def phase(shares):
        panel = Panel((2, 3), levels=4, response=PhaseResponse((5e-7,), shares))
        return grey_to_phase(panel, grey, 5e-7)

    assert torch.autograd.gradcheck(phase, start)


@pytest.mark.parametrize(
    ("grey", "words"),
    [
        (np.full((12, 20), 300, dtype=np.int64), "grey goes from 300 to 300; .* 0 to 255"),
        (np.full((12, 20), -1, dtype=np.int64), "grey goes from -1 to -1"),
        (np.zeros((12, 20)), "grey is torch.float64; give whole levels, as uint8"),
        (np.zeros((20, 12), dtype=np.uint8), r"grey is \(20, 12\); .* needs \(12, 20\)"),
    ],
)
def test_what_is_no_grey_level_is_refused(grey, words):
    with pytest.raises(ValueError, match=words):
        grey_to_phase(replace(PANEL, response=regional(2, 2)), grey, WAVELENGTH)


@pytest.mark.parametrize(
    ("shares", "words"),
    [
        ([0, 0.5, 0.4, 1], r"falls from level 1 to 2 at 500 nm in region \(0, 0\), and 1 times"),
        ([0, 0.5, math.nan, 1], "a response has 1 NaN"),
        ([0.5, 0.5, 0.5, 0.5], "doesn't rise"),
        ([1.0], "doesn't rise"),
        ([[0, 1], [0, 1]], r"shares are \(1, 1, 1, 2, 2\)"),
    ],
)
def test_what_is_no_response_is_refused(shares, words):
    with pytest.raises(ValueError, match=words):
        PhaseResponse.from_curve(500e-9, shares)


def test_responses_of_strange_wavelengths_are_refused():
    shares = torch.tensor([[[[0.0, 1.0]]]] * 2)
    with pytest.raises(ValueError, match="must differ"):
        PhaseResponse((5e-7, 5e-7), shares)
    with pytest.raises(ValueError, match="wavelength is -5e-07 m"):
        PhaseResponse((5e-7, -5e-7), shares)
    with pytest.raises(ValueError, match=r"need wavelengths \(1\)"):
        PhaseResponse((5e-7,), shares)
    with pytest.raises(ValueError, match=r"phases are \(3,\); they need wavelengths \(1\)"):
        PhaseResponse.from_phases(Panel(levels=3), [5e-7], [0.0, 1.0, 2.0])


# Phase to grey


def off_by(shown, wanted, orders=1):
    """Radians modulo `orders` waves."""
    period = 2 * np.pi * orders
    return np.abs((np.asarray(shown) - wanted + period / 2) % period - period / 2)


@pytest.mark.parametrize("regions", [(1, 1), (3, 4)])
@pytest.mark.parametrize("orders", [1, 2, 3])
def test_every_pixel_gets_the_nearest_level_of_its_curve(regions, orders):
    """Nearest of all levels below the wrap, tried one after the other."""
    panel = replace(PANEL, response=regional(*regions))
    phase = np.random.default_rng(1).uniform(-40, 40, PANEL.shape)
    shown = grey_to_phase(panel, phase_to_grey(panel, phase, WAVELENGTH, orders), WAVELENGTH)
    for row in range(12):
        for column in range(20):
            curve = curve_at(panel.response, panel, row, column, WAVELENGTH)
            curve = curve[curve < curve[0] + 2 * np.pi * orders]
            best = off_by(curve, phase[row, column], orders).min()
            miss = off_by(shown[row, column], phase[row, column], orders)
            assert miss == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("shares", [bent(1.0), s_shaped(0.5), bent(1.4)])
@pytest.mark.parametrize("orders", [1, 3])
def test_neighbouring_phases_are_neighbouring_levels_except_at_wraps(shares, orders):
    """Phases as close as the mean step of the used levels: at most 2 levels apart."""
    panel = replace(PANEL, response=PhaseResponse.from_curve(WAVELENGTH, shares))
    phases = max_phase(panel, WAVELENGTH) * shares
    step = np.diff(phases[phases < 2 * np.pi * orders]).min()
    grey = phase_to_grey(panel, np.arange(0, 100, step), WAVELENGTH, orders).astype(int)
    change = np.diff(grey)
    wraps = change < 0
    assert change[~wraps].max() <= 2
    used = (phases < 2 * np.pi * orders).sum()
    assert (change[wraps] <= -(used - 3)).all()
    assert wraps.sum() == int(100 / (2 * np.pi * orders))


def test_more_orders_make_fewer_wraps():
    """A lens of 100 rad: 15 wraps in one wave, 5 in three."""
    slope = torch.linspace(0.01, 100, 5000)
    for orders in (1, 2, 3):
        grey = phase_to_grey(PANEL, slope, WAVELENGTH, orders).to(int)
        assert int((grey.diff() < 0).sum()) == int(100 / (2 * math.pi * orders))


def test_the_wraps_that_a_panel_holds_are_told():
    """6.7 pi at 532 nm hold three waves, 5.4 pi at 633 nm two."""
    assert whole_waves(PANEL, 532e-9) == 3
    assert whole_waves(PANEL, 633e-9) == 2
    assert whole_waves(Panel(max_phase=((5e-7, 6.0),)), 5e-7) == 0
    with pytest.raises(ValueError, match=r"orders is 4; .* 6.70 pi at 532 nm: choose 1 to 3"):
        phase_to_grey(PANEL, torch.zeros(2), 532e-9, 4)
    for orders in (0, 1.5):
        with pytest.raises(ValueError, match=rf"orders is {orders}"):
            phase_to_grey(PANEL, torch.zeros(2), 532e-9, orders)


def test_the_weakest_region_decides_how_many_waves_there_are():
    shares = torch.linspace(0, 1, 256) * torch.tensor([[[1.0], [0.5]]])
    panel = replace(PANEL, response=PhaseResponse((WAVELENGTH,), shares[None]))
    assert whole_waves(panel, WAVELENGTH) == 1


def test_the_first_level_needs_no_phase_of_zero():
    """A curve from 1 to 9 rad: phase 0.5 is shown as a wave more."""
    panel = Panel((1, 1), max_phase=((5e-7, 1.0),))
    panel = replace(panel, response=PhaseResponse.from_curve(5e-7, 1 + 8 * LEVELS))
    grey = phase_to_grey(panel, np.array([[0.5]]), 5e-7)
    assert grey_to_phase(panel, grey, 5e-7)[0, 0] == pytest.approx(0.5 + 2 * np.pi, abs=8 / 510)


def test_what_a_panel_of_known_flatness_shows_makes_the_wave_that_was_asked_for():
    """Up to the rounding to levels, at any wavelength, and unless the flatness is taken away."""
    y, x = np.mgrid[:12, :20]
    panel = replace(PANEL, flatness=PanelMap(1e-6 * (x / 20) ** 2 - 3e-7 * y / 12))
    wanted = np.random.default_rng(2).uniform(0, 2 * np.pi, PANEL.shape)
    for wavelength in (480e-9, 600e-9):
        modulator = Modulator(panel, wavelength)
        field = modulator.modulation(modulator.phase(modulator.grey(wanted)))
        half = 0.5 * max_phase(panel, wavelength) / 255
        assert np.abs(np.angle(field * np.exp(-1j * wanted))).max() <= half + 1e-9
    bare = replace(panel, flatness=None)
    assert np.array_equal(phase_to_grey(bare, wanted, 5e-7), phase_to_grey(PANEL, wanted, 5e-7))


def test_a_phase_of_another_shape_than_an_uneven_panel_is_refused():
    for panel in (
        replace(PANEL, flatness=PanelMap(np.zeros((2, 2)))),
        replace(PANEL, response=regional(2, 2)),
    ):
        with pytest.raises(ValueError, match=r"phase is \(5,\); .* needs \(12, 20\)"):
            phase_to_grey(panel, torch.zeros(5), WAVELENGTH)


def test_pictures_come_in_batches():
    panel = replace(PANEL, response=regional(3, 4))
    phase = torch.rand(2, 3, 12, 20, dtype=torch.float64) * 30
    grey = phase_to_grey(panel, phase, WAVELENGTH)
    assert torch.equal(grey[1, 2], phase_to_grey(panel, phase[1, 2], WAVELENGTH))
    assert torch.equal(
        grey_to_phase(panel, grey, WAVELENGTH)[1, 2], grey_to_phase(panel, grey[1, 2], WAVELENGTH)
    )


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_levels_and_pixels_may_be_few(dtype):
    """Two levels, half a wave apart, and one pixel."""
    panel = Panel((1, 1), levels=2, max_phase=((5e-7, math.pi),))
    for phase, level in ((0.0, 0), (1.5, 0), (1.7, 1), (-1.7, 1), (6.0, 0)):
        assert int(phase_to_grey(panel, torch.tensor([[phase]], dtype=dtype), 5e-7)) == level


def test_a_stretch_that_no_level_reaches_is_stepped_over():
    """Levels without effect at the beginning, a jump in the middle: still the nearest."""
    shares = np.concatenate([np.zeros(50), 0.3 * LEVELS[:156], 0.8 + 0.4 * LEVELS[:50]])
    panel = replace(PANEL, response=PhaseResponse.from_curve(WAVELENGTH, shares))
    curve = max_phase(panel, WAVELENGTH) * shares
    curve_used = curve[curve < 4 * np.pi]
    phase = np.linspace(0, 4 * np.pi, 999)
    shown = grey_to_phase(panel, phase_to_grey(panel, phase, WAVELENGTH, 2), WAVELENGTH)
    nearest = [off_by(curve_used, p, 2).min() for p in phase]
    assert np.allclose(off_by(shown, phase, 2), nearest, atol=1e-9)
