"""What a stop leaves of waves at the lens, block by block, against areas by exact integration."""

import itertools
import math

import numpy as np
import pytest
import torch
from judges import covered
from sweeps import some

from optics.camera.stop import Circle, Stop, rectangle, regular_polygon
from optics.plane import Plane
from optics.psf.stop_mask import BlockwiseStopMask

RADIUS = 1e-3
STOPS = {
    "round": Stop(),
    "hexagon": Stop(regular_polygon(6, turn=0.3), (Circle(0.2, (0.1, -0.2)),)),
    "spider": Stop(Circle(), (rectangle(0.05, 2.2), rectangle(2.2, 0.05))),
    "slit": Stop(rectangle(0.01, 1.8)),
}
PLANES = {
    "wide": Plane((40, 300), (70e-6, 9e-6)),
    "tall, odd": Plane((197, 129), (13e-6, 21e-6)),
    "beside": Plane((64, 150), (11e-6, 10e-6), (0.6e-3, -0.8e-3)),
    "smaller than a cell": Plane((5, 7), (0.4e-3, 0.3e-3)),
}


def cut(openings: BlockwiseStopMask, field: torch.Tensor) -> torch.Tensor:
    """The whole field after the stop."""
    passed = field.clone()
    for number, rows in enumerate(openings.row_blocks):
        openings.apply(passed[rows], number)
    return passed


@pytest.mark.parametrize(
    ("number", "name"),
    some(itertools.product(range(len(STOPS)), PLANES), *(5 * n % 16 for n in range(8))),
)
def test_every_sample_keeps_its_open_share(number, name):
    stop, plane = list(STOPS.values())[number], PLANES[name]
    share = covered(stop, RADIUS, plane)
    rng = np.random.default_rng(0)
    field = rng.normal(size=(*plane.shape, 2)) @ (1, 1j)
    openings = BlockwiseStopMask(stop, RADIUS, plane, torch.float64)
    passed = cut(openings, torch.from_numpy(field)).numpy()
    assert np.abs(passed - share * field).max() <= 1e-9 * np.abs(field).max()
    power = sum(
        openings.open_power(torch.from_numpy(field[rows]), number)
        for number, rows in enumerate(openings.row_blocks)
    )
    assert power == pytest.approx(float((share * np.abs(field) ** 2).sum()), rel=1e-9)


def test_blocks_hold_all_rows_once():
    rows = BlockwiseStopMask(Stop(), RADIUS, PLANES["tall, odd"], torch.float64).row_blocks
    assert [n for part in rows for n in range(197)[part]] == list(range(197))


def test_shares_are_kept_only_where_the_edge_runs():
    """Of a large grid a round stop's edge takes a small part; what it encloses needs none."""
    plane = Plane((1024, 1024), (2.4e-6, 2.4e-6))
    blocks = BlockwiseStopMask(Stop(), RADIUS, plane, torch.float32).segments_by_block
    shares = [s.share for block in blocks for s in block if s.share is not None]
    assert all(share.dtype == torch.float32 for share in shares)
    kept = sum(share.numel() for share in shares)
    # The edge of 2 pi r crosses cells of 16 x 64 samples: each counts for its height or width.
    radius = RADIUS / 2.4e-6
    assert kept <= 8 * radius * (16 + 64)
    assert kept >= 2 * math.pi * radius


def test_a_dark_block_is_closed_without_any_share():
    far = Plane((20, 100), (1e-5, 1e-5), (5e-3, 0.0))
    openings = BlockwiseStopMask(Stop(), RADIUS, far, torch.float64)
    assert not cut(openings, torch.ones(far.shape, dtype=torch.complex128)).any()
    assert all(s.share is None for block in openings.segments_by_block for s in block)
    assert openings.open_power(torch.ones((16, 100), dtype=torch.complex128), 0) == 0
