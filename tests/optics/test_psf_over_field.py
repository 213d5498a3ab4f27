"""PSFs interpolated over the field, judged by spots that are known everywhere."""

from __future__ import annotations

import math

import pytest
import torch

from optics.accuracy import ToleranceError
from optics.progress import Cancelled, Progress
from optics.psf.over_field import PSFOverField, SensorRegion

REGION = SensorRegion((-3e-3, 2e-3), (1e-3, 7e-3))
PLACES = [(-3e-3, 1e-3), (-2.2e-3, 6.1e-3), (0.0, 4e-3), (1.9e-3, 1.3e-3), (2e-3, 7e-3)]


class Spots:
    """A Gaussian spot that grows, moves and turns over the field, and counts its makers."""

    def __init__(self, strength: float = 1.0) -> None:
        self.strength, self.made = strength, 0

    def __call__(self, place: tuple[float, float]) -> torch.Tensor:
        self.made += 1
        return self.at(*place)

    def at(self, y: float, x: float) -> torch.Tensor:
        row, column = torch.meshgrid(
            *(torch.arange(-12, 12, dtype=torch.float64) for _ in "yx"), indexing="ij"
        )
        wide = 3 + self.strength * 200 * (x + y) + self.strength * 3e4 * x * y
        return torch.exp(-((row - 150 * self.strength * y) ** 2 + column**2) / wide**2)


def error(field: PSFOverField, spots: Spots, place: tuple[float, float]) -> float:
    truth = spots.at(*place)
    return float((field(*place) - truth).norm() / truth.norm())


@pytest.mark.parametrize("tol", [1e-1, 1e-2, 1e-4])
def test_every_place_is_right_to_the_tolerance(tol: float) -> None:
    spots = Spots()
    field = PSFOverField(spots, REGION, tol=tol, max_psfs=500)
    assert field.error.value <= 2 * tol
    assert max(error(field, spots, place) for place in PLACES) <= tol


def test_a_tighter_tolerance_costs_more_nodes_and_no_field_costs_few() -> None:
    nodes = [
        PSFOverField(Spots(), REGION, tol=tol, max_psfs=500).node_count
        for tol in (1e-1, 1e-2, 1e-4)
    ]
    assert nodes == sorted(nodes)
    assert nodes[0] < nodes[-1]
    still = Spots(strength=0.0)
    assert PSFOverField(still, REGION).node_count <= 9
    # Nodes, those of the next level, and the places that are looked at.
    assert still.made <= 12


def test_a_change_that_only_shows_off_both_axes_is_seen() -> None:
    def crossed(place: tuple[float, float]) -> torch.Tensor:
        v, u = REGION.relative_position(*place)
        return torch.tensor([[1.0, 1 + 0.5 * v * u]], dtype=torch.float64)

    field = PSFOverField(crossed, REGION, tol=1e-3)
    for place in PLACES:
        assert torch.allclose(field(*place), crossed(place), rtol=1e-3)


def test_one_place_and_one_line_need_no_nodes_beside_them() -> None:
    spots = Spots()
    alone = PSFOverField(spots, SensorRegion((1e-3, 1e-3), (2e-3, 2e-3)))
    assert alone.node_count == 1
    assert torch.equal(alone(1e-3, 2e-3), spots.at(1e-3, 2e-3))
    line = PSFOverField(spots, SensorRegion((1e-3, 1e-3), (0.0, 2e-3)), tol=1e-3)
    assert error(line, spots, (1e-3, 0.7e-3)) <= 1e-3


def test_no_light_is_less_than_none() -> None:
    def edge(place: tuple[float, float]) -> torch.Tensor:
        light = 0.05 + max(place[1] - 4e-3, 0.0) * 200 * torch.ones(3, 3, dtype=torch.float64)
        return light - 0.05

    field = PSFOverField(edge, REGION, tol=0.05, max_psfs=500)
    for x in (1e-3 + 6e-3 * k / 40 for k in range(41)):
        assert float(field(0.0, x).min()) >= 0


def test_what_cannot_be_kept_names_what_is_left() -> None:
    with pytest.raises(ToleranceError, match=r"tol 1e-06 .* by 20 PSFs .* leave .* allow more"):
        PSFOverField(Spots(), REGION, tol=1e-6, max_psfs=20)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: PSFOverField(Spots(), REGION, tol=0.0), "tol is 0"),
        (lambda: PSFOverField(Spots(), REGION, max_psfs=0), "max_psfs is 0"),
        (lambda: SensorRegion((1e-3, -1e-3), (0.0, 0.0)), "y is 0.001 to -0.001 m"),
        (lambda: SensorRegion((0.0, math.inf), (0.0, 0.0)), "y is 0 to inf m"),
        (lambda: PSFOverField(Spots(), REGION)(0.0, 8e-3), "x is 0.008 m; the region .* 0.007 m"),
    ],
)
def test_bad_input_is_named(make, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_it_can_be_cancelled() -> None:
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        PSFOverField(Spots(), REGION, progress=progress)
