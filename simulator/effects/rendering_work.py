"""What a picture takes, by the levels of all effects: the rules that the ledger is filled by."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from optics.slm.flicker import flicker_nodes
from simulator.effects.psf_bounds import can_orders_reach_sensor, is_uniform_scene
from simulator.effects.result_cache import cached_per_situation
from simulator.formation.windows import picture_shape, psf_window
from simulator.formation.work import psf_operations, ray_operations, transform_operations
from simulator.recipe import SMALLEST_WINDOW
from simulator.situation import Situation

WAVELENGTH_COUNTS = (1, 2, 3, 5, 7, 9, 13, 17, 25, 33)
LEAK_COUNTS = (0, 4, 8, 16)
DEPTH_COUNTS = (1, 2, 3, 5, 9, 17, 33)
FIELD_COUNTS = (1, 3, 5, 9)
ORDER_COUNTS = (0, 1, 2)
SAMPLE_COUNTS = (1, 2, 3, 4, 6, 8)
PSF_WINDOWS = (SMALLEST_WINDOW, 128, 256, 512, 1024, 2048, 4096)

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
VIGNETTING, POLARISATION_INTERFERENCE = "vignetting", "polarisation interference"

ATTRIBUTION_ORDER = (
    PSF_REACH,
    LIGHT_SAMPLING,
    DIFFRACTION,
    FILTER_BANDWIDTH,
    OUT_OF_BAND_LEAK,
    PANEL_DISPERSION,
    POLARISATION_INTERFERENCE,
    FIELD_POSITION,
    VIGNETTING,
    PANEL_ORDERS,
)
"""In which their work is told apart: each adds to those before."""

_RELEVANT_EFFECTS = (*ATTRIBUTION_ORDER, "depth layers", "colour filter array", "flicker")
"""Effects whose levels make a difference."""


@dataclass(frozen=True)
class _Counts:
    """PSFs of the middle order, orders beside it, transforms of all samples but those of pictures
    as they are drawn, pictures, samples a pixel."""

    psfs: float
    orders: float
    transforms: float
    pictures: float
    samples: int
    wave: bool


def added_operations(s: Situation, levels: Mapping[str, int], name: str) -> float:
    """Operations that an effect adds to a picture with those before it in ATTRIBUTION_ORDER."""
    place = ATTRIBUTION_ORDER.index(name)
    # What doesn't count isn't looked at: a plan asks again only where something else counts.
    seen = {
        one: levels.get(one, 0)
        for one in _RELEVANT_EFFECTS
        if one not in ATTRIBUTION_ORDER[place + 1 :]
    }
    return max(rendering_operations(s, seen) - rendering_operations(s, {**seen, name: 0}), 0.0)


def rendering_operations(s: Situation, levels: Mapping[str, int]) -> float:
    """Of all that is rendered, without what the sensor does."""
    return _operations(s, tuple(levels.get(one, 0) for one in _RELEVANT_EFFECTS))


@cached_per_situation
def _operations(s: Situation, found: tuple[int, ...]) -> float:
    levels = dict(zip(_RELEVANT_EFFECTS, found, strict=True))
    counts = _count_steps(s, levels)
    reach, orders = (
        PSF_WINDOWS[levels.get(PSF_REACH, 0)],
        ORDER_COUNTS[levels.get(PANEL_ORDERS, 0)] * counts.wave,
    )
    down, across = (n * counts.samples for n in psf_window(s, reach))
    one = psf_operations if counts.wave else ray_operations
    rows, columns = (n * counts.samples for n in picture_shape(s, reach, orders))
    transform = transform_operations(rows, columns)
    pixels = transform_operations(rows // counts.samples, columns // counts.samples)
    drawing = counts.pictures * transform * _picture_oversampling(s, levels)
    beside = reach * counts.samples
    of_order = counts.orders * one(s.camera.panel, beside, beside)
    spreading = counts.psfs * (one(s.camera.panel, down, across) + of_order)
    return spreading + counts.transforms * transform + drawing + pixels


def _picture_oversampling(s: Situation, levels: Mapping[str, int]) -> float:
    """Samples of pictures over those of the light."""
    along = math.ceil(SAMPLE_COUNTS[levels.get(LIGHT_SAMPLING, 0)] / s.coarsest_sampling)
    return float(along**2)


def _count_steps(s: Situation, levels: Mapping[str, int]) -> _Counts:
    target = s.target.for_camera(s.camera)
    parts = sum(len(layer.parts) for layer in target.layers)
    distances = {layer.distance for layer in target.layers}
    nodes = (
        WAVELENGTH_COUNTS[levels.get(FILTER_BANDWIDTH, 0)]
        + LEAK_COUNTS[levels.get(OUT_OF_BAND_LEAK, 0)]
    )
    depths = min(DEPTH_COUNTS[levels.get("depth layers", 0)], len(distances))
    places = FIELD_COUNTS[levels.get(FIELD_POSITION, 0)] ** 2
    fields = (2 if levels.get(POLARISATION_INTERFERENCE, 0) else 1) * _flicker_field_count(
        s, levels
    )
    # Those that don't meet the sensor aren't computed.
    orders = (
        (2 * ORDER_COUNTS[levels.get(PANEL_ORDERS, 0)] + 1) ** 2 - 1
        if can_orders_reach_sensor(s)
        else 0
    )
    channels = len(s.camera.sensor.colour.channels) if s.camera.sensor.colour else 1
    cells = max(1, len(s.panel_content.pictures))
    psfs = nodes * depths * places * fields * cells
    if is_uniform_scene(s) and not levels.get(VIGNETTING, 0):
        # Nothing to be blurred.
        psfs = parts = 0
    channels = channels if levels.get("colour filter array", 0) else 1
    wave = bool(levels.get(DIFFRACTION, 0))
    # Of objects: once, and if they are weighed, back and once for each place.
    weighing = 1 + places if levels.get(VIGNETTING, 0) or places > 1 else 0
    straight = parts * (1 + weighing) + places * min(nodes * len(distances), parts * channels)
    # By orders each wavelength's picture stands elsewhere, and is drawn there.
    pictures = parts * (1 + orders * nodes) if wave else parts
    aside = orders * nodes * parts * (1 + weighing + places) if wave else 0
    blurs = straight + aside - pictures
    return _Counts(psfs, orders if wave else 0, blurs, pictures, s.coarsest_sampling, wave)


def _flicker_field_count(s: Situation, levels: Mapping[str, int]) -> int:
    """Fields that stand for a flickering one."""
    if not levels.get("flicker", 0):
        return 1
    reach = max(float(phase.abs().max()) for phase in s.pattern_probe.phases)
    return len(flicker_nodes(s.camera.panel.flicker, reach, s.numerics))


def first_level_reaching(values: tuple[int, ...], least: float) -> int:
    """The level of the first value that is as large, or of the last."""
    for level, value in enumerate(values):
        if value >= least:
            return level
    return len(values) - 1
