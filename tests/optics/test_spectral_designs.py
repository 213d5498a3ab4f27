"""Families of spectral PSFs by their moments, and a search that sees only predictions."""

import math

import numpy as np
import pytest
import torch

from optics.multispectral import (
    dot_psfs,
    linear_dispersion_psfs,
    predict_errors,
    ring_psfs,
    search_design,
    spiral_psfs,
)
from optics.plane import Plane
from optics.progress import Cancelled, Progress

PIXEL = 2e-6
PLANE = Plane((41, 41), (PIXEL, PIXEL))
WAVELENGTHS = (450e-9, 550e-9, 700e-9)
RADIUS = 15 * PIXEL
SHARE = 0.2
FAMILIES = {
    "ring": lambda **k: ring_psfs(PLANE, WAVELENGTHS, RADIUS, **k),
    "rings": lambda **k: ring_psfs(PLANE, WAVELENGTHS, RADIUS, count=3, **k),
    "spiral": lambda **k: spiral_psfs(PLANE, WAVELENGTHS, RADIUS, **k),
    "dots": lambda **k: dot_psfs(PLANE, WAVELENGTHS, [(RADIUS, 0.0), (0.0, RADIUS)], **k),
    "linear": lambda **k: linear_dispersion_psfs(PLANE, WAVELENGTHS, RADIUS, **k),
}


def moments(psf):
    """Mean (y, x), and mean distance from the axis, in metres."""
    at = (np.arange(41) - 20) * PIXEL
    far = np.hypot(at[:, None], at)
    psf = psf / psf.sum()
    return (psf.sum(1) @ at, psf.sum(0) @ at), (psf * far).sum()


@pytest.mark.parametrize("name", FAMILIES)
def test_every_psf_sums_to_1_and_keeps_its_share_on_the_axis(name):
    plain, mixed = (FAMILIES[name](unmodulated=share).numpy() for share in (0.0, SHARE))
    assert mixed.sum((1, 2)) == pytest.approx([1, 1, 1], rel=1e-12)
    assert mixed.min() >= 0
    peak = np.zeros((41, 41))
    peak[20, 20] = SHARE
    assert mixed == pytest.approx((1 - SHARE) * plain + peak, abs=1e-15)


@pytest.mark.parametrize("name", ["ring", "rings", "spiral", "dots"])
def test_sizes_grow_with_the_wavelength(name):
    sizes = [moments(psf)[1] for psf in FAMILIES[name]().numpy()]
    assert np.array(sizes) / sizes[-1] == pytest.approx(np.array(WAVELENGTHS) / 700e-9, rel=0.02)


def test_a_ring_lies_at_its_radius_and_three_share_the_light_by_their_length():
    assert moments(FAMILIES["ring"]().numpy()[-1])[1] == pytest.approx(RADIUS, rel=0.01)
    # Radii of 1, 2 and 3 thirds, with as large shares of the light: (1 + 4 + 9) / (3 · 6).
    three = moments(FAMILIES["rings"]().numpy()[-1])[1]
    assert three == pytest.approx(RADIUS * 14 / 18, rel=0.01)


def test_dots_and_a_prism_lie_at_their_positions():
    (y, x), _ = moments(FAMILIES["dots"]().numpy()[0])
    assert (y, x) == pytest.approx([RADIUS / 2 * 450 / 700] * 2, rel=1e-3)
    places = [moments(psf)[0] for psf in FAMILIES["linear"](direction=math.pi / 2).numpy()]
    assert [x for _, x in places] == pytest.approx([0, 0, 0], abs=1e-9)
    assert [y / RADIUS for y, _ in places] == pytest.approx([-1, -0.2, 1], rel=1e-3)


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize(
    ("argument", "value"), [("unmodulated", 1.5), ("unmodulated", math.nan), ("width", -1.0)]
)
def test_bad_arguments_are_named(name, argument, value):
    with pytest.raises(ValueError, match=argument):
        FAMILIES[name](**{argument: value})


def test_impossible_designs_are_refused():
    with pytest.raises(ValueError, match="wavelengths is empty"):
        ring_psfs(PLANE, (), RADIUS)
    with pytest.raises(ValueError, match="wavelength is -1"):
        spiral_psfs(PLANE, (500e-9, -1.0), RADIUS)
    with pytest.raises(ValueError, match="two that differ"):
        linear_dispersion_psfs(PLANE, (500e-9, 500e-9), RADIUS)
    with pytest.raises(ValueError, match="doesn't fit"):
        ring_psfs(PLANE, WAVELENGTHS, 25 * PIXEL)
    with pytest.raises(ValueError, match="count"):
        ring_psfs(PLANE, WAVELENGTHS, RADIUS, count=0)


RESPONSE = np.array([[0.1, 0.1, 0.8], [0.2, 0.8, 0.1], [0.7, 0.1, 0.1]])
SPECTRA = np.array([[1, 0.9, 0.8], [0.2, 0.5, 0.9], [0.8, 0.4, 0.1], [0.1, 0.1, 0.2]])


def predict(psfs):
    return predict_errors(psfs, RESPONSE, ("RG", "GB"), SPECTRA, 0.02, period=48).mean_psnr


def search(merit=predict, seed=0, **options):
    given = {"unmodulated": SHARE, "candidates": 6, "steps": 12, **options}
    generator = torch.Generator().manual_seed(seed)
    return search_design(merit, PLANE, WAVELENGTHS, RADIUS, generator=generator, **given)


def test_what_is_found_beats_the_families_and_keeps_light_and_size():
    found = search()
    assert found.level == pytest.approx(predict(found.psfs))
    for name in ("ring", "rings", "spiral"):
        assert found.level >= predict(FAMILIES[name](unmodulated=SHARE))
    assert found.psfs.sum((1, 2)).numpy() == pytest.approx([1, 1, 1])
    places = np.array(found.positions)
    assert np.hypot(*places.T).max() == pytest.approx(RADIUS)
    assert places.mean(0) == pytest.approx([0, 0], abs=1e-3 * PIXEL)


def test_the_same_seed_finds_the_same():
    one, same, other = search(), search(), search(seed=1)
    assert torch.equal(one.psfs, same.psfs)
    assert one.positions != other.positions


def test_the_search_follows_the_merit_that_it_is_given():
    """By a merit that likes light far from the axis, a ring or a polygon is best."""
    at = torch.arange(41, dtype=torch.float64) - 20
    far = torch.hypot(at[:, None], at)

    def outwards(psfs):
        return float((psfs * far).sum())

    found = search(outwards)
    middle = float((found.psfs[-1] * far).sum())
    assert middle == pytest.approx((1 - SHARE) * 15, rel=0.03)


def test_progress_runs_to_the_end_and_a_search_can_be_cancelled():
    seen = list[float]()
    search(progress=Progress(lambda fraction, message: seen.append(fraction)))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        search(progress=progress)


@pytest.mark.parametrize(
    ("argument", "value"), [("candidates", 0), ("steps", 0), ("unmodulated", -0.1)]
)
def test_bad_arguments_of_a_search_are_named(argument, value):
    with pytest.raises(ValueError, match=argument):
        search(**{argument: value})


@pytest.mark.parametrize("radius", [0.0, 5 * PIXEL])
def test_a_radius_without_room_for_dots_is_refused(radius):
    with pytest.raises(ValueError, match="radius"):
        search_design(
            predict, PLANE, WAVELENGTHS, radius, unmodulated=0.2, generator=torch.Generator()
        )
