"""Predict the operations of rendering a picture from the levels of all effects.

The ledger counts a rendered picture's operations by the same rules.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

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
    """List what a recipe's fields are at each level, the coarsest first. All values were chosen.

    wavelengths: nodes in the filter's band.
    leak: nodes of the light that leaks outside the band.
    depths: nodes of distance.
    places: nodes along each axis of the field.
    aberrated_places: the same for field aberrations, which change more than the stop's shadow.
    angles: at which light passes the filter.
    orders: diffraction orders of the panel's pixel grid on each side. At level 1, two on each side
        are rendered on cells of pixels instead, where that is possible.
    samples: of a picture along each axis of a pixel, before it is blurred; and of the blurred
        light, up to as many as PSFs have.
    windows: sides of the PSF's window in sensor pixels.
    """

    wavelengths: tuple[int, ...] = (1, 2, 3, 5, 7, 9, 13, 17, 25, 33)
    leak: tuple[int, ...] = (0, 4, 8, 16)
    depths: tuple[int, ...] = (1, 2, 3, 5, 9, 17, 33)
    places: tuple[int, ...] = (1, 3, 5, 9)
    aberrated_places: tuple[int, ...] = (1, 3, 5, 9, 17)
    angles: tuple[int, ...] = (1, 2, 3, 5, 9)
    orders: tuple[int, ...] = (0, 1, 2)
    samples: tuple[int, ...] = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
    windows: tuple[int, ...] = (SMALLEST_WINDOW, 128, 256, 512, 1024, 2048, 4096)


LEVELS = RenderingLevels()

COARSE_ORDERS = 1
"""Level at which the panel's orders are rendered on cells, where that is possible."""

FILTER_BANDWIDTH, OUT_OF_BAND_LEAK, FIELD_POSITION, PANEL_ORDERS = (
    "filter bandwidth",
    "out-of-band leak",
    "field position",
    "panel orders",
)
DIFFRACTION, PSF_REACH, LIGHT_SAMPLING, PANEL_DISPERSION = (
    "diffraction",
    "PSF reach",
    "light sampling",
    "panel dispersion",
)
FIELD_ABERRATIONS = "field aberrations"
VIGNETTING, POLARISATION_INTERFERENCE = "vignetting", "polarisation interference"
OCCLUSION, LENS_GHOSTS, LATERAL_COLOUR = "occlusion", "lens ghosts", "lateral colour"
FILTER_ANGLE = "filter angle"

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

_RELEVANT_EFFECTS = (
    *ATTRIBUTION_ORDER,
    "depth layers",
    "colour filter array",
    "flicker",
    OCCLUSION,
    LATERAL_COLOUR,
)
"""Effects whose levels change the number of operations."""


@dataclass(frozen=True)
class _Counts:
    """Counts of the steps of rendering a picture.

    psfs: PSFs of the zeroth order.
    orders: other orders of each PSF.
    transforms: Fourier transforms of all samples, except for those of pictures when they are drawn.
    pictures: that are drawn.
    wave: whether light is a wave, or rays.
    """

    psfs: float
    orders: float
    transforms: float
    pictures: float
    wave: bool


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
    wave = bool(levels.get(DIFFRACTION, 0))
    of_psf, of_light = s.coarsest_sampling, light_samples_at(s, levels)
    coarse = wave and are_orders_coarse(s, levels.get(PANEL_ORDERS, 0))
    if coarse:
        levels[PANEL_ORDERS] = 0
    windows = _windows_at(s, levels)
    counts = _count_steps(s, levels, apart=not windows.merged_orders)
    down, across = (n * of_psf for n in windows.psf)
    one = psf_operations if counts.wave else ray_operations
    transform = transform_operations(*(n * of_light for n in windows.picture))
    pixels = transform_operations(*windows.picture)
    drawing = counts.pictures * transform * _picture_oversampling(of_light, levels)
    beside = (n * of_psf for n in windows.side_order)
    of_order = counts.orders * one(s.camera.panel, *beside)
    spreading = counts.psfs * (one(s.camera.panel, down, across) + of_order)
    cells = counts.psfs * _coarse_order_operations(s) if coarse else 0.0
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


def channel_count_at(s: Situation, levels: Mapping[str, int]) -> int:
    """Return the number of colour channels that are rendered."""
    colour = s.camera.sensor.colour
    return len(colour.channels) if colour and levels.get("colour filter array", 0) else 1


def are_orders_coarse(s: Situation, level: int) -> bool:
    """Whether a level of the panel's orders renders them on cells of pixels."""
    return level == COARSE_ORDERS and can_be_coarse(s)


def _coarse_order_operations(s: Situation) -> float:
    """Return the operations of rendering the side orders of one PSF on cells: a far field's."""
    rows, columns = (3 * n // 2 for n in s.camera.panel.shape)
    return 3 * transform_operations(rows, columns)


def light_samples_at(s: Situation, levels: Mapping[str, int]) -> int:
    """Return the samples of blurred light in a pixel along each axis."""
    drawn = LEVELS.samples[levels.get(LIGHT_SAMPLING, 0)]
    return light_samples(s.coarsest_sampling, drawn, occlusion=bool(levels.get(OCCLUSION, 0)))


def _picture_oversampling(of_light: int, levels: Mapping[str, int]) -> float:
    """Return how many samples of a picture are drawn per sample of light."""
    along = math.ceil(LEVELS.samples[levels.get(LIGHT_SAMPLING, 0)] / of_light)
    return float(along**2)


def _count_steps(s: Situation, levels: Mapping[str, int], *, apart: bool) -> _Counts:
    """Count the PSFs, transforms and pictures that rendering takes.

    apart: whether the panel's side orders have PSFs of their own.
    """
    target = s.target.for_camera(s.camera)
    distances = {layer.distance for layer in target.layers}
    nodes = (
        LEVELS.wavelengths[levels.get(FILTER_BANDWIDTH, 0)]
        + LEVELS.leak[levels.get(OUT_OF_BAND_LEAK, 0)]
    )
    depths = min(LEVELS.depths[levels.get("depth layers", 0)], len(distances))
    places = place_count_at(levels)
    fields = (2 if levels.get(POLARISATION_INTERFERENCE, 0) else 1) * _flicker_field_count(
        s, levels
    )
    # Orders that don't reach the sensor aren't computed.
    orders = (
        (2 * LEVELS.orders[levels.get(PANEL_ORDERS, 0)] + 1) ** 2 - 1
        if apart and can_orders_reach_sensor(s)
        else 0
    )
    channels = channel_count_at(s, levels)
    parts = sum(len(groups_of_parts(layer, channels, nodes)) for layer in target.layers)
    # Light of further angles is weighted over the field, and added.
    angles = LEVELS.angles[levels.get(FILTER_ANGLE, 0)]
    parts *= angles
    cells = max(1, len(s.panel_content.pictures))
    psfs = nodes * depths * places * fields * cells
    if is_uniform_scene(s) and not levels.get(VIGNETTING, 0) and angles == 1:
        # Uniform light stays uniform however it is blurred: no PSF is needed.
        psfs = parts = 0
    wave = bool(levels.get(DIFFRACTION, 0))
    # Each part is transformed once. If its light is weighted over the field, it is transformed
    # back, and then once for each place.
    weighing = 1 + places if levels.get(VIGNETTING, 0) or places > 1 or angles > 1 else 0
    blurred = nodes * len(distances)
    if not levels.get(LATERAL_COLOUR, 0):
        # PSFs are added before they are transformed.
        blurred = min(blurred, parts * channels)
    straight = parts * (1 + weighing) + places * blurred
    # Each order shifts a picture by a distance that depends on the wavelength: the picture is
    # drawn anew for each.
    pictures = parts * (1 + orders * nodes) if wave else parts
    aside = orders * nodes * parts * (1 + weighing + places) if wave else 0
    blurs = straight + aside - pictures
    return _Counts(psfs, orders if wave else 0, blurs, pictures, wave)


def place_count_at(levels: Mapping[str, int]) -> int:
    """Return the number of places in the field that are rendered."""
    of_shadow = LEVELS.places[levels.get(FIELD_POSITION, 0)]
    return max(of_shadow, LEVELS.aberrated_places[levels.get(FIELD_ABERRATIONS, 0)]) ** 2


def _flicker_field_count(s: Situation, levels: Mapping[str, int]) -> int:
    """Return the number of panel fields that represent the panel's flicker."""
    if not levels.get("flicker", 0):
        return 1
    reach = max(float(phase.abs().max()) for phase in s.pattern_probe.phases)
    return len(flicker_nodes(s.camera.panel.flicker, reach, s.numerics))


def first_level_reaching(values: tuple[int, ...], least: float) -> int:
    """Return the first level whose value is at least `least`, or the last level."""
    for level, value in enumerate(values):
        if value >= least:
            return level
    return len(values) - 1
