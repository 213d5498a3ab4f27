"""Nodes of a recipe's axes: wavelengths, the filter's angles, depths, and places in the field."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import constants

from optics.camera import Camera
from optics.gauss_legendre import gauss_legendre
from optics.light import Spectrum
from optics.light.bands import Band
from optics.plane import Plane
from optics.sensor import Mosaic
from simulator.filter_angles import angle_nodes, largest_squared_sine, squared_sines
from simulator.probing.picture_probe import irradiance_per_radiance
from simulator.recipe import Recipe
from simulator.scene.target import Part
from simulator.situation import Situation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wavelength:
    """A wavelength node in metres; leak: whether it represents light outside the band."""

    metres: float
    leak: bool = False


@dataclass(frozen=True, eq=False)
class Wavelengths:
    """The wavelength nodes of a picture, and the weights of its parts at them.

    weights: (channels, parts, nodes): times electrons_per_radiance(), electrons per second and
    pixel where the part's picture is 1 and all light arrives. aslant: how much more or less they
    are at further angles of the filter's light, (angles - 1, channels, parts, nodes).
    """

    nodes: tuple[Wavelength, ...]
    weights: Array
    aslant: Array


def wavelengths(s: Situation, recipe: Recipe, parts: Sequence[Part]) -> Wavelengths:
    """Return the Gauss nodes of all light that counts, and each part's weights at them.

    The weights are those of the interpolating polynomial: they add up to all of a part's electrons,
    for any number of nodes. Without light there are no nodes. They are the same for all angles.
    """
    curves = channel_efficiencies(s, recipe)
    spectra = [part.spectrum for part in parts]
    squared = rendered_angles(s, recipe)
    nodes: list[Wavelength] = []
    weights: list[Array] = [np.zeros((len(squared), len(curves), len(parts), 0))]
    for leak, count in ((False, recipe.wavelengths), (True, recipe.leak)):
        if count:
            x, measures = electrons_by_angle(spectra, curves, s.band, squared, leak=leak)
            found, each = gauss_quadrature(x, measures, count)
            nodes += [Wavelength(float(one), leak) for one in found]
            weights.append(each)
    at_angles = np.concatenate(weights, axis=3)
    return Wavelengths(tuple(nodes), at_angles[0], at_angles[1:] - at_angles[0])


def rendered_angles(s: Situation, recipe: Recipe) -> list[float]:
    """Return sin² of the angles at which light passes the filter, that of the axis first."""
    if recipe.angles == 1 or not s.band.shifts_with_angle:
        return [0.0]
    return angle_nodes(largest_squared_sine(s.camera), recipe.angles)


def electrons_by_angle(
    spectra: Sequence[Spectrum],
    curves: Sequence[Spectrum],
    band: Band,
    squared: Sequence[float],
    *,
    leak: bool,
) -> tuple[Array, Array]:
    """Return electrons_by_wavelength() for light that passes the filter at some angles.

    squared: sin² of each. The result is points in metres, and (angles, curves, spectra, points).
    """
    if len(squared) == 1 or leak:
        x, measure = electrons_by_wavelength(spectra, curves, band, leak)
        return x, np.stack([measure] * len(squared))
    bands = [band.at_angle(one) for one in squared]
    ends = min(one.support[0] for one in bands), max(one.support[1] for one in bands)

    def transmission(x: Array) -> Array:
        return np.stack([one.transmission(x) for one in bands])[:, None, None]

    x, measure = _electrons(spectra, curves, ends, transmission)
    return x, measure if x.size else np.zeros((len(squared), *measure.shape))


def electrons_by_wavelength(
    spectra: Sequence[Spectrum], curves: Sequence[Spectrum], band: Band, leak: bool
) -> tuple[Array, Array]:
    """Return the electrons by wavelength for light in a filter's band, or in its leak.

    The result is points in metres, none without light, and each point's share of the integral in
    electrons per joule of white light, (curves, spectra, points).
    """
    if not leak:
        return _electrons(spectra, curves, band.support, band.transmission)
    ends = band.leak_range if band.leak else (0.0, 0.0)
    return _electrons(spectra, curves, ends, lambda x: np.asarray(band.leak))


def _electrons(
    spectra: Sequence[Spectrum],
    curves: Sequence[Spectrum],
    ends: tuple[float, float],
    transmission: Callable[[Array], Array],
) -> tuple[Array, Array]:
    """Return electrons_by_wavelength() of light between two wavelengths that is transmitted."""
    if not spectra:
        return np.zeros(0), np.zeros((len(curves), 0, 0))
    every = [*spectra, *curves]
    low = max(ends[0], min(one.low for one in spectra), min(one.low for one in curves))
    high = min(ends[1], max(one.high for one in spectra), max(one.high for one in curves))
    if low >= high:
        return np.zeros(0), np.zeros((len(curves), len(spectra), 0))
    # Gauss-Legendre between the spectra's kinks, in 20 intervals at least. Tables may have hundreds
    # of kinks: the points per interval are limited to 4 to 24, for about 4000 in all.
    kinks = {low, high, *np.linspace(low, high, 20 + 1).tolist()}
    kinks.update(x for one in every for x in one.wavelengths if low < x < high)
    edges = np.array(sorted(kinks))
    node, weight = gauss_legendre(max(4, min(24, 4000 // len(edges))))
    half = np.diff(edges)[:, None] / 2
    x = ((edges[:-1] + edges[1:])[:, None] / 2 + half * node).ravel()
    w = (half * weight).ravel()
    photons = x / (constants.h * constants.c)
    sent = np.stack([one.at(x) for one in spectra])
    density = np.stack([one.at(x) for one in curves])[:, None] * (sent * photons)
    return x, density * (w * transmission(x))


def channel_efficiencies(s: Situation, recipe: Recipe) -> tuple[Spectrum, ...]:
    """Return the electrons per photon of each channel.

    Without a mosaic in the recipe, the only channel is the mean over the mosaic's pixels.
    """
    sensor = s.camera.sensor
    if sensor.colour is not None:
        curves = tuple(sensor.colour.efficiencies[name] for name in sensor.colour.channels)
        return curves if recipe.mosaic else (mean_curve(sensor.colour),)
    return (sensor.spectral_efficiency or Spectrum.flat(sensor.quantum_efficiency),)


def mean_curve(colour: Mosaic) -> Spectrum:
    """Return a colour mosaic's mean electrons per photon."""
    letters = "".join(colour.pattern)
    curves = [(colour.efficiencies[name], letters.count(name)) for name in colour.channels]
    nodes = sorted({x for curve, _ in curves for x in curve.wavelengths})
    total = np.zeros(len(nodes))
    for curve, count in curves:
        total += curve.at(nodes) * (count / len(letters))
    return Spectrum(tuple(nodes), tuple(total))


def gauss_quadrature(x: Array, measures: Array, count: int) -> tuple[Array, Array]:
    """Return the Gauss nodes of a sum of measures at points x, and each measure's weights at them.

    measures: (..., points), not negative. The weights, (..., nodes), integrate polynomials of a
    degree below the number of nodes as the measure does; for the sum, up to twice that. Points
    without weight have no nodes. Golub and Welsch (1969), from the recursion that Lanczos' method
    finds.
    """
    total = measures.sum(tuple(range(measures.ndim - 1)))
    mass = total.sum()
    if not mass > 0:
        return np.zeros(0), np.zeros((*measures.shape[:-1], 0))
    scale = (x.max() - x.min()) / 2 or 1.0
    away = (x - (x.max() + x.min()) / 2) / scale
    root = np.sqrt(total / mass)
    basis, diagonal, beside = [root], [], []
    while True:
        rest = away * basis[-1]
        diagonal.append(float(basis[-1] @ rest))
        if len(diagonal) == count:
            break
        for _ in range(2):  # One pass isn't orthogonal enough.
            for known in basis:
                rest = rest - (known @ rest) * known
        length = float(np.linalg.norm(rest))
        if length < 1e-12:
            break
        basis.append(rest / length)
        beside.append(length)
    matrix = np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1)
    nodes, vectors = np.linalg.eigh(matrix)
    # Each measure's moments with the orthogonal polynomials give its weights at the nodes.
    lit = root > 0
    polynomials = np.stack(basis)[:, lit] / root[lit]
    moments = measures[..., lit] @ polynomials.T
    each = moments @ (vectors * vectors[0])
    return (x.max() + x.min()) / 2 + scale * nodes, each


def electrons_per_radiance(camera: Camera, distance: float) -> float:
    """Return the factor from spectral electrons to a pixel's electrons per second, m² sr.

    It is the camera equation of optics.camera.system_mtf.electron_rate without the light.
    """
    return irradiance_per_radiance(camera, distance) * camera.sensor.pitch**2


def depth_nodes(distances: Sequence[float], count: int) -> dict[float, list[tuple[float, float]]]:
    """Return for each distance the distances whose PSFs stand for it, and their weights.

    `count` nodes are evenly spaced in 1/distance from the farthest to the nearest; a single one is
    in the middle. PSFs between two are their weighted mean. Fewer distances are their own nodes.
    """
    if count < 1:
        raise ValueError(f"{count} depths; there is one at least")
    different = sorted({1 / d for d in distances})
    if count >= len(different):
        return {d: [(d, 1.0)] for d in distances}
    low, high = different[0], different[-1]
    if count == 1:
        middle = 2 / (low + high)
        return {d: [(middle, 1.0)] for d in distances}
    step = (high - low) / (count - 1)
    found = {}
    for d in distances:
        below = min(int((1 / d - low) / step), count - 2)
        share = (1 / d - low) / step - below
        ends = ((below, 1 - share), (below + 1, share))
        steps = [(low + k * step, w) for k, w in ends if w > 1e-12]
        found[d] = [(1 / one if one > 0 else math.inf, w) for one, w in steps]
    return found


def field_nodes(count: int, half: float) -> list[float]:
    """Return the places of PSFs along an axis of the field.

    These are Chebyshev points of the second kind from -half to half; a single one is in the middle.
    """
    if count == 1:
        return [0.0]
    return [-half * math.cos(math.pi * k / (count - 1)) for k in range(count)]


def interpolation_weights(nodes: Sequence[float], at: Array) -> Array:
    """Return the weights that interpolate between nodes, (nodes, points), constant beyond them.

    They are those of the polynomial through the nodes, by the barycentric formula (Berrut and
    Trefethen 2004, doi 10.1137/S0036144502417715).
    """
    if len(nodes) == 1:
        return np.ones((1, len(at)))
    # Products of many differences keep their size if the nodes span 4.
    places = np.asarray(nodes) * (4 / (nodes[-1] - nodes[0]))
    apart = places[:, None] - places
    np.fill_diagonal(apart, 1.0)
    away = np.clip(at, nodes[0], nodes[-1]) * (4 / (nodes[-1] - nodes[0])) - places[:, None]
    on_node = away == 0
    away[on_node] = 1.0
    weights = 1 / (apart.prod(axis=1)[:, None] * away)
    met = on_node.any(axis=0)
    weights[:, met] = on_node[:, met]
    return np.asarray(weights / weights.sum(axis=0))


_TABLE = 1025  # values between which shares are interpolated linearly, right to 1e-5. Chosen.


def angle_share(squared: Sequence[float], angle: int, camera: Camera, plane: Plane) -> torch.Tensor:
    """Return the weight of one of the filter's angles at each place of a plane, float32.

    squared: sin² of all angles, between which bands are interpolated by a polynomial.
    """
    table = np.linspace(0, squared[-1], _TABLE)
    share = interpolation_weights(squared, table)[angle]
    found = np.interp(squared_sines(camera, plane).numpy(), table, share)
    return torch.from_numpy(found.astype(np.float32))
