"""Predict the operations of rendering a picture from the levels of all effects.

The ledger counts a rendered picture's operations by the same rules.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from optics.slm.modulator import flicker_nodes
from simulator.effects.psf_bounds import can_orders_reach_sensor, is_uniform_scene
from simulator.effects.result_cache import cached_per_situation
from simulator.formation.coarse_orders import can_be_coarse
from simulator.formation.layer_psfs import groups_of_parts
from simulator.formation.windows import (
    Windows,
    psf_operations,
    ray_operations,
    rendering_windows,
    transform_operations,
)
from simulator.recipe import SMALLEST_WINDOW, light_samples
from simulator.situation import Situation


@dataclass(frozen=True)
class RenderingLevels:
    """What a recipe's fields are at each level, the coarsest first. All values were chosen.

    Of the panel's orders at level 1, two on each side are rendered on cells of pixels instead,
    where that is possible. Field aberrations change more over the field than the stop's shadow.
    """

    wavelengths: tuple[int, ...] = (1, 2, 3, 5, 7, 9, 13, 17, 25, 33)  # nodes in the band
    leak: tuple[int, ...] = (0, 4, 8, 16)  # nodes outside it
    depths: tuple[int, ...] = (1, 2, 3, 5, 9, 17, 33)  # nodes of distance
    places: tuple[int, ...] = (1, 3, 5, 9)  # nodes along each axis of the field
    aberrated_places: tuple[int, ...] = (1, 3, 5, 9, 17)
    angles: tuple[int, ...] = (1, 2, 3, 5, 9)  # at which light passes the filter
    orders: tuple[int, ...] = (0, 1, 2)  # on each side
    samples: tuple[int, ...] = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)  # along a pixel
    windows: tuple[int, ...] = (SMALLEST_WINDOW, 128, 256, 512, 1024, 2048, 4096)  # sensor pixels


LEVELS = RenderingLevels()

FILTER_BANDWIDTH, OUT_OF_BAND_LEAK = "filter bandwidth", "out-of-band leak"
FIELD_POSITION, FIELD_ABERRATIONS, VIGNETTING = "field position", "field aberrations", "vignetting"
DIFFRACTION, PANEL_ORDERS, PSF_REACH = "diffraction", "panel orders", "PSF reach"
PANEL_DISPERSION, POLARISATION_INTERFERENCE = "panel dispersion", "polarisation interference"
OCCLUSION, LENS_GHOSTS, LATERAL_COLOUR = "occlusion", "lens ghosts", "lateral colour"
LIGHT_SAMPLING, COLOUR_FILTERS = "light sampling", "colour filter array"
DEPTH_LAYERS, FLICKER, FILTER_ANGLE = "depth layers", "flicker", "filter angle"

ATTRIBUTION_ORDER = (
    PSF_REACH,
    LIGHT_SAMPLING,
    DIFFRACTION,
    FILTER_BANDWIDTH,
    OUT_OF_BAND_LEAK,
    PANEL_DISPERSION,
    POLARISATION_INTERFERENCE,
    FIELD_POSITION,
    FIELD_ABERRATIONS,
    VIGNETTING,
    PANEL_ORDERS,
    LENS_GHOSTS,
    FILTER_ANGLE,
)
"""Order in which operations are told apart: each effect's are those that it adds to the ones
before."""

# Effects whose levels change the number of operations.
_RELEVANT_EFFECTS = (
    *ATTRIBUTION_ORDER,
    DEPTH_LAYERS,
    COLOUR_FILTERS,
    FLICKER,
    OCCLUSION,
    LATERAL_COLOUR,
)


class _Counts(NamedTuple):
    """Counts of the steps of rendering a picture."""

    psfs: float  # of the zeroth order
    orders: float  # other orders of each PSF
    transforms: float  # of all samples, except for those of pictures when they are drawn
    pictures: float  # that are drawn


def added_operations(s: Situation, levels: Mapping[str, int], name: str) -> float:
    """Return the operations that an effect adds to those before it in ATTRIBUTION_ORDER."""
    place = ATTRIBUTION_ORDER.index(name)
    # Only levels that matter are read: a plan asks again only if one of those changes.
    seen = {
        one: levels.get(one, 0)
        for one in _RELEVANT_EFFECTS
        if one not in ATTRIBUTION_ORDER[place + 1 :]
    }
    return max(rendering_operations(s, seen) - rendering_operations(s, {**seen, name: 0}), 0.0)


def rendering_operations(s: Situation, levels: Mapping[str, int]) -> float:
    """Return the operations of rendering at given levels, without the sensor's stages."""
    return _operations(s, tuple(levels.get(one, 0) for one in _RELEVANT_EFFECTS))


@cached_per_situation
def _operations(s: Situation, found: tuple[int, ...]) -> float:
    """Return the operations of rendering, cached by the levels that matter."""
    levels = dict(zip(_RELEVANT_EFFECTS, found, strict=True))
    wave, panel = bool(levels[DIFFRACTION]), s.camera.panel
    of_psf, of_light = s.coarsest_sampling, light_samples_at(s, levels)
    coarse = wave and are_orders_coarse(s, levels[PANEL_ORDERS])
    if coarse:
        levels[PANEL_ORDERS] = 0
    windows = _windows_at(s, levels)
    counts = _count_steps(s, levels, apart=not windows.merged_orders)
    down, across = (n * of_psf for n in windows.psf)
    one = psf_operations if wave else ray_operations
    transform = transform_operations(*(n * of_light for n in windows.picture))
    pixels = transform_operations(*windows.picture)
    # A picture may be drawn on more samples than the light has.
    drawn = math.ceil(LEVELS.samples[levels[LIGHT_SAMPLING]] / of_light)
    drawing = counts.pictures * transform * float(drawn**2)
    beside = (n * of_psf for n in windows.side_order)
    of_order = counts.orders * one(panel, *beside)
    spreading = counts.psfs * (one(panel, down, across) + of_order)
    cells = 0.0
    if coarse:
        # The side orders of each PSF on cells take a far field.
        cells = counts.psfs * (3 * transform_operations(*(3 * n // 2 for n in panel.shape)))
    return spreading + counts.transforms * transform + drawing + pixels + cells


def _windows_at(s: Situation, levels: Mapping[str, int]) -> Windows:
    wave, order = bool(levels.get(DIFFRACTION, 0)), levels.get(PANEL_ORDERS, 0)
    by_psfs = wave and not are_orders_coarse(s, order)
    return _windows(
        s,
        LEVELS.windows[levels.get(PSF_REACH, 0)],
        LEVELS.orders[order] if by_psfs else 0,
        wave,
        (s.coarsest_sampling, light_samples_at(s, levels)),
        bool(levels.get(LENS_GHOSTS, 0)),
    )


@cached_per_situation
def _windows(
    s: Situation, window: int, orders: int, wave: bool, samples: tuple[int, int], ghosts: bool
) -> Windows:
    """Return rendering_windows(), which many combinations of levels share."""
    return rendering_windows(s, window, orders=orders, wave=wave, samples=samples, ghosts=ghosts)


def picture_samples_at(s: Situation, levels: Mapping[str, int]) -> tuple[int, int]:
    """Return the samples (rows, columns) of a rendered picture."""
    rows, columns = (n * light_samples_at(s, levels) for n in _windows_at(s, levels).picture)
    return rows, columns


def picture_transform_operations(s: Situation, levels: Mapping[str, int]) -> float:
    """Return the operations of a Fourier transform of a picture, blurred by the zeroth order."""
    windows = rendering_windows(s, LEVELS.windows[levels.get(PSF_REACH, 0)])
    return transform_operations(*(n * light_samples_at(s, levels) for n in windows.picture))


def channel_count_at(s: Situation, levels: Mapping[str, int]) -> int:
    """Return the number of colour channels that are rendered."""
    colour = s.camera.sensor.colour
    return len(colour.channels) if colour and levels.get(COLOUR_FILTERS, 0) else 1


def are_orders_coarse(s: Situation, level: int) -> bool:
    """Whether a level of the panel's orders renders them on cells of pixels."""
    return level == 1 and can_be_coarse(s)


def light_samples_at(s: Situation, levels: Mapping[str, int]) -> int:
    """Return the samples of blurred light in a pixel along each axis."""
    drawn = LEVELS.samples[levels.get(LIGHT_SAMPLING, 0)]
    return light_samples(s.coarsest_sampling, drawn, occlusion=bool(levels.get(OCCLUSION, 0)))


def _count_steps(s: Situation, levels: Mapping[str, int], *, apart: bool) -> _Counts:
    """Count rendering's steps; apart: whether the panel's side orders have PSFs of their own."""
    layers = s.target.layers
    distances, places = {layer.distance for layer in layers}, place_count_at(levels)
    wave, nodes = bool(levels[DIFFRACTION]), wavelength_count_at(levels)
    depths = min(LEVELS.depths[levels[DEPTH_LAYERS]], len(distances))
    fields = 2 if levels[POLARISATION_INTERFERENCE] else 1
    if levels[FLICKER]:
        reach = max(float(phase.abs().max()) for phase in s.pattern_probe.phases)
        fields *= len(flicker_nodes(s.camera.panel.flicker, reach, s.numerics))
    orders = 0
    if apart and can_orders_reach_sensor(s):
        orders = (2 * LEVELS.orders[levels[PANEL_ORDERS]] + 1) ** 2 - 1
    channels = channel_count_at(s, levels)
    parts = sum(len(groups_of_parts(layer, channels, nodes)) for layer in layers)
    # Light of further angles is weighted over the field, and added.
    angles = LEVELS.angles[levels[FILTER_ANGLE]]
    parts *= angles
    psfs = nodes * depths * places * fields * max(1, len(s.panel_content.pictures))
    if is_uniform_scene(s) and not levels[VIGNETTING] and angles == 1:
        # Uniform light stays uniform however it is blurred: no PSF is needed.
        psfs = parts = 0
    # Each part is transformed once. If its light is weighted over the field, it is transformed
    # back, and then once for each place.
    weighing = 1 + places if levels[VIGNETTING] or places > 1 or angles > 1 else 0
    blurred = nodes * len(distances)
    if not levels[LATERAL_COLOUR]:
        # PSFs are added before they are transformed.
        blurred = min(blurred, parts * channels)
    straight = parts * (1 + weighing) + places * blurred
    # Each order shifts a picture by a distance that depends on the wavelength: the picture is
    # drawn anew for each.
    pictures = parts * (1 + orders * nodes) if wave else parts
    aside = orders * nodes * parts * (1 + weighing + places) if wave else 0
    return _Counts(psfs, orders if wave else 0, straight + aside - pictures, pictures)


def wavelength_count_at(levels: Mapping[str, int]) -> int:
    """Return the number of wavelengths that are rendered, in the band and beside it."""
    of_band = LEVELS.wavelengths[levels.get(FILTER_BANDWIDTH, 0)]
    return of_band + LEVELS.leak[levels.get(OUT_OF_BAND_LEAK, 0)]


def place_count_at(levels: Mapping[str, int]) -> int:
    """Return the number of places in the field that are rendered."""
    of_shadow = LEVELS.places[levels.get(FIELD_POSITION, 0)]
    return max(of_shadow, LEVELS.aberrated_places[levels.get(FIELD_ABERRATIONS, 0)]) ** 2


def first_level_reaching(values: tuple[int, ...], least: float) -> int:
    """Return the first level whose value is at least `least`, or the last level."""
    found = (level for level, value in enumerate(values) if value >= least)
    return next(found, len(values) - 1)
