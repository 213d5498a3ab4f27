"""A snapshot spectral camera that isn't as it was meant to be: calibrated, and what it costs."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from judges.rings import bayer_frame, blurred_part, direction, ring_psf, vary_response

from figures import Figure
from figures.spectral_scenes import (
    BAYER,
    SIX_BANDS,
    Array,
    camera_response,
    cave_scene,
    mean_level,
    typical_spectra,
)
from optics.inverse import build_mosaic_observation
from optics.inverse.mosaics import MosaicObservation
from optics.multispectral import (
    SnapshotCalibration,
    SnapshotModel,
    calibrate_from_frames,
    refine_from_photograph,
    restore_spectra,
)
from optics.multispectral.snapshot_calibration import NINETY_PERCENT
from optics.threads import single_threaded

_SCENES = ("paints", "feathers", "sponges")
"""Scenes on which nothing was tuned."""

_RADIUS, _REACH = 20.0, 26
"""Radius of the last band's ring, and pixels from the middle of a PSF to its edge."""

_ORDER, _NOISE = 0.2, 0.01
_ORDER_ERROR, _SHIFT, _SCALE_ERROR, _RESPONSE_ERROR = 0.05, 0.5, 0.01, 0.05

_STAR_LIGHT, _FLAT_LIGHT = 15.0, 0.5
"""Light of a star's picture in all, so that the peak is near white, and of an even surface."""

_FRAMES_GOAL, _PHOTOGRAPH_GOAL = 0.7, 1.2
_SECONDS_GOAL = 60.0
_COVER_GOAL = 0.85
_DRAWS = 40

_FRAME, _SMALL = 256, 128
"""Sides in pixels of the photographs, and of those that are drawn many times."""


@dataclass(frozen=True, eq=False)
class _Camera:
    """What a camera really is; `deviation` is that in a model's parameters."""

    psfs: Array
    response: Array
    deviation: torch.Tensor


@single_threaded
def calibration_figures(folder: Path) -> list[Figure]:
    """What restorations lose to the exact camera, with all errors at once, and the time."""
    names = (
        "PSFs and filters 5 % off, calibrated from flats and stars: loss of the restoration",
        "PSFs and filters 5 % off, known from the photograph alone: loss of the restoration",
        "calibration from a photograph of 512 x 512, and its restoration",
    )
    goals = (
        f"≤ {_FRAMES_GOAL:g} dB",
        f"≤ {_PHOTOGRAPH_GOAL:g} dB",
        f"≤ {_SECONDS_GOAL:g} s of processor time",
    )
    scenes = {name: cave_scene(name) for name in _SCENES}
    spectra = typical_spectra(SIX_BANDS)
    why = _why_not(scenes, spectra)
    if why or spectra is None:
        return [Figure(name, goal, why, None) for name, goal in zip(names, goals, strict=True)]
    by_frames, by_photograph, nominal = list[float](), list[float](), list[float]()
    for seed, scene in enumerate(scenes.values()):
        assert scene is not None
        losses = _losses(scene, seed, spectra)
        for kept, loss in zip((nominal, by_frames, by_photograph), losses, strict=True):
            kept.append(loss)
    without = f"; {max(nominal):.1f} dB without calibration, the most of {len(scenes)} scenes"
    paints = scenes[_SCENES[0]]
    assert paints is not None
    seconds = _seconds(paints, spectra)
    measured = [
        (f"{max(by_frames):.2f} dB{without}", max(by_frames) <= _FRAMES_GOAL),
        (f"{max(by_photograph):.2f} dB{without}", max(by_photograph) <= _PHOTOGRAPH_GOAL),
        (f"{seconds:.0f} s", seconds <= _SECONDS_GOAL),
    ]
    return [
        Figure(name, goal, *one) for name, goal, one in zip(names, goals, measured, strict=True)
    ]


@single_threaded
def interval_figures(folder: Path) -> list[Figure]:
    """How often 90 % intervals hold, of each parameter, for cameras that are drawn."""
    names = (
        f"90 % intervals by flats and stars, {_DRAWS} cameras: hold of the worst parameter",
        f"90 % intervals by the photograph alone, {_DRAWS} cameras: hold of the worst parameter",
    )
    goal = f"≥ {100 * _COVER_GOAL:g} % of the cameras"
    scenes = {name: cave_scene(name) for name in _SCENES}
    spectra = typical_spectra(SIX_BANDS)
    why = _why_not(scenes, spectra)
    if why or spectra is None:
        return [Figure(name, goal, why, None) for name in names]
    pictures = [scene for scene in scenes.values() if scene is not None]
    by_frames, by_photograph = [], []
    for seed in range(_DRAWS):
        camera, nominal = _drawn_camera(seed), _nominal()
        by_frames.append(_holds(_from_frames(nominal, camera, seed), camera))
        seen = _photograph(pictures[seed % len(pictures)], camera, seed, _SMALL)
        by_photograph.append(_holds(refine_from_photograph(seen, spectra, nominal)[0], camera))
    return [
        _interval_figure(name, goal, np.array(held))
        for name, held in zip(names, (by_frames, by_photograph), strict=True)
    ]


def _interval_figure(name: str, goal: str, held: Array) -> Figure:
    each = held.mean(0)
    words = f"{100 * each.min():.0f} %; {100 * each.mean():.0f} % of all parameters"
    return Figure(name, goal, words, bool(each.min() >= _COVER_GOAL))


def _why_not(scenes: dict[str, Array | None], spectra: torch.Tensor | None) -> str:
    missing = [name for name, picture in scenes.items() if picture is None]
    if missing:
        return f"not measured: {', '.join(missing)} not beside the checkout"
    return "" if spectra is not None else "not measured: colour-science isn't installed"


def _losses(scene: Array, seed: int, spectra: torch.Tensor) -> Iterable[float]:
    """In dB to the exact camera: of the nominal one, by frames, and by the photograph alone."""
    camera, nominal = _wrong_camera(seed), _nominal()
    seen = _photograph(scene, camera, seed, _FRAME)
    truth = scene[(slice(None), *_part(scene, _FRAME))]

    def level(psfs: Array, response: Array) -> float:
        raw = seen.image.numpy()
        own = build_mosaic_observation(raw, BAYER, psfs, response=response, noise=_NOISE)
        return mean_level(restore_spectra(own, spectra).image, truth)

    exact = level(camera.psfs, camera.response)
    found = _from_frames(nominal, camera, seed)
    yield exact - level(nominal.psfs.numpy(), nominal.response.numpy())
    yield exact - level(found.psfs.numpy(), found.response.numpy())
    _, restored = refine_from_photograph(seen, spectra, nominal)
    yield exact - mean_level(restored.image, truth)


def _seconds(scene: Array, spectra: torch.Tensor) -> float:
    seen = _photograph(scene, _wrong_camera(0), 0, len(scene[0]))
    begun = time.process_time()
    refine_from_photograph(seen, spectra, _nominal())
    return time.process_time() - begun


def _rings(order: float, centres: Array, scale: float, reach: int = _REACH) -> Array:
    radii = scale * _RADIUS * SIX_BANDS / SIX_BANDS[-1]
    return np.stack([
        ring_psf(radius, order, centre, reach=reach)
        for radius, centre in zip(radii, centres, strict=True)
    ])  # fmt: skip


def _nominal() -> SnapshotCalibration:
    still = np.zeros((len(SIX_BANDS), 2))
    model = SnapshotModel.create(
        _rings(_ORDER, still, 1.0), camera_response(SIX_BANDS),
        zeroth_order=_ORDER, neutral=_rings(1.0, still, 1.0),
    )  # fmt: skip
    return SnapshotCalibration.nominal(model)


def _wrong_camera(seed: int) -> _Camera:
    """All errors at once, each as large as it is feared to be, one band beside the others."""
    rng = np.random.default_rng(seed)
    centres = np.zeros((len(SIX_BANDS), 2))
    centres[rng.integers(len(SIX_BANDS))] = _SHIFT * np.array(direction(rng))
    order = _ORDER + _ORDER_ERROR * rng.choice([-1, 1])
    return _camera(order, centres, 1 + _SCALE_ERROR * rng.choice([-1, 1]), rng)


def _drawn_camera(seed: int) -> _Camera:
    """Normal errors of all parameters at once."""
    rng = np.random.default_rng(1000 + seed)
    centres = _SHIFT * rng.standard_normal((len(SIX_BANDS), 2))
    order = _ORDER + _ORDER_ERROR * rng.standard_normal()
    return _camera(order, centres, 1 + _SCALE_ERROR * rng.standard_normal(), rng)


def _camera(order: float, centres: Array, scale: float, rng: np.random.Generator) -> _Camera:
    """With a margin, so that moved PSFs have room."""
    ideal = camera_response(SIX_BANDS)
    response = vary_response(ideal, _RESPONSE_ERROR, rng)
    model = _nominal().model
    layout = model.layout
    deviation = torch.zeros(layout.count, dtype=torch.float64)
    deviation[layout.zeroth_orders] = order - _ORDER
    deviation[layout.scale] = scale - 1
    deviation[layout.centres] = torch.from_numpy(centres.T.flatten())
    logs = torch.from_numpy(np.log(response / ideal))
    strongest = logs.gather(0, model.strongest[None])
    deviation[layout.log_ratios] = (logs.gather(0, model.others) - strongest).flatten()
    return _Camera(_rings(order, centres, scale, _REACH + 4), response, deviation)


def _part(scene: Array, side: int) -> tuple[slice, slice]:
    rows, columns = (slice((n - side) // 2, (n - side) // 2 + side) for n in scene.shape[1:])
    return rows, columns


def _photograph(scene: Array, camera: _Camera, seed: int, side: int) -> MosaicObservation:
    """The middle of a scene, with light from around it, as the nominal camera would explain it."""
    rows, columns = _part(scene, side)
    light = blurred_part(scene, camera.psfs, (rows.start, columns.start), (side, side))
    raw = bayer_frame(light, camera.response)
    raw += np.random.default_rng(seed).normal(0, _NOISE, raw.shape)
    ideal = _nominal()
    return build_mosaic_observation(
        raw.astype(np.float32), BAYER, ideal.psfs.numpy(),
        response=ideal.response.numpy(), noise=_NOISE,
    )  # fmt: skip


def _from_frames(nominal: SnapshotCalibration, camera: _Camera, seed: int) -> SnapshotCalibration:
    rng, bands = np.random.default_rng(seed), np.eye(len(SIX_BANDS))[:, :, None, None]
    psfs = np.pad(camera.psfs, ((0, 0), (9, 9), (9, 9)))
    stars, flats = (
        np.stack([bayer_frame(one, camera.response) for one in light])
        for light in (_STAR_LIGHT * bands * psfs, _FLAT_LIGHT * bands * np.ones((_SMALL, _SMALL)))
    )
    return calibrate_from_frames(
        nominal,
        flats=flats + rng.normal(0, _NOISE, flats.shape),
        stars=stars + rng.normal(0, _NOISE, stars.shape),
        noise=_NOISE,
    )


def _holds(found: SnapshotCalibration, camera: _Camera) -> Array:
    """Whether each parameter's interval holds the truth, without the common shift."""
    error = found.relative_deviation - found.remove_common_shift(camera.deviation)
    reach = NINETY_PERCENT * found.relative_covariance.diagonal().sqrt()
    return (error.abs() <= reach).double().numpy()


MEASUREMENTS = {
    "spectral-calibration": calibration_figures,
    "spectral-calibration-intervals": interval_figures,
}
