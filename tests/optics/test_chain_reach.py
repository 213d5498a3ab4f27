"""A panel near to its stop: its pixels' light is followed only so far sideways as tol takes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from judges import relative

from optics.accuracy import Budget
from optics.camera import Camera, Lens, Panel
from optics.camera.stop import Stop, regular_polygon
from optics.camera.stop_rows import quadrature_rows, row_bands
from optics.plane import Plane
from optics.propagation.fresnel_matrix import cell_kernel
from optics.psf import PSFOperator
from optics.psf import chain_direct as direct
from optics.psf.pixel_fields import FAR_ZONES, far_fields

SHAPE, PIXELS = (12, 16), Plane((4, 6), (4e-6, 4e-6))


def camera(separation=2e-5) -> Camera:
    panel = Panel(SHAPE, 12e-6, fill_factor=0.9, unmodulated=0.0)
    lens = Lens(0.006, 40, 0.8, Stop(regular_polygon(5, turn=0.2)))
    return Camera(panel, lens, separation=separation)


def operator(tol: float, **settings) -> PSFOperator:
    return PSFOperator(
        camera(), 0.7, 600e-9, PIXELS, integrate=False, tol=tol, method="chain, direct", **settings
    )


@pytest.mark.parametrize("side", [-1, 1])
def test_far_fields_are_the_exact_ones(side):
    area, pixel = 1e-11, 8e-6
    place = np.linspace(0, 2e-5, 30)
    away = FAR_ZONES * np.sqrt(area) + pixel
    line = np.arange(50) * 9e-6 + (2e-5 + away if side > 0 else -away - 49 * 9e-6)
    offset = torch.from_numpy(place[:, None] - line)
    exact = cell_kernel(offset, pixel, torch.tensor(area, dtype=torch.float64)).numpy()
    turns = offset.numpy() ** 2 / area
    assert (np.abs(far_fields(place, line, pixel, area) - exact) <= 1e-15 * (10 + turns)).all()


@pytest.fixture
def whole(monkeypatch) -> PSFOperator:
    """A PSF of all light."""
    with monkeypatch.context() as patch:
        patch.setattr(direct, "_WORTHWHILE_SEARCHES", math.inf)
        return operator(1e-9)


def test_light_that_is_left_out_matters_less_than_tol(whole, rng):
    phase = rng.uniform(0, 2 * np.pi, SHAPE)
    truth = whole(phase)
    for tol in (1e-2, 1e-4, 1e-6):
        limited = operator(tol)
        assert limited.engine._sum.row_count < whole.engine._sum.row_count
        assert 1e-12 < relative(limited(phase), truth) <= limited.account.error <= tol


def test_chunks_of_rows_give_the_same_light(rng):
    phase = rng.uniform(0, 2 * np.pi, SHAPE)
    some, one = operator(1e-5, budget=Budget(memory=3_000_000)), operator(1e-5)
    assert len(some.engine._sum._chunks) > len(one.engine._sum._chunks)
    assert relative(some(phase), one(phase)) <= 1e-12


def test_parts_of_a_stop_add_up():
    rows = quadrature_rows(row_bands(Stop(regular_polygon(5))), 50.0, 50.0, 1e-14)
    areas = [part.weight @ np.bincount(part.row, part.sign * part.end) for part in rows.split(17)]
    whole = rows.weight @ np.bincount(rows.row, rows.sign * rows.end)
    assert sum(areas) == pytest.approx(whole, rel=1e-13)
