"""Masked arrays: their masked values are missing pixels, or refused in words; never light."""

from __future__ import annotations

import numpy as np
import pytest

from labapp.files.cubes import SpectralCube
from optics import metrics
from optics.camera import Sensor
from optics.hdr import Bracket, ExposureLimits, Meter, fit_response, merge_by_response
from optics.inverse import build_mosaic_observation, build_observation, restore
from optics.measuring import focus_score, line_profile, region_statistics
from optics.measuring.slanted_edge import measure_edge_response
from optics.multispectral import PsfMerit, dispersion_power, fourier_coverage
from optics.slm.panel import PanelMap

PICTURE = np.random.default_rng(0).random((24, 32))
HOLE = np.s_[3:6, 10:14]
PSF = np.ones((3, 3)) / 9


def masked(values=PICTURE):
    found = np.ma.array(values, mask=np.zeros(values.shape, bool))
    found[..., 3:6, 10:14] = np.ma.masked
    found.data[..., 3:6, 10:14] = 200
    return found


def weights_with_hole():
    found = np.ones_like(PICTURE)
    found[HOLE] = 0
    return found


def test_masked_pixels_of_a_photograph_are_dead_ones():
    """As a photograph that has these weights, and nothing under the mask."""
    told = PICTURE * weights_with_hole(), PSF, 0.01, "unknown", weights_with_hole()
    told = build_observation(*told)
    found = build_observation(masked(), PSF, noise=0.01)
    assert isinstance(restore(found).image, np.ndarray)
    np.testing.assert_array_equal(restore(found).image, restore(told).image)
    np.testing.assert_array_equal(found.weights, weights_with_hole())
    both = build_observation(masked(), PSF, noise=0.01, weights=np.full_like(PICTURE, 0.5))
    np.testing.assert_array_equal(both.weights, weights_with_hole() / 2)
    nothing = build_observation(np.ma.array(PICTURE), PSF, noise=0.01)
    assert nothing.weights is None
    mosaic = build_mosaic_observation(masked(), ("RG", "GB"), PSF, noise=0.01)
    np.testing.assert_array_equal(mosaic.weights, weights_with_hole())


WHOLE = np.stack([PICTURE] * 3)
SENSOR = Sensor()
EIGHT = (255 * PICTURE).astype(np.uint8)


@pytest.mark.parametrize(
    "use",
    [
        lambda: build_observation(PICTURE, masked()),
        lambda: build_observation(masked(), PSF, weights=masked()),
        lambda: build_observation(PICTURE, PSF, variance=masked()),
        lambda: metrics.psnr(masked(), PICTURE, 1.0),
        lambda: Bracket([PICTURE, masked()], [1, 2], [0, 0], [1, 1], SENSOR),
        lambda: Bracket(masked(WHOLE), [1, 2, 3], [0] * 3, [1] * 3, SENSOR),
        lambda: Meter(SENSOR, ExposureLimits(1e-3, 1.0), 0.1, 20.0).add(0.1, masked()),
        lambda: fit_response([EIGHT, masked(EIGHT)], [1, 2]),
        lambda: merge_by_response([masked(EIGHT)], [1], None),
        lambda: focus_score(masked(), SENSOR),
        lambda: line_profile(masked(), (1, 1), (9, 9)),
        lambda: region_statistics(masked(EIGHT), None, 255),
        lambda: measure_edge_response(masked()),
        lambda: PanelMap(masked()),
        lambda: fourier_coverage(masked(WHOLE)),
        lambda: dispersion_power(masked(WHOLE)),
        lambda: PsfMerit(masked(), ("RG", "GB"), np.ones((4, 3)), 0.01, generator=None),
    ],
)
def test_masked_values_that_nothing_can_stand_for_are_refused(use):
    with pytest.raises(ValueError, match=r"masked values of \d+ was given.*method filled\(\)"):
        use()


def test_masked_values_of_a_cube_are_missing():
    cube = SpectralCube(masked(WHOLE), (450e-9, 550e-9, 650e-9))
    assert np.isnan(cube.values[(slice(None), *HOLE)]).all()
    np.testing.assert_array_equal(cube.missing, weights_with_hole() == 0)
