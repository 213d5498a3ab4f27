"""Quadrature nodes, against integrals of powers."""

import pytest

from optics.gauss_legendre import gauss_legendre


@pytest.mark.parametrize("count", [1, 2, 7, 24, 64])
def test_powers_up_to_twice_the_count_are_integrated(count):
    nodes, weights = gauss_legendre(count)
    for degree in range(2 * count):
        exact = 2 / (degree + 1) if degree % 2 == 0 else 0.0
        assert (weights * nodes**degree).sum() == pytest.approx(exact, abs=1e-13)


def test_nobody_can_change_what_others_share():
    nodes, weights = gauss_legendre(5)
    for shared in (nodes, weights):
        with pytest.raises(ValueError, match="read-only"):
            shared *= 2


def test_no_nodes_are_refused():
    with pytest.raises(ValueError, match="count is 0; quadrature takes 1 node or more"):
        gauss_legendre(0)
