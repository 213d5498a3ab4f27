import math

import numpy as np
import pytest
import torch

from optics.plane import Plane
from simulator.scene.disc import Disc
from simulator.scene.display import Windows
from simulator.scene.drawable import UniformLight
from simulator.scene.pixel_picture import PixelPicture
from simulator.scene.polygons import Polygons, rectangle

PLANE = Plane((23, 30), (4e-6, 5e-6))
SCALE = 0.05
FINER = 40


def supersampled(inside, plane=PLANE, finer=FINER):
    """Mean over each cell of a function of y and x on the sensor, by finer^2 points in it."""
    y, x = (
        (np.arange(n * finer) + 0.5) / finer * p - (n // 2 + 0.5) * p + c
        for n, p, c in zip(plane.shape, plane.pitch, plane.centre, strict=True)
    )
    values = inside(y[:, None], x[None, :]) * np.ones((y.size, x.size))
    rows, columns = plane.shape
    return values.reshape(rows, finer, columns, finer).mean(axis=(1, 3))


def in_triangle(corners):
    def inside(y, x):
        signs = []
        for (y0, x0), (y1, x1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            signs.append((x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0)
        return (signs[0] == signs[1]) & (signs[1] == signs[2])

    return inside


@pytest.mark.parametrize("seed", range(6))
def test_a_polygon_covers_what_many_points_find(seed):
    """Triangles in either direction, some partly off the plane on any side."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-90e-6, 90e-6, (3, 2)) + rng.uniform(-40e-6, 40e-6, 2)
    drawn = Polygons((tuple(map(tuple, corners / SCALE)),), (1.0,)).light(PLANE, SCALE)
    expected = supersampled(in_triangle(corners))
    assert drawn.dtype == torch.float32
    assert drawn.numpy() == pytest.approx(expected, abs=1.5 / FINER)
    assert np.abs(drawn.numpy() - expected).mean() < 1e-3


def test_a_rectangle_off_the_grid_covers_its_area_wherever_it_stands():
    for angle in (0.0, 0.3, -1.2):
        for centre in ((0.0, 0.0), (1e-4, -2.1e-4)):
            picture = Polygons((rectangle(centre, (3.3e-4, 7.1e-4), angle),), (0.5,), 0.25)
            light = picture.light(PLANE, SCALE).double()
            cells = 3.3e-4 * 7.1e-4 * SCALE**2 / (4e-6 * 5e-6)
            assert light.sum().item() == pytest.approx(23 * 30 * 0.25 + 0.25 * cells, rel=1e-5)


def test_a_shift_moves_a_picture_on_the_object():
    """4 µm on the sensor are a row down, 5 µm a column to the right."""
    picture = Polygons((rectangle((0.0, 0.0), (1e-4, 2e-4), 0.2),), (1.0,))
    moved = picture.light(PLANE, SCALE, (4e-6 / SCALE, 10e-6 / SCALE))
    expected = np.roll(picture.light(PLANE, SCALE).numpy(), (1, 2), axis=(0, 1))
    assert moved.numpy() == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    "picture", [Disc(3e-4, (1e-4, -2e-4)), PixelPicture(torch.ones(2, 3), 1e-4, (2e-4, 1e-4))]
)
def test_any_picture_moves_by_a_shift_and_an_offset_alike(picture):
    from dataclasses import replace

    y, x = picture.offset
    moved = replace(picture, offset=(y + 3e-5, x - 4e-5)).light(PLANE, SCALE)
    assert picture.light(PLANE, SCALE, (3e-5, -4e-5)).numpy() == pytest.approx(
        moved.numpy(), abs=1e-6
    )


def test_a_disc_covers_what_many_points_find():
    disc = Disc(1.1e-3, (1e-4, -2e-4))
    y0, x0, r = 1e-4 * SCALE, -2e-4 * SCALE, 0.55e-3 * SCALE
    expected = supersampled(lambda y, x: (y - y0) ** 2 + (x - x0) ** 2 < r**2)
    assert disc.light(PLANE, SCALE).numpy() == pytest.approx(expected, abs=1.5 / FINER)
    assert disc.light(PLANE, SCALE).sum().item() == pytest.approx(
        math.pi * r**2 / (4e-6 * 5e-6), rel=1e-5
    )


def test_the_spectrum_of_cells_is_that_of_the_picture_itself():
    """A disc's is known exactly: cells give it back as far as they resolve it."""
    disc = Disc(1e-3, (1e-4, -2e-4))
    fine = Plane((92, 120), (1e-6, 1.25e-6))
    exact, sampled = disc.spectrum(fine, SCALE), super(Disc, disc).spectrum(fine, SCALE)
    assert sampled.dtype == exact.dtype == torch.complex64
    coarse = (slice(0, 12), slice(0, 16))
    error = (exact - sampled)[coarse].abs().max() / exact[0, 0].abs()
    assert float(error) < 2e-3


def test_a_disc_off_the_plane_sends_nothing():
    disc = Disc(3e-4, (1.0, 0.0))
    assert not disc.light(PLANE, SCALE).any()
    assert not disc.spectrum(PLANE, SCALE).any()


def test_a_disc_larger_than_the_plane_fills_it():
    light = Disc(1.0).light(PLANE, SCALE)
    assert light.numpy() == pytest.approx(1.0)
    spectrum = Disc(1.0).spectrum(PLANE, SCALE)
    assert torch.fft.irfft2(spectrum, s=PLANE.shape).numpy() == pytest.approx(1.0, abs=1e-5)


def test_even_light_is_even_and_its_spectrum_one_number():
    spectrum = UniformLight(0.5).spectrum(PLANE, SCALE)
    picture = torch.fft.irfft2(spectrum, s=PLANE.shape)
    assert picture.numpy() == pytest.approx(UniformLight(0.5).light(PLANE, SCALE).numpy(), abs=1e-6)


@pytest.mark.parametrize("side", [13e-5, 2e-5])
def test_a_picture_is_linear_between_its_pixels_and_averaged_over_cells(side):
    """Against many points of each cell and scipy's linear interpolation, larger and smaller."""
    from scipy.interpolate import RegularGridInterpolator

    rng = np.random.default_rng(1)
    image = rng.uniform(0, 1, (5, 7))
    drawn = PixelPicture(torch.tensor(image), side, (2e-5, -3e-5)).light(PLANE, SCALE).numpy()
    y = (np.arange(5) - 2) * side * SCALE + 2e-5 * SCALE
    x = (np.arange(7) - 3) * side * SCALE - 3e-5 * SCALE
    half = side * SCALE / 2

    def value(at_y, at_x):
        held = np.broadcast_arrays(np.clip(at_y, y[0], y[-1]), np.clip(at_x, x[0], x[-1]))
        values = RegularGridInterpolator((y, x), image)(np.stack(held, -1))
        inside = (abs(at_y - (y[0] + y[-1]) / 2) < 2 * side * SCALE + half) & (
            abs(at_x - (x[0] + x[-1]) / 2) < 3 * side * SCALE + half
        )
        return values * inside

    assert drawn == pytest.approx(supersampled(value), abs=0.03)
    assert np.abs(drawn - supersampled(value)).mean() < 2e-3


def test_a_displays_windows_are_lit_and_nothing_between_them():
    image = np.array([[1.0, 0.5], [0.25, 0.0]])
    windows = Windows(torch.tensor(image), 7e-4, (0.1, 0.9), (1 / 3, 2 / 3))
    p = 7e-4 * SCALE

    def value(y, x):
        row, column = np.floor(y / p + 1), np.floor(x / p + 1)
        v, u = y / p + 1 - row, x / p + 1 - column
        lit = (v > 0.1) & (v < 0.9) & (u > 1 / 3) & (u < 2 / 3)
        inside = (row >= 0) & (row < 2) & (column >= 0) & (column < 2)
        return np.where(
            lit & inside, image[row.clip(0, 1).astype(int), column.clip(0, 1).astype(int)], 0
        )

    drawn = windows.light(PLANE, SCALE).numpy()
    assert drawn == pytest.approx(supersampled(value), abs=2.5 / FINER)
    area = 0.8 / 3 * p**2 / (4e-6 * 5e-6)
    assert drawn.sum() == pytest.approx(1.75 * area, rel=1e-5)


@pytest.mark.parametrize("shape", [(24, 30), (25, 31)])
@pytest.mark.parametrize("pitch", [7e-4, 3e-5])
def test_a_displays_spectrum_is_that_of_its_windows_whatever_the_samples(shape, pitch):
    """Against the sum over windows, one by one, of what each one's edges give."""
    image = torch.rand(3, 4, generator=torch.Generator().manual_seed(1))
    windows = Windows(image, pitch, (0.1, 0.8), (1 / 3, 0.6))
    plane, shift = Plane(shape, (4e-6, 5e-6), (1e-6, -2e-6)), (3e-5, -1e-5)
    found = windows.spectrum(plane, SCALE, shift).numpy()
    fy = np.fft.fftfreq(shape[0], 4e-6)[:, None]
    fx = np.fft.rfftfreq(shape[1], 5e-6)[None]
    p, expected = pitch * SCALE, 0
    for i, row in enumerate(image.numpy()):
        for j, value in enumerate(row):
            y = [(i - 1.5 + end) * p + 3e-5 * SCALE - 1e-6 for end in windows.rows]
            x = [(j - 2.0 + end) * p - 1e-5 * SCALE + 2e-6 for end in windows.columns]
            expected = expected + value * integral(fy, *y) * integral(fx, *x) / 2e-11
    assert np.abs(found - expected).max() <= 1e-5 * np.abs(expected).max()


def integral(frequency, low, high):
    """Of exp(-2 pi i f y) from low to high."""
    f = np.where(frequency == 0, 1.0, frequency)
    turned = (np.exp(-2j * np.pi * f * low) - np.exp(-2j * np.pi * f * high)) / (2j * np.pi * f)
    return np.where(frequency == 0, high - low, turned)


def test_of_a_display_what_lies_beyond_the_plane_is_not_in_its_spectrum():
    """A display far larger than the plane has the light of the windows that meet it."""
    windows = Windows(torch.ones(400, 300), 3e-5, (0.0, 1.0), (0.0, 1.0))
    plane = Plane((24, 30), (4e-6, 5e-6))
    total = float(windows.spectrum(plane, SCALE)[0, 0].real)
    assert (
        24 * 30 <= total <= (24 * 4e-6 + 2 * 3e-5 * SCALE) * (30 * 5e-6 + 2 * 3e-5 * SCALE) / 2e-11
    )


def test_what_is_infinitely_far_away_has_no_size():
    assert not PixelPicture(torch.ones(2, 2), 1e-3).light(PLANE, 0.0).any()
    assert not Windows(torch.ones(2, 2), 1e-3, (0, 1), (0, 1)).light(PLANE, 0.0).any()
    assert not Windows(torch.ones(2, 2), 1e-3, (0, 1), (0, 1)).spectrum(PLANE, 0.0).any()
    assert not Disc(1e-3).light(PLANE, 0.0).any()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Disc(0.0), "diameter is 0 m"),
        (lambda: Disc(1e-3, (math.nan, 0.0)), "offset is"),
        (lambda: Polygons((((0, 0), (1, 1)),), (1.0,)), "fewer than 3 corners"),
        (lambda: Polygons((((0, 0), (1, 1), (0, math.inf)),), (1.0,)), "isn't finite"),
        (lambda: Polygons((), (1.0,)), "0 polygons and 1 values"),
        (lambda: PixelPicture(torch.ones(2), 1e-3), r"image is \(2,\)"),
        (lambda: PixelPicture(torch.full((2, 2), math.nan), 1e-3), "image has 4 NaN"),
        (lambda: PixelPicture(torch.ones(2, 2), 0.0), "side is 0 m"),
        (lambda: PixelPicture(torch.ones(2, 2), 1.0, (0.0, math.inf)), "offset is"),
    ],
)
def test_a_picture_that_cannot_be_drawn_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
