"""Pixels that are filled in far from any valid one, as in the clipped half of a photograph."""

from __future__ import annotations

import pytest
import torch

from optics.inverse.observation import _inpaint

ROWS, DEPTH, SIDE = 6, 140, 10


def test_a_wide_gap_takes_about_a_pass_a_pixel_and_has_the_nearest_light(monkeypatch):
    """Light of 1 on the left of the gap and of 3 on its right, and what is in it is nonsense."""
    image = torch.full((ROWS, 2 * (SIDE + DEPTH)), 1e9, dtype=torch.float64)
    valid = torch.zeros(image.shape, dtype=torch.bool)
    for columns, light in ((slice(None, SIDE), 1.0), (slice(-SIDE, None), 3.0)):
        image[:, columns], valid[:, columns] = light, True
    passes, pool = [], torch.nn.functional.avg_pool2d
    monkeypatch.setattr(
        torch.nn.functional, "avg_pool2d", lambda *given: (passes.append(given), pool(*given))[1]
    )
    filled = _inpaint(image, valid)
    half = SIDE + DEPTH
    assert filled[:, :half].numpy() == pytest.approx(1.0)
    assert filled[:, half:].numpy() == pytest.approx(3.0)
    # Two pictures a pass: light, and the share of valid pixels.
    assert len(passes) / 2 < 1.5 * DEPTH
