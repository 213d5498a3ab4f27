"""Where on the sensor a panel's gratings send light, and how much goes into their first orders."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from optics.camera import Sensor
from optics.measuring.spots import Spot, frame_variance

Array = NDArray[np.float64]

_FEWEST = 4  # steered spots of a registration, at least

Flip = Literal["none", "left-right", "up-down", "both"]
"""Without a mirror, of x, of y, and of both."""


@dataclass(frozen=True)
class AffineParts:
    """Parts of an affine map: reflection, shear, scale and rotation, applied in this order.

    rotation: radians from x towards y, at most a quarter turn in either direction.
    scale: (y, x) camera pixels per cycle per panel pixel.
    shear: that of x by y, as a tangent.
    """

    flip: Flip
    rotation: float
    scale: tuple[float, float]
    shear: float


@dataclass(frozen=True, eq=False)
class Registration:
    """Where gratings send light: to centre + matrix @ vector on the sensor.

    wavelength: metres; the distance from the centre is proportional to it.
    centre: (y, x) pixel of the zeroth order.
    matrix: (2, 2), camera pixels per cycle per panel pixel, (y, x) of both.
    covariance: (3, 3) of centre and matrix, the same for y and for x, pixels².
    shift: (y, x) pixels by which all steered spots were displaced from the map, as happens when the
        response differs over the panel.
    residuals: (spots, 2) pixels, measured less fitted.
    inliers: which spots were used in the fit; the others are outliers.
    """

    wavelength: float
    centre: tuple[float, float]
    matrix: Array
    covariance: Array
    shift: tuple[float, float]
    residuals: Array
    inliers: NDArray[np.bool_]

    def to_pixels(self, vectors: Array, wavelength: float | None = None) -> Array:
        """Convert grating vectors (..., 2) to sensor pixels; both are (y, x)."""
        turned = vectors @ self.matrix.T
        return np.asarray(self.centre) + self._wavelength_ratio(wavelength) * turned

    def to_vectors(self, pixels: Array, wavelength: float | None = None) -> Array:
        """Return the grating vectors, (..., 2), that send light to sensor pixels (..., 2)."""
        away = (pixels - np.asarray(self.centre)) / self._wavelength_ratio(wavelength)
        return away @ np.linalg.inv(self.matrix).T

    def uncertainty(self, vectors: Array) -> Array:
        """Compute the standard deviation in pixels, (...), the same along both axes.

        vectors: grating vectors, (..., 2).
        """
        ones = np.ones((*vectors.shape[:-1], 1))
        design = np.concatenate([ones, vectors], axis=-1)
        return np.sqrt(np.einsum("...i,ij,...j", design, self.covariance, design))

    def field_uncertainty(self, shape: tuple[int, int]) -> float:
        """Compute the largest uncertainty on a sensor, (rows, columns): at a corner, in pixels."""
        corners = np.array(list(itertools.product((0, shape[0] - 1), (0, shape[1] - 1))), float)
        return float(self.uncertainty(self.to_vectors(corners)).max())

    @property
    def residual(self) -> float:
        """The root mean square misfit of inlier spots, pixels."""
        return float(np.sqrt((self.residuals[self.inliers] ** 2).sum(1).mean()))

    @property
    def parts(self) -> AffineParts:
        return decompose_affine(self.matrix)

    def _wavelength_ratio(self, wavelength: float | None) -> float:
        """Return a wavelength over that of the registration."""
        return 1.0 if wavelength is None else wavelength / self.wavelength


def register(vectors: Array, spots: Sequence[Spot], wavelength: float) -> Registration:
    """Fit the map from panel to sensor to grating vectors and their spots.

    vectors: (spots, 2) cycles per panel pixel; (0, 0) is the zeroth order of a neutral pattern,
        which must be among them.
    wavelength: metres.

    If the panel's response differs from region to region and isn't known yet, the displayed
    gratings have phase steps or slopes between the regions, which shift all steered spots equally.
    This shift is fitted together with the map. The map's centre is the zeroth order.

    Outliers are spots that don't fit a map of the others. All maps through three steered spots are
    tried. The one with the most inliers is kept, and fitted to these by weighted least squares
    (Fischler and Bolles 1981, doi 10.1145/358669.358692, with every sample instead of random ones).

    Raises ValueError for fewer than four steered spots or no zeroth order, for vectors that lie on
    a line, and if fewer than four spots agree on one map.
    """
    vectors = np.asarray(vectors, dtype=np.float64)
    steered = _find_steered_spots(vectors, spots)
    places = np.array([spot.place for spot in spots])
    # Besides its noise, a centroid may have a systematic error of 0.01 pixel.
    sigma = np.hypot([spot.sigma for spot in spots], 0.01)
    design = np.column_stack([np.ones(len(vectors)), vectors, steered])
    used = ~steered
    used[steered] = _find_consensus(design[steered, :3], places[steered], sigma[steered])
    if used[steered].sum() < _FEWEST:
        raise ValueError(
            f"only {used[steered].sum()} of {steered.sum()} spots agree on one map from panel to "
            f"sensor, and {_FEWEST} are needed; check that the star is in focus and that nothing "
            "but the panel sends light to the frame"
        )
    weight = 1 / sigma[used, None]
    weighted = design[used] * weight
    solution, *_ = np.linalg.lstsq(weighted, places[used] * weight, rcond=None)
    residuals = places - design @ solution
    freedom = 2 * (int(used.sum()) - 4)
    chi2 = float(((residuals[used] * weight) ** 2).sum()) / freedom
    # If the spots scatter by more than their noise, the covariance is larger by as much.
    covariance = np.linalg.inv(weighted.T @ weighted)[:3, :3] * max(chi2, 1.0)
    (y, x), *linear, (down, right) = solution.tolist()
    matrix = np.array(linear).T.copy()
    return Registration(wavelength, (y, x), matrix, covariance, (down, right), residuals, used)


def _find_steered_spots(vectors: Array, spots: Sequence[Spot]) -> NDArray[np.bool_]:
    """Tell which spots are steered.

    Raises ValueError if the spots don't determine a registration.
    """
    if vectors.shape != (len(spots), 2):
        raise ValueError(f"vectors are {vectors.shape}; {len(spots)} spots need ({len(spots)}, 2)")
    steered: NDArray[np.bool_] = np.hypot(*vectors.T) > 0
    if steered.all():
        raise ValueError("no vector is (0, 0); give the zeroth order of a neutral pattern too")
    if steered.sum() < _FEWEST:
        raise ValueError(
            f"{steered.sum()} steered spots were found; a registration needs {_FEWEST} at least"
        )
    spread = np.linalg.svd(vectors[steered] - vectors[steered].mean(0), compute_uv=False)
    if spread[1] < 1e-3 * spread[0]:
        raise ValueError("the vectors lie on a line; give gratings of several directions")
    return steered


def _find_consensus(design: Array, places: Array, sigma: Array) -> NDArray[np.bool_]:
    """Find the spots that agree with the best map through any three of them."""
    # A spot is an inlier within 5 standard deviations, or within half a pixel, because the lens
    # distorts.
    allowed = np.maximum(0.5, 5.0 * sigma)
    best, fewest = np.zeros(len(places), dtype=bool), math.inf
    for three in itertools.combinations(range(len(places)), 3):
        some = design[list(three)]
        if abs(np.linalg.det(some)) < 1e-12:
            continue
        away = np.hypot(*(places - design @ np.linalg.solve(some, places[list(three)])).T)
        doubt = float((np.minimum(away / allowed, 1) ** 2).sum())
        if doubt < fewest:
            best, fewest = away <= allowed, doubt
    return best


def decompose_affine(matrix: Array) -> AffineParts:
    """Decompose a (2, 2) matrix, of (y, x), into flip, rotation, scale and shear.

    Raises ValueError if it is singular.
    """
    turned = matrix[::-1, ::-1]
    if abs(np.linalg.det(turned)) < 1e-9 * np.abs(turned).max() ** 2:
        raise ValueError("the matrix sends all gratings to one line; it is no registration")
    found = []
    for name, (y, x) in zip(get_args(Flip), itertools.product((1.0, -1.0), repeat=2), strict=True):
        mirror = np.diag([x, y])
        q, r = np.linalg.qr(turned @ mirror)
        signs = np.sign(np.diag(r))
        q, r = q * signs, (r.T * signs).T
        if np.linalg.det(q) >= 0:
            angle, scale = math.atan2(q[1, 0], q[0, 0]), (float(r[1, 1]), float(r[0, 0]))
            found.append(AffineParts(name, angle, scale, float(r[0, 1] / r[0, 0])))
    return min(found, key=lambda parts: abs(parts.rotation))


@dataclass(frozen=True, eq=False)
class FirstOrders:
    """Light in one region's first orders, (frames,), and its noise.

    clipped: (frames,) whether a pixel of the windows was at full scale.
    windows: (rows, columns) of the pixels of both spots, or of the one that is on the sensor.
    """

    light: Array
    noise: Array
    clipped: NDArray[np.bool_]
    windows: tuple[tuple[slice, slice], ...]


def measure_first_orders(
    frames: Sequence[NDArray[np.uint16]],
    dark: Array,
    registration: Registration,
    vectors: Array,
    region_shape: tuple[int, int],
    sensor: Sensor,
    wavelength: float,
) -> list[FirstOrders]:
    """Measure every region's first-order light in a sweep of gratings.

    frames: digital numbers as read.
    dark: the mean dark frame of the same exposure time.
    vectors: grating vectors of the regions, (regions, 2).
    region_shape: (rows, columns) of a region's panel pixels.

    The light is weighted by the shapes of the region's spots. A pixel's weight is its mean in the
    brighter half of the sweep less that in the dimmer half. All pixels of a spot vary in
    proportion, so that any weights keep the dependence on the phase step; these weights give the
    least noise. Hot pixels have no weight. Raises ValueError if a region's spots lie outside of the
    frame, or are clipped in more than a fifth of the frames.
    """
    # A pixel of a dark frame is hot from 8 standard deviations of read noise on.
    hot = dark - np.median(dark) > 8.0 * sensor.read_noise / sensor.gain + 1
    stretch = wavelength / registration.wavelength
    line = stretch * np.hypot(*(registration.matrix / np.array(region_shape)).T)
    # A spot extends over three line widths of its region's grating, and at least two more pixels
    # because of the star's size, the filter's band and the lens.
    reach = np.ceil(3.0 * line + 2.0).astype(int)
    found = []
    for number, vector in enumerate(vectors, 1):
        windows = []
        for order in (1, -1):
            middle = np.rint(registration.to_pixels(order * vector, wavelength)).astype(int)
            low, high = middle - reach, middle + reach + 1
            if (low >= 0).all() and (high <= np.array(dark.shape)).all():
                windows.append((slice(low[0], high[0]), slice(low[1], high[1])))
        if not windows:
            raise ValueError(
                f"both first orders of region {number} fall outside of the frame; choose "
                "longer periods, or let more of the sensor be read"
            )
        orders = _measure_region(frames, dark, hot, tuple(windows), sensor)
        if orders.clipped.mean() > 0.2:
            raise ValueError(
                f"the spots of region {number} are clipped in {orders.clipped.sum()} of "
                f"{len(frames)} frames; expose them shorter"
            )
        found.append(orders)
    return found


def _measure_region(
    frames: Sequence[NDArray[np.uint16]],
    dark: Array,
    hot: NDArray[np.bool_],
    windows: tuple[tuple[slice, slice], ...],
    sensor: Sensor,
) -> FirstOrders:
    """Measure one region's first-order light in all frames."""

    def cut(frame: NDArray[Any]) -> Array:
        return np.concatenate([frame[window].ravel() for window in windows]).astype(np.float64)

    raw = np.stack([cut(frame) for frame in frames])
    usable = cut(hot) == 0
    light = raw - cut(dark)
    order = np.argsort(light[:, usable].sum(axis=1))
    half = len(order) // 2
    shape = light[order[half:]].mean(axis=0) - light[order[:half]].mean(axis=0)
    weight = np.where(usable, np.clip(shape, 0, None), 0.0)
    weight /= math.sqrt(float((weight**2).sum())) or 1.0
    noise = np.sqrt(frame_variance(raw, sensor) @ weight**2)
    clipped = ((raw >= sensor.full_scale) & usable).any(axis=1)
    return FirstOrders(light @ weight, noise, clipped, windows)
