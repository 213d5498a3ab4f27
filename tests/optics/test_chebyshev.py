"""Smooth functions over a plane, against the functions themselves."""

from __future__ import annotations

import pytest
import torch

from optics.chebyshev import ChebyshevExpansion, expand_in_chebyshev
from optics.plane import Plane

PLANE = Plane((21, 34), (2e-3, 1e-3), (5e-3, -0.01))


def polynomial(y, x):
    return 3 - 40 * y + 2e3 * y * x**2 - 1e6 * y**3 * x**3


def test_a_polynomial_is_known_by_its_degree_and_one():
    y, x = PLANE.mesh()
    found = ChebyshevExpansion(polynomial, PLANE, 4).rows(slice(None))
    torch.testing.assert_close(found, polynomial(y, x), rtol=1e-13, atol=1e-13)


def test_rows_are_those_of_the_whole():
    known = ChebyshevExpansion(polynomial, PLANE, 4)
    torch.testing.assert_close(known.rows(slice(5, 9)), known.rows(slice(None))[5:9])


@pytest.mark.parametrize("strength", [1.0, 30.0, 1e5])
def test_what_is_no_polynomial_takes_as_many_nodes_as_it_needs(strength):
    def sag(y, x):
        return strength * torch.sqrt(1 + 20 * (y - x) ** 2 + 300 * y * y)

    known = expand_in_chebyshev(sag, PLANE)
    assert known is not None
    torch.testing.assert_close(known.rows(slice(None)), sag(*PLANE.mesh()), rtol=2e-14, atol=0)


def test_a_kink_is_told():
    assert expand_in_chebyshev(lambda y, x: (y + x).abs(), PLANE) is None


def test_one_sample_and_nothing():
    one = Plane((1, 1), (1e-3, 1e-3), (0.2, -0.1))
    known = expand_in_chebyshev(polynomial, one)
    assert known is not None
    expected = polynomial(*one.mesh())
    torch.testing.assert_close(known.rows(slice(None)), expected)
    dark = expand_in_chebyshev(lambda y, x: 0 * y * x, PLANE)
    assert dark is not None
    assert not dark.rows(slice(None)).any()
