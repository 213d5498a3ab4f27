"""FreeSpace: the choice of a method, the promise, the refusals, the derivatives."""

import itertools
import math
import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from judges import relative
from judges.free_space_sums import cell_matrix, exact_gauss, gauss, mesh
from sweeps import some

from optics.accuracy import Budget, ToleranceError
from optics.plane import Plane
from optics.propagation import METHODS, FreeSpace, propagate, rayleigh_sommerfeld
from optics.propagation.angular_spectrum import ScaledAngularSpectrum
from optics.propagation.method_choice import _PROPAGATORS as PROPAGATORS
from optics.propagation.span import FreeSpaceSpan

BLUE = 0.5e-6
PANEL = Plane((12, 10), (8e-6, 8e-6))
CELLS = (7.5e-6, 7.5e-6)
SENSOR = Plane((9, 8), (10e-6, 12e-6), (20e-6, -30e-6))
BEAM = Plane((48, 45), (5e-6, 5e-6))


def modulation(seed: int = 0, batch: tuple[int, ...] = ()) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.exp(2j * np.pi * rng.random((*batch, *PANEL.shape)))


@pytest.mark.parametrize("z", [2e-3, 0.05, -0.05])
def test_every_method_that_serves_cells_agrees_with_the_integral(z):
    truth = (cell_matrix(PANEL, CELLS, SENSOR, z, BLUE) @ modulation().ravel()).reshape(
        SENSOR.shape
    )
    served = []
    for method in METHODS:
        for tol in (1e-2, 1e-5):
            try:
                operator = FreeSpace(PANEL, SENSOR, z, BLUE, cells=CELLS, tol=tol, method=method)
            except ValueError:
                continue
            answer = operator(modulation())
            assert relative(answer, truth) <= tol
            assert operator.method == method
            served.append(method)
    assert "scaled angular spectrum" in served
    assert "tilted angular spectrum" in served


@pytest.mark.parametrize("tol", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
def test_every_tolerance_is_kept_in_a_corner_that_gets_little_light(tol):
    """Off the beam: relative to the light there, not to all of it."""
    waist, z = 20e-6, 5e-3
    target = Plane((7, 8), (4e-6, 4e-6), (90e-6, -80e-6))
    field, truth = gauss(BEAM, waist, 0.0, BLUE), gauss(target, waist, z, BLUE)
    operator = FreeSpace(BEAM, target, z, BLUE, paraxial=True, tol=tol, band=(0.75e5, 0.75e5))
    assert relative(operator(field), truth) <= tol
    assert operator.account.error <= tol


@pytest.mark.parametrize("z", [10e-6, 1e-3, 0.05])
def test_a_scalar_beam_by_the_cheapest_method(z):
    waist, target = 20e-6, Plane((6, 5), (9e-6, 8e-6), (10e-6, 0.0))
    field = gauss(BEAM, waist, 0.0, BLUE)
    result = propagate(field, BEAM, target, z, BLUE, band=(0.75e5, 0.75e5), tol=1e-5)
    assert relative(result.value, exact_gauss(target, waist, z, BLUE)) <= 1e-5
    account = result.account
    assert account.method in METHODS
    assert account.tol == 1e-5
    assert account.cpu_spent is not None
    assert account.model.value == 0


def test_the_account_of_the_paraxial_model_tells_its_error():
    near, far = (
        FreeSpace(PANEL, SENSOR, z, BLUE, cells=CELLS, paraxial=True).account.model
        for z in (1e-3, 0.1)
    )
    assert "paraxial" in near.how
    # pi / 4 r⁴ / (wavelength z³), with r from the farthest corner of a cell to a sample.
    r = math.hypot(6 * 8 + 3.75 + 20 + 4 * 10, 4 * 8 + 3.75 + 30 + 4 * 12) * 1e-6
    assert far.value == pytest.approx(math.pi / 4 * r**4 / (BLUE * 1e-3), rel=1e-3)
    assert 0.1 < near.value <= 1


def test_the_paraxial_error_of_a_beam_is_told_after_a_call():
    waist, z = 3e-6, 2e-4
    source, target = Plane((40, 41), (0.6e-6, 0.6e-6)), Plane((30, 31), (2e-6, 2e-6))
    operator = FreeSpace(source, target, z, BLUE, paraxial=True)
    bound = operator.account.model.value
    answer = operator(gauss(source, waist, 0.0, BLUE))
    told, error = (
        operator.account.model.value,
        relative(answer, exact_gauss(target, waist, z, BLUE)),
    )
    assert told == pytest.approx(error, rel=0.1)
    assert told < bound


def test_paraxial_methods_serve_a_scalar_wave_where_they_are_right():
    """Light within 0.9 degrees of the axis is 5e-5 rad late on half a millimetre."""
    waist, wide = 50e-6, Plane((40, 41), (8e-6, 8e-6))
    target = Plane((20, 21), (9e-6, 8e-6))
    truth = exact_gauss(target, waist, 5e-4, BLUE)
    beam = gauss(wide, waist, 0.0, BLUE)
    for method in ("Fresnel transfer function", "Fresnel matrices"):
        operator = FreeSpace(wide, target, 5e-4, BLUE, band=(2.2e4, 2.2e4), tol=1e-2, method=method)
        assert relative(operator(beam), truth) <= 1e-2
        with pytest.raises(ToleranceError, match="paraxial"):
            FreeSpace(wide, target, 5e-4, BLUE, band=(2.2e4, 2.2e4), tol=1e-5, method=method)


def test_arrays_come_back_as_arrays_and_tensors_as_tensors():
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    array = operator(modulation())
    assert isinstance(array, np.ndarray)
    assert array.dtype == np.complex64
    tensor = operator(torch.from_numpy(modulation()))
    assert isinstance(tensor, torch.Tensor)
    assert np.array_equal(tensor.numpy(), array)
    amplitudes = operator(np.ones(PANEL.shape, dtype=np.float32))
    assert relative(amplitudes, operator(np.ones(PANEL.shape) + 0j)) < 1e-6


def test_a_tight_tolerance_is_kept_in_double_precision():
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS, tol=1e-9)
    assert operator(modulation()).dtype == np.complex128
    assert operator.account.precision == "float64"


def test_mixed_precision_is_kept_out():
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    field = torch.from_numpy(modulation())
    plain = operator(field)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert torch.equal(operator(field), plain)


def test_the_adjoint_is_the_conjugate_transpose():
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS, tol=1e-8)
    u, v = modulation(), modulation(1)[:9, :8]
    left, right = np.vdot(v, operator(u)), np.vdot(operator.adjoint(v), u)
    assert left == pytest.approx(right, rel=1e-9)


# Batches and memory.


def test_batches_are_done_in_chunks_that_the_memory_holds():
    field = modulation(batch=(2, 3))
    plain = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    whole = plain(field)
    assert whole.shape == (2, 3, *SENSOR.shape)
    seen: list[int] = []
    tight = FreeSpace(
        PANEL,
        SENSOR,
        0.05,
        BLUE,
        cells=CELLS,
        budget=Budget(memory=2 * plain.account.bytes),
        method=plain.method,
    )
    inner = tight._propagator.forward
    tight._propagator.forward = lambda part: seen.append(len(part)) or inner(part)
    assert relative(tight(field), whole) < 1e-6
    assert seen == [2, 2, 2]
    assert plain(field[:0]).shape == (0, 3, *SENSOR.shape)


def test_too_little_memory_is_told_before_it_is_taken():
    with pytest.raises(ToleranceError, match="more memory"):
        FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS, budget=Budget(memory=1000))


def test_nobody_is_let_wait_for_hours_who_didn_t_ask():
    """Grazing rays from a wide panel: only the direct sum serves."""
    panel, wide = Plane((3000, 3000), (8e-6, 8e-6)), Plane((2000, 2000), (8e-6, 8e-6))
    with pytest.raises(
        ToleranceError,
        match=r"would take about \S+ h .*; allow more time, or ask for a smaller target",
    ):
        FreeSpace(panel, wide, 2e-4, BLUE, cells=(8e-6, 8e-6), budget=Budget(memory=1 << 40))


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.1, 0.2)])
@pytest.mark.parametrize("method", METHODS)
def test_answers_of_every_method_are_plain_numbers_both_ways(method, tilt):
    """torch marks a conjugate, and numpy can't read the mark; a way back is a conjugate."""
    source, served = Plane((32, 30), (4e-6, 5e-6)), False
    for z, cells, paraxial in itertools.product((0.05, -0.05), (None, (3e-6, 4e-6)), (False, True)):
        target = Plane((5, 4), source.pitch)
        span = FreeSpaceSpan(
            source, target, z, BLUE, cells=cells, paraxial=paraxial, tilt=tilt, tol=1e-4
        )
        try:
            propagator = PROPAGATORS[method](span)
        except ValueError:
            continue
        served = True
        for plane, send in ((source, propagator.forward), (target, propagator.adjoint)):
            field = torch.ones(2, *plane.shape, dtype=propagator.dtype)
            answers = send(field), send(field.conj())
            assert not any(answer.is_conj() or answer.is_neg() for answer in answers)
    assert served or any(tilt)


@pytest.mark.parametrize(
    ("strength", "tol"),
    some(itertools.product([1e-200, 1e-25, 1e-12, 1e12, 1e25, 1e200], [1e-3, 1e-9]), 0, 2, 8, 11),
)
def test_fields_of_any_strength(strength, tol):
    """Squares leave single precision below 1e-19 and beyond 1e19, double below 1e-154."""
    panel = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS, tol=tol)
    truth = cell_matrix(PANEL, CELLS, SENSOR, 0.05, BLUE) @ modulation().ravel()
    assert relative(panel(modulation() * strength) / strength, truth.reshape(SENSOR.shape)) <= tol
    target = Plane((6, 5), (9e-6, 8e-6))
    beam = FreeSpace(BEAM, target, 5e-3, BLUE, band=(0.75e5,) * 2, tol=tol)
    field, truth = gauss(BEAM, 20e-6, 0.0, BLUE), exact_gauss(target, 20e-6, 5e-3, BLUE)
    assert relative(beam(field * strength) / strength, truth) <= tol
    back = modulation(1)[: SENSOR.shape[0], : SENSOR.shape[1]]
    assert relative(panel.adjoint(back * strength) / strength, panel.adjoint(back)) <= 1e-6
    if tol == 1e-3 and 1e-30 < strength < 1e30:
        single = torch.from_numpy(field).to(torch.complex64)
        assert relative(beam(single * strength) / strength, truth) <= tol


def test_strong_weak_and_dark_fields_together():
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    factors = np.array([1.0, 1e-25, 0.0, 1e20, 1e-300])[:, None, None]
    answers, alone = operator(modulation() * factors), operator(modulation())
    assert not answers[2].any()
    for answer, factor in zip(answers, factors.ravel(), strict=True):
        if factor:
            assert relative(answer / factor, alone) < 1e-6


@pytest.mark.parametrize("strength", [1e-25, 1.0, 1e25])
def test_derivatives_of_fields_of_any_strength(strength):
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    field = torch.from_numpy(modulation() * strength).requires_grad_()
    ((operator(field) / strength).abs() ** 2).sum().backward()
    plain = torch.from_numpy(modulation()).requires_grad_()
    (operator(plain).abs() ** 2).sum().backward()
    assert relative((field.grad * strength).numpy(), plain.grad.numpy()) < 1e-5


# The promise about the light on the target.


def test_a_target_with_little_light_is_planned_again_and_the_plan_is_kept(monkeypatch):
    made = []
    plain = ScaledAngularSpectrum.__init__
    monkeypatch.setattr(
        ScaledAngularSpectrum,
        "__init__",
        lambda self, span: made.append(span.tol) or plain(self, span),
    )
    target = Plane((6, 6), (4e-6, 4e-6), (130e-6, 120e-6))
    operator = FreeSpace(
        BEAM, target, 5e-3, BLUE, tol=1e-4, method="scaled angular spectrum", band=(0.75e5,) * 2
    )
    field, truth = gauss(BEAM, 20e-6, 0.0, BLUE), exact_gauss(target, 20e-6, 5e-3, BLUE)
    assert relative(operator(field), truth) <= 1e-4
    plans = len(made)
    assert made[-1] < made[0]
    assert relative(operator(field), truth) <= 1e-4
    assert len(made) == plans


def test_a_target_without_light_is_refused_with_its_share():
    target = Plane((6, 6), (4e-6, 4e-6), (140e-6, 120e-6))
    operator = FreeSpace(BEAM, target, 1e-3, BLUE, tol=1e-4, method="scaled angular spectrum")
    with pytest.raises(ToleranceError, match="hardly any light reaches the target"):
        operator(gauss(BEAM, 20e-6, 0.0, BLUE))


@pytest.mark.parametrize("paraxial", [False, True])
def test_rounding_is_not_taken_for_light(paraxial):
    """A millimetre beside the beam there is a share of 1e-120, and noise of single precision."""
    source, target = Plane((120, 120), (5e-6, 5e-6)), Plane((20, 20), (5e-6, 5e-6), (1e-3, 0.0))
    operator = FreeSpace(source, target, 0.02, BLUE, paraxial=paraxial)
    with pytest.raises(ToleranceError, match="hardly any light reaches the target"):
        operator(gauss(source, 50e-6, 0.0, BLUE))


def advised(error) -> float:
    """The tolerance that a refusal says would do."""
    found = re.search(r"tol (\S+) or more", str(error.value))
    assert found
    return float(found[1])


@pytest.mark.parametrize("paraxial", [False, True])
@pytest.mark.parametrize("method", [None, *METHODS])
@pytest.mark.parametrize("z", some([1e-3, -5e-3]))
def test_advice_before_a_field_is_known_can_be_followed(method, paraxial, z):
    """Where half of the light reaches the target."""
    target, truth = Plane((14, 13), (10e-6, 10e-6)), gauss if paraxial else exact_gauss
    field = gauss(BEAM, 20e-6, 0.0, BLUE)
    ask = partial(
        FreeSpace, BEAM, target, z, BLUE, paraxial=paraxial, method=method, band=(0.95e5,) * 2
    )
    try:
        with pytest.raises(ToleranceError, match="tol 1e-15 can't be kept") as refusal:
            ask(tol=1e-15)
    except ValueError:
        return  # Not a method for this question.
    if "or more" not in str(refusal.value):
        assert method is not None
        return
    tol = advised(refusal)
    assert 1e-12 < tol < 1e-10
    assert relative(ask(tol=tol)(field), truth(target, 20e-6, z, BLUE)) < 1e-8


@pytest.mark.parametrize("aside", [0.0, 30e-6, 55e-6, 80e-6])
@pytest.mark.parametrize("paraxial", [False, True])
def test_advice_for_a_share_of_the_light_can_be_followed(aside, paraxial):
    """Shares of 0.35, 0.02, 9e-6 and 2e-11."""
    target = Plane((4, 5), (4e-6, 4e-6), (aside, 0.0))
    ask = partial(FreeSpace, BEAM, target, 1e-3, BLUE, paraxial=paraxial, band=(0.95e5,) * 2)
    field = gauss(BEAM, 20e-6, 0.0, BLUE)
    with pytest.raises(ToleranceError) as refusal:
        ask(tol=1e-15)
    operator, good = ask(tol=advised(refusal)), ask(tol=1e-3)(field)
    if aside < 40e-6 and paraxial:
        assert relative(operator(field), good) < 1e-3
        return
    with pytest.raises(ToleranceError) as dim:
        operator(field)
    assert ("hardly any light" in str(dim.value)) == (aside > 40e-6)
    assert relative(ask(tol=advised(dim))(field), good) < 1e-3


def test_no_tolerance_is_advised_for_a_share_that_isnt_known():
    target = Plane((6, 6), (4e-6, 4e-6), (140e-6, 120e-6))
    operator = FreeSpace(BEAM, target, 1e-3, BLUE, tol=1e-4, method="scaled angular spectrum")
    with pytest.raises(ToleranceError, match=r"a share of at most .* nearer to the light$"):
        operator(gauss(BEAM, 20e-6, 0.0, BLUE))


def test_darkness_stays_dark():
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    assert not operator(np.zeros((2, *PANEL.shape))).any()
    both = np.stack([np.zeros(PANEL.shape), modulation()])
    assert relative(operator(both)[1], operator(modulation())) < 1e-6


# Bad input.


def test_a_field_that_stands_at_the_edges_is_refused():
    operator = FreeSpace(BEAM, BEAM, 0.01, BLUE)
    with pytest.raises(ValueError, match="edges"):
        operator(np.ones(BEAM.shape))
    y, x = mesh(BEAM)
    cut = np.exp(-((x / 20e-6) ** 2)) * np.ones_like(y)
    with pytest.raises(ValueError, match="edges"):
        operator(cut)


def test_fringes_that_the_samples_don_t_resolve_are_refused():
    field = gauss(BEAM, 20e-6, 0.0, BLUE)
    x = mesh(BEAM)[1]
    fringes = field * np.exp(2j * np.pi * 0.8e5 * x)
    with pytest.raises(ValueError, match="outside carrier"):
        FreeSpace(BEAM, BEAM, 1e-4, BLUE)(fringes)
    told = FreeSpace(BEAM, BEAM, 1e-4, BLUE, carrier=(0.0, 0.8e5))
    assert relative(np.abs(told(fringes)), field) < 0.2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tol": 0.0}, "tol is 0"),
        ({"tol": math.nan}, "tol is nan"),
        ({"method": "magic"}, "method is 'magic'"),
        ({"distance": 0.0}, "distance is 0"),
        ({"wavelength": -1e-6}, "wavelength"),
        ({"cells": (9e-6, 7e-6)}, "cells are"),
        ({"carrier": (math.nan, 0.0)}, "carrier is"),
        ({"tilt": (2.0, 0.0)}, "tilt is"),
        ({"cells": None, "band": (1e5, 1e4)}, "band is"),
    ],
)
def test_a_bad_argument_is_named(change, words):
    arguments = {"distance": 0.05, "wavelength": BLUE, "cells": CELLS, **change}
    with pytest.raises(ValueError, match=words):
        FreeSpace(PANEL, SENSOR, **arguments)


def test_a_bad_field_is_named():
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    with pytest.raises(ValueError, match=r"field is \(3, 3\); its plane has \(12, 10\)"):
        operator(np.ones((3, 3)))
    with pytest.raises(ValueError, match=r"field is \(12, 10\); its plane has \(9, 8\)"):
        operator.adjoint(modulation())
    bad = modulation()
    bad[2, 3] = math.nan
    with pytest.raises(ValueError, match="1 NaN"):
        operator(bad)


@pytest.mark.parametrize("dtype", [torch.complex64, torch.complex128])
@pytest.mark.parametrize("value", [math.inf, complex(0, math.nan), complex(-math.inf, math.inf)])
def test_what_isn_t_finite_is_counted_in_any_field_of_a_batch(dtype, value):
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    bad = torch.from_numpy(modulation(batch=(3,))).to(dtype)
    bad[1, 4, 5] = bad[2, 0, 0] = value
    with pytest.raises(ValueError, match="2 NaN or infinite values of 360"):
        operator(bad)
    back = torch.ones(SENSOR.shape, dtype=dtype)
    back[1, 1] = value
    with pytest.raises(ValueError, match="1 NaN"):
        operator.adjoint(back)


@pytest.mark.parametrize("carrier", [(0.0, 0.0), (60e3, -80e3)])
@pytest.mark.parametrize("beyond", [(80e3, 0.0), (0.0, -80e3), (80e3, 80e3)])
@pytest.mark.parametrize(
    ("dtype", "tol"),
    [(torch.complex64, 1e-3), (torch.complex128, 1e-3), (torch.complex128, 1e-6)],
)
def test_light_beyond_the_band_may_be_worth_half_of_the_tolerance(carrier, beyond, dtype, tol):
    """Two Gaussians that share no light: the second's is known, and wholly beyond 50 per mm."""
    plane = Plane((64, 64), (5e-6, 5e-6))
    operator = FreeSpace(plane, plane, 1e-4, BLUE, carrier=carrier, tol=tol)
    y, x = mesh(plane)

    def fringes(frequency):
        turns = (carrier[0] + frequency[0]) * y + (carrier[1] + frequency[1]) * x
        return np.exp(-(y**2 + x**2) / 30e-6**2 + 2j * np.pi * turns)

    for share, refused in ((0.8, False), (1.25, True)):
        both = fringes((0.0, 0.0)) + 0.5 * tol * math.sqrt(share) * fringes(beyond)
        field = torch.from_numpy(both).to(dtype)
        if not refused:
            operator(field)
            continue
        with pytest.raises(ValueError, match="outside carrier ± band") as said:
            operator(field)
        told = float(re.search(r"share of (\S+) of its", str(said.value)).group(1))
        assert told == pytest.approx(share * (0.5 * tol) ** 2, rel=0.03)


def test_a_single_line_of_a_smooth_field_is_refused_as_all_edge():
    for shape in ((1, 64), (64, 1)):
        line = Plane(shape, (5e-6, 5e-6))
        y, x = mesh(line)
        operator = FreeSpace(line, SENSOR, 0.05, BLUE)
        with pytest.raises(ValueError, match="doesn't vanish at the source's edges"):
            operator(np.exp(-(y**2 + x**2) / 30e-6**2) + 0j)


def test_a_dim_target_s_account_has_the_time_of_all_plans():
    """Direct quadrature's time goes with the pairs of points, which both plans tell."""
    target = Plane((7, 8), (4e-6, 4e-6), (130e-6, -120e-6))
    asked = BEAM, target, 5e-3, BLUE
    settings = {"band": (0.75e5, 0.75e5), "method": "direct quadrature"}
    operator, field = FreeSpace(*asked, **settings), gauss(BEAM, 20e-6, 0.0, BLUE)

    def points(account):
        columns, rows = re.match(r"(\d+)x(\d+) source points", account.sampling).groups()
        return int(columns) * int(rows)

    first = operator.account
    share = np.sum(np.abs(operator(field)) ** 2) * 4e-6**2 / np.sum(np.abs(field) ** 2) / 5e-6**2
    assert share < 1e-3
    both = operator.account
    speed = operator.span.budget.speed
    pair = rayleigh_sommerfeld._PAIR_TOUCHES * speed.touch
    assert both.cpu_predicted - first.cpu_predicted == pytest.approx(
        speed.call + pair * points(both) * 7 * 8
    )
    operator(field)
    assert operator.account == both
    result = propagate(field, *asked, **settings)
    assert result.account.cpu_predicted == both.cpu_predicted


def test_a_method_that_can_t_serve_says_why():
    with pytest.raises(ValueError, match="sharp edges"):
        FreeSpace(PANEL, PANEL, 0.05, BLUE, cells=CELLS, method="angular spectrum")
    with pytest.raises(ToleranceError):
        FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS, tol=1e-15)


# Derivatives.


@pytest.mark.parametrize(
    ("method", "paraxial"),
    [
        ("scaled angular spectrum", False),
        ("band-limited angular spectrum", False),
        ("Fresnel transfer function", True),
        (None, False),
        (None, True),
    ],
)
def test_derivatives_in_field_and_lengths(method, paraxial):
    source = Plane((3, 2), (8e-6, 8e-6))
    generator = torch.Generator().manual_seed(1)
    field = torch.randn(3, 2, dtype=torch.complex128, generator=generator)
    lengths = [torch.tensor(v, dtype=torch.float64) for v in (2.0, 0.5, 0.4, -0.3)]

    def answer(u, z, wavelength, y, x):
        target = Plane((2, 3), source.pitch, (1e-5 * y, 1e-5 * x))
        operator = FreeSpace(
            source,
            target,
            1e-3 * z,
            1e-6 * wavelength,
            cells=CELLS,
            paraxial=paraxial,
            tol=1e-6,
            method=method,
        )
        return torch.view_as_real(operator(u))

    inputs = tuple(value.requires_grad_() for value in (field, *lengths))
    assert torch.autograd.gradcheck(answer, inputs, eps=1e-5, atol=1e-4, rtol=1e-4)


def test_the_whole_band_has_derivatives():
    source = Plane((24, 23), (2e-6, 2e-6))
    field = torch.from_numpy(gauss(source, 8e-6, 0.0, BLUE))
    lengths = [torch.tensor(v, dtype=torch.float64) for v in (2.0, 0.5, 0.4)]

    def answer(strength, z, wavelength, y):
        target = Plane((2, 3), source.pitch, (1e-5 * y, 0.0))
        operator = FreeSpace(
            source,
            target,
            1e-5 * z,
            1e-6 * wavelength,
            tol=2e-3,
            method="angular spectrum",
        )
        operator._propagator.dtype = torch.complex128
        return torch.view_as_real(operator._propagator.forward(strength * field))

    inputs = [torch.tensor(1.0, dtype=torch.float64), *lengths]
    value = answer(*inputs)
    for number, entry in enumerate(inputs):
        leaf = entry.clone().requires_grad_()
        with_grad = [*inputs]
        with_grad[number] = leaf
        (slope,) = torch.autograd.grad(answer(*with_grad).sum(), leaf)
        step = 1e-4
        ends = []
        for sign in (-1, 1):
            moved = [*inputs]
            moved[number] = entry + sign * step
            ends.append(float(answer(*moved).sum(dtype=torch.float64)))
        assert float(slope) == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=2e-2)
    assert value.shape == (2, 3, 2)


def test_two_steps_of_a_descent_with_one_operator():
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    phase = torch.zeros(PANEL.shape, dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.SGD([phase], lr=1.0)
    losses = []
    for _ in range(3):
        optimiser.zero_grad()
        answer = operator(torch.polar(torch.ones_like(phase), phase))
        loss = -(answer[..., 4, 4].abs() ** 2)
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[2] < losses[1] < losses[0]


def test_a_length_is_found_by_descent_and_may_not_change_under_a_plan():
    distance = torch.tensor(0.05, dtype=torch.float64, requires_grad=True)
    operator = FreeSpace(PANEL, SENSOR, distance, BLUE, cells=CELLS)
    for _ in range(2):
        light = (operator(torch.from_numpy(modulation())).abs() ** 2).sum()
        light.backward()
    assert bool(torch.isfinite(distance.grad))
    with torch.no_grad():
        distance += 0.01
    with pytest.raises(ValueError, match="distance has changed"):
        operator(torch.from_numpy(modulation()))


def test_gradients_are_finite_through_a_dark_field():
    operator = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS)
    field = torch.zeros(PANEL.shape, dtype=torch.complex64, requires_grad=True)
    (operator(field).abs() ** 2).sum().backward()
    assert bool(torch.isfinite(torch.view_as_real(field.grad)).all())


def test_scaling_all_lengths_changes_nothing():
    """No criterion has hidden units."""
    small = FreeSpace(PANEL, SENSOR, 0.05, BLUE, cells=CELLS, tol=1e-8)
    by = 1e3

    def grown(plane: Plane) -> Plane:
        pitch, centre = (tuple(by * v for v in pair) for pair in (plane.pitch, plane.centre))
        return replace(plane, pitch=pitch, centre=centre)

    large = FreeSpace(
        grown(PANEL),
        grown(SENSOR),
        0.05 * by,
        BLUE * by,
        cells=(by * CELLS[0], by * CELLS[1]),
        tol=1e-8,
    )
    assert large.method == small.method
    assert relative(large(modulation()), small(modulation())) < 1e-8


@pytest.mark.parametrize("tol", [1e-1, 1e-3, 1e-5])
@pytest.mark.parametrize("aside", some([0.0, 60e-6, 90e-6], 0, 2))
def test_the_told_error_is_neither_less_than_the_true_one_nor_far_above(tol, aside):
    """Shares of the light from nearly all to 1e-4 and 1e-8."""
    waist, z = 20e-6, 5e-3
    target = Plane((17, 18), (4e-6, 4e-6), (aside, -aside))
    field, truth = gauss(BEAM, waist, 0.0, BLUE), exact_gauss(target, waist, z, BLUE)
    operator = FreeSpace(BEAM, target, z, BLUE, tol=tol, band=(0.75e5, 0.75e5))
    error = relative(operator(field), truth)
    assert error <= operator.account.error <= min(tol, 1e-4)


def test_light_that_is_cut_at_the_edges_is_told():
    """A beam whose edges hold nearly the light that a tolerance of 0.1 allows."""
    waist, z = 20e-6, 5e-3
    cut, target = Plane((17, 17), (4e-6, 4e-6)), Plane((21, 21), (4e-6, 4e-6))
    operator = FreeSpace(cut, target, z, BLUE, tol=0.1)
    error = relative(operator(gauss(cut, waist, 0.0, BLUE)), exact_gauss(target, waist, z, BLUE))
    told = operator.account.sampling_error
    assert 1e-3 < error <= told.value
    assert "beyond" in told.how
