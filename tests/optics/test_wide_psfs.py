"""Wide PSFs with little noise and an unknown border, where restorations are ill-conditioned."""

from __future__ import annotations

import numpy as np
import pytest
from sweeps import some
from test_model_error import capture, photographs, psnr

from labapp.accuracy.blurs import circle
from optics.inverse import build_observation, find_psf_scale, judge_restoration, restore
from optics.inverse.choice import METHODS
from optics.inverse.total_variation import total_variation
from optics.inverse.wiener import wiener

RING, NOISE = circle(20.0, 0.1), 0.002


@pytest.fixture(scope="module")
def captures():
    return [capture(scene, RING, NOISE, 5) for scene in photographs()[:2]]


QUICK = [name for name, one in METHODS.items() if not one.needs_denoiser and name != "l-bfgs-b"]


@pytest.mark.parametrize("method", QUICK)
def test_no_tier_is_worse_than_the_picture_as_taken(captures, method):
    for truth, frame in captures:
        before = psnr(frame, truth)
        for count in METHODS[method].gains:
            found = restore(build_observation(frame, RING), method=method, count=count)
            assert psnr(found.image, truth) > before + 0.5


def test_wiener_takes_the_weight_that_its_steps_can_solve(captures):
    """More steps allow a smaller weight, down to the one with the least predicted error."""
    _, frame = captures[0]
    weights = [wiener(build_observation(frame, RING), steps=n).weight for n in (5, 10, 30, 2000)]
    assert weights == sorted(weights, reverse=True)
    assert weights[0] > 10 * weights[-1]
    exact = build_observation(frame, RING, border="periodic")
    assert wiener(exact, steps=5).weight == wiener(exact, steps=30).weight


def test_total_variation_converges_in_tens_of_iterations(captures):
    """Against five times as many for the same weight."""
    for truth, frame in captures:
        soon = restore(build_observation(frame, RING))
        late = total_variation(build_observation(frame, RING), soon.weight, iterations=300)
        assert soon.iterations == 60
        assert psnr(soon.image, truth) > psnr(late.image, truth) - 0.7


@pytest.mark.parametrize("turn", some([np.rot90, np.fliplr, np.flipud], 0, 1))
def test_a_picture_that_is_turned_has_the_same_verdict_and_weight(turn):
    _, frame = capture(photographs()[1][:, :230], circle(6.0, 0.0), 0.005, 2)
    seen = [
        build_observation(np.ascontiguousarray(one), np.ascontiguousarray(psf))
        for one, psf in ((frame, circle(6.0, 0.0)), (turn(frame), turn(circle(6.0, 0.0))))
    ]
    restored = [restore(one) for one in seen]
    assert seen[1].noise == pytest.approx(seen[0].noise, rel=1e-6)
    assert restored[1].weight == pytest.approx(restored[0].weight, rel=0.02)
    verdicts = [
        str(judge_restoration(one, image, find_psf_scale(one)))
        for one, image in zip(seen, restored, strict=True)
    ]
    assert verdicts[0] == verdicts[1]
