"""Free space beside what textbooks know of it in closed form, by every method that accepts."""

from __future__ import annotations

import numpy as np
import pytest
from figures import free_space
from figures.free_space import FORMS, Form, gaussian_beam, talbot, talbot_distance
from judges import relative
from judges.fields import slit
from scipy.integrate import quad

QUICK = 0.06
"""Predicted seconds of a method that a test waits for; the figure waits longer."""

SCALAR = {"angular spectrum", "band-limited angular spectrum", "scaled angular spectrum"}


def worst(form: Form) -> float:
    return max(error for _, error in form.errors(most_seconds=QUICK))


@pytest.mark.parametrize("name", FORMS)
def test_every_method_that_accepts_meets_the_closed_form(name):
    for form in FORMS[name]():
        errors = dict(form.errors(most_seconds=QUICK))
        assert errors
        assert max(errors.values()) <= 1e-6, errors


def test_no_method_is_left_out_of_the_closed_forms():
    """Those whose model is scalar, and Fresnel's, each meet one at least."""
    serving = {
        method
        for method, _ in gaussian_beam(60e-6, paraxial=False, alike=True).errors(most_seconds=QUICK)
    }
    assert serving >= SCALAR
    far = gaussian_beam(0.1, paraxial=True, waist=50e-6)
    assert {method for method, _ in far.errors(most_seconds=QUICK)} >= {
        "Fresnel transfer function",
        "Fresnel matrices",
    }


def test_the_slit_is_fresnels_integral():
    """By adaptive quadrature of its own."""
    scale, low, high = 532e-9 * 2e-3, -1.3e-4, 1.7e-4
    parts = [
        quad(lambda u, f=f: f(np.pi * u**2 / scale), low, high, limit=2000)[0]
        for f in (np.cos, np.sin)
    ]
    truth = complex(*parts) / np.sqrt(1j * scale)
    assert slit(np.array(low), np.array(high), np.array(scale)) == pytest.approx(truth, rel=1e-8)
    back = slit(np.array(low), np.array(high), np.array(-scale))
    assert back == pytest.approx(truth.conjugate(), rel=1e-8)


def test_a_sharp_discs_axis_is_what_the_textbook_has():
    """The Gaussian mean over radii tends to 1 - (z / r) exp(ik(r - z)) as edges get sharp."""
    radius, distance, wavelength = 20e-6, 100e-6, free_space._GREEN
    r = np.hypot(radius, distance)
    textbook = distance / r * np.exp(2j * np.pi * (r - distance) / wavelength)
    soft = free_space._mean_edge_wave(radius, distance, 1e-10, paraxial=False)
    assert soft == pytest.approx(textbook, rel=1e-6)


def test_fringes_return_at_the_talbot_distance_and_not_at_the_paraxial_one():
    period = 4e-6
    exact, paraxial = talbot_distance(period, 532e-9), 2 * period**2 / 532e-9
    assert paraxial / exact == pytest.approx(1.00446, abs=1e-4)
    source = 1 + 0.7 * np.cos(2 * np.pi * np.arange(-16, 17) * 0.8e-6 / period)
    for distance, returned in ((exact, True), (paraxial, False)):
        form = talbot(paraxial=False, distance=distance)
        value = np.asarray(form.operator()(form.light))
        assert (relative(value, np.broadcast_to(source, value.shape)) < 1e-8) == returned
        assert relative(value, form.truth) < 1e-8
    assert worst(talbot(paraxial=True)) < 1e-8


def test_fresnels_discs_are_not_the_scalar_ones():
    """The three cases tell the models apart: a test that mixes them up can't pass."""
    for disc in free_space.SOFT_DISCS:
        models = [
            free_space.soft_disc(*disc, opaque=False, paraxial=paraxial).truth
            for paraxial in (False, True)
        ]
        assert relative(models[1], models[0]) > 0.01


def test_the_told_error_of_fresnels_model_is_within_a_factor_two():
    for error, predicted in free_space.model_errors():
        assert 0.5 <= predicted / error <= 2
