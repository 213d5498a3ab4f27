import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from optics.camera import Panel
from optics.slm import grey_to_phase, max_phase, phase_to_grey, require_grey

PANEL = Panel(shape=(8, 16))


@pytest.mark.parametrize(("wavelength", "phase"), [(452e-9, 9.0), (532e-9, 6.7), (633e-9, 5.4)])
def test_the_tabulated_phases_are_met_exactly(wavelength, phase):
    """HOLOEYE PLUTO-VIS-006-A: thesis Table 2.2."""
    assert max_phase(PANEL, wavelength) == pytest.approx(phase * math.pi, rel=1e-12)


def test_the_phase_falls_with_the_wavelength_between_the_tabulated():
    """Normal dispersion: both birefringence and 1 / wavelength fall."""
    phases = [max_phase(PANEL, w) for w in np.linspace(452e-9, 633e-9, 60)]
    assert (np.diff(phases) < 0).all()


def test_one_tabulated_wavelength_means_a_constant_path():
    """phase x wavelength stays: half the wavelength, twice the phase."""
    panel = Panel(max_phase=((500e-9, 4.0),))
    assert max_phase(panel, 550e-9) == pytest.approx(4.0 * 500 / 550)


def test_two_tabulated_wavelengths_fit_cauchys_two_terms():
    """path = A + B / wavelength², solved by hand for paths 3e-6 and 2e-6."""
    low, high = 400e-9, 600e-9
    panel = Panel(max_phase=((low, 3e-6 / low), (high, 2e-6 / high)))
    b = (3e-6 - 2e-6) / (1 / low**2 - 1 / high**2)
    a = 3e-6 - b / low**2
    assert max_phase(panel, 500e-9) == pytest.approx((a + b / 500e-9**2) / 500e-9, rel=1e-9)


@pytest.mark.parametrize("wavelength", [300e-9, 800e-9, 0.0, float("nan")])
def test_a_wavelength_outside_the_table_is_refused_with_the_range(wavelength):
    with pytest.raises(ValueError, match=r"wavelength .* nm is outside .*choose 407 to 72[78] nm"):
        max_phase(PANEL, wavelength)


def test_the_phase_of_grey_levels_is_linear():
    """Level g of 255 shows g / 255 of the highest phase."""
    grey = torch.tensor([[0, 51, 255]], dtype=torch.uint8)
    expected = [0.0, 0.2 * 6.7 * math.pi, 6.7 * math.pi]
    assert grey_to_phase(PANEL, grey, 532e-9)[0].tolist() == pytest.approx(expected, rel=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    phase=st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=20),
    wavelength=st.floats(430e-9, 700e-9),
)
def test_phases_return_within_half_a_level_modulo_one_wave(phase, wavelength):
    phase = np.array([phase])
    grey = phase_to_grey(PANEL, phase, wavelength)
    shown = grey_to_phase(PANEL, grey, wavelength)
    miss = np.angle(np.exp(1j * (shown - phase)))
    assert grey.dtype == np.uint8
    assert np.abs(miss).max() <= 0.5 * max_phase(PANEL, wavelength) / 255 + 1e-9


def test_a_ramp_steps_by_at_most_two_levels_except_where_it_wraps():
    """A slope of 1.2 levels per pixel rounds to steps of 1 or 2; a wrap falls by a wave."""
    level = max_phase(PANEL, 550e-9) / 255
    grey = phase_to_grey(PANEL, torch.arange(500) * (1.2 * level), 550e-9).to(int)
    step = torch.diff(grey)
    levels_per_wave = 2 * math.pi / level
    wraps = step < 0
    assert (step[~wraps] <= 2).all()
    assert (step[wraps] <= -(levels_per_wave - 3)).all()
    assert int(wraps.sum()) == int(500 * 1.2 / levels_per_wave)
    assert int(grey.max()) <= math.ceil(levels_per_wave)


def test_a_panel_that_reaches_just_one_wave_uses_all_its_levels():
    panel = Panel(max_phase=((550e-9, 2 * math.pi * 255 / 256),))
    grey = phase_to_grey(panel, torch.linspace(0, 2 * math.pi, 4097)[:-1], 550e-9)
    assert (int(grey.min()), int(grey.max())) == (0, 255)


def test_a_panel_that_cannot_reach_one_wave_is_refused():
    panel = Panel(max_phase=((550e-9, 1.9 * math.pi),))
    with pytest.raises(ValueError, match=r"reaches 1.90 pi at 550 nm and .* needs 2 pi; choose"):
        phase_to_grey(panel, torch.zeros(2), 550e-9)


def test_a_phase_that_is_not_finite_is_refused():
    """A NaN would become grey level 0 without a word."""
    with pytest.raises(ValueError, match=r"phase has 1 NaN or infinite values of 2"):
        phase_to_grey(PANEL, torch.tensor([0.0, float("nan")]), 550e-9)


def test_a_good_pattern_is_accepted():
    require_grey(PANEL, np.full((8, 16), 255, dtype=np.uint8))


def test_a_pattern_of_another_type_or_shape_is_refused():
    with pytest.raises(TypeError, match=r"type is float64; the panel shows uint8"):
        require_grey(PANEL, np.zeros((8, 16)))
    with pytest.raises(ValueError, match=r"pattern is 8x16 pixels; the panel needs 16x8"):
        require_grey(PANEL, np.zeros((16, 8), dtype=np.uint8))
    with pytest.raises(ValueError, match=r"has 3 axes; the panel needs rows and columns"):
        require_grey(PANEL, np.zeros((8, 16, 3), dtype=np.uint8))


def test_levels_that_the_panel_does_not_have_are_refused():
    with pytest.raises(ValueError, match=r"level 16.* 0 to 15"):
        require_grey(Panel(shape=(1, 2), levels=16), np.array([[0, 16]], dtype=np.uint8))
