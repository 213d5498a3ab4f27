"""Imperfections of lens, mount and sensor against slow judges."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from judges.aberrated_star import aberrated_star
from judges.imperfect_camera import Array, imperfect, larger, out_of_focus
from judges.rough_surface import speckled

from figures import Figure
from figures.problems import log_uniform
from optics.caching import ByteCache
from optics.camera import Camera, Ghost, Lens, Panel, Sensor
from optics.camera.field_aberrations import FieldAberrations
from optics.light import Band, Spectrum
from optics.speckle import RoughSurface
from optics.threads import single_threaded
from simulator.effects.band_effects import Bandwidth
from simulator.effects.registry import EFFECTS
from simulator.formation import expected_electrons
from simulator.imaging import Imaging
from simulator.ledger import Ledger
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.planning import Effect
from simulator.planning.effect_plan import build_recipe
from simulator.scene import Flat, PhotographPrint, Star, Target
from simulator.situation import Situation

NAMES = (
    "axial colour", "field aberrations", "lateral colour", "focus drift", "filter angle",
    "vibration", "distortion", "vignetting", "lens ghosts", "dust", "pixel crosstalk",
)  # fmt: skip

_SEED, _DRAWS, _PLANS, _FINER, _TOL = 20261128, 40, 200, 4, 1e-2
_ROUGH, _SURFACES = 4, 900
_GOAL = 0.01
_NARROW, _WAVELENGTHS = Band(550e-9, 1e-9), 21
_PANEL = Panel(shape=(24, 32), pitch=40e-6, unmodulated=0.0)
_IDEAL = Camera(
    _PANEL, Lens(0.05, 40.0, 1.0),
    Sensor(shape=(20, 24), pitch=20e-6, full_well=1e7, bits=16, read_noise=2.0),
)  # fmt: skip
_CORNER = math.hypot(20, 24) * 10e-6


@dataclass(frozen=True)
class Draw:
    """A star or a print, as large as twice the frame, before a camera with some imperfections."""

    target: Target
    larger: Target
    camera: Camera
    exposure: float
    band: Band = _NARROW
    start: float = 0.0

    @property
    def situation(self) -> Situation:
        return replace(
            _situation(self.target, self.camera, self.exposure, self.band),
            exposure_start=self.start,
        )

    @property
    def has_one_focus(self) -> bool:
        """Whether its judge knows no other."""
        return self.camera.lens.field_aberrations is not None or self.band.shifts_with_angle

    def judged(self, without: str = "") -> Array:
        """The picture of a camera in which one thing may be ideal."""
        camera = ideal_in(self.camera, without)
        periods = min(camera.vibration_frequency * self.exposure, 1e6)
        seen = camera.vibration * math.sqrt(1 - float(np.sinc(periods)) ** 2)
        lens = camera.lens
        if self.camera.lens.field_aberrations is not None:
            return imperfect(self._aberrated_light(camera), _FINER, camera, seen)
        if not (lens.axial_colour or lens.lateral_colour):
            shifts = self.band.shifts_with_angle and without != "filter angle"
            straight = replace(self.band, effective_index=math.inf)
            fine = self._fine_picture(straight, camera)
            band = self.band if shifts else None
            return imperfect(fine, _FINER, camera, seen, band=band, light=self.target.light)
        low, high = self.band.support
        middles = low + (high - low) * (np.arange(_WAVELENGTHS) + 0.5) / _WAVELENGTHS
        passed = self.band.transmission(middles) * (high - low) / _WAVELENGTHS
        total = np.zeros(camera.sensor.shape)
        for wavelength, width in zip(middles.tolist(), passed.tolist(), strict=True):
            narrow = replace(_NARROW, centre=wavelength)
            ends = np.linspace(*narrow.support, 2001)
            alone = float(np.trapezoid(narrow.transmission(ends), ends))
            fine = width / alone * self._fine_picture(narrow, camera)
            total += imperfect(fine, _FINER, camera, seen, larger(lens, wavelength))
        return total

    def _aberrated_light(self, camera: Camera) -> Array:
        """A star by a judge of its own, which an ideal lens tells how much light there is."""
        assert isinstance(self.target, Star)
        ideal = self._fine_picture(self.band, _IDEAL)
        pitch = _IDEAL.sensor.pitch / _FINER
        seen, sharp = (
            aberrated_star(self.target, one, self.band.centre, ideal.shape, pitch)
            for one in (camera, _IDEAL)
        )
        return seen * ideal.sum() / sharp.sum()

    def _fine_picture(self, band: Band, camera: Camera) -> Array:
        """By a lens that is ideal but for its focus, on a frame twice as large and pixels a quarter
        as large."""
        one = _IDEAL.sensor
        shape = (2 * _FINER * one.shape[0], 2 * _FINER * one.shape[1])
        focused = replace(_IDEAL.lens, axial_colour=camera.lens.axial_colour)
        warm = 1 - math.exp(-(self.start + self.exposure / 2) / camera.focus_drift_time)
        fine = replace(
            _IDEAL,
            lens=out_of_focus(focused, band.centre, warm * camera.focus_drift),
            sensor=replace(one, shape=shape, pitch=one.pitch / _FINER),
        )
        s = _situation(self.larger, fine, self.exposure, band)
        return _FINER**2 * rendered(s, (), 1, aperture=False)


def _situation(target: Target, camera: Camera, exposure: float, band: Band) -> Situation:
    shown = PanelContent.of(np.zeros((1, *camera.panel.shape), np.uint8), math.inf)
    return Situation(camera, Mount(), target, band, shown, 0.0, exposure, numerics=1e-5)


def ideal_in(camera: Camera, name: str) -> Camera:
    """The camera without one of its imperfections."""
    sensor, lens = camera.sensor, camera.lens
    # A curve tells how bright distorted light is, too, so that one stays that takes nothing.
    even = tuple((height, 1.0) for height, _ in lens.relative_illumination)
    return {
        "": camera,
        "axial colour": replace(camera, lens=replace(lens, axial_colour=())),
        "field aberrations": replace(camera, lens=replace(lens, field_aberrations=None)),
        "lateral colour": replace(camera, lens=replace(lens, lateral_colour=())),
        "focus drift": replace(camera, focus_drift=0.0),
        "filter angle": camera,
        "vibration": replace(camera, vibration=0.0),
        "distortion": replace(camera, lens=replace(lens, distortion=(0.0, 0.0))),
        "vignetting": replace(camera, lens=replace(lens, relative_illumination=even)),
        "lens ghosts": replace(camera, ghosts=()),
        "dust": replace(camera, sensor=replace(sensor, dust=())),
        "pixel crosstalk": replace(camera, sensor=replace(sensor, crosstalk=0.0)),
    }[name]


def draws(count: int, weakest: float) -> Iterator[Draw]:
    """weakest: of all strengths, over the largest."""
    for number in range(count):
        rng = np.random.default_rng([_SEED, number])
        draw = _draw(rng, lambda most, rng=rng: most * log_uniform(rng, weakest, 1.0))
        draw = _coloured(np.random.default_rng([_SEED, number, 1]), draw, weakest)
        yield _drifting(np.random.default_rng([_SEED, number, 2]), draw, weakest)


def _drifting(rng: np.random.Generator, draw: Draw, weakest: float) -> Draw:
    """In some draws a camera that has warmed up for a while, unless its judge knows one focus."""
    if rng.random() < 0.6 or draw.has_one_focus:
        return draw
    drift = float(rng.choice([-1, 1])) * 4e-3 * log_uniform(rng, weakest, 1.0)
    camera = replace(draw.camera, focus_drift=drift, focus_drift_time=600.0)
    return replace(draw, camera=camera, start=log_uniform(rng, 30.0, 3000.0))


def _coloured(rng: np.random.Generator, draw: Draw, weakest: float) -> Draw:
    """In every other draw a band of up to 40 nm, and a lens that doesn't unite it.

    The judges of field aberrations and of a filter's angle know one focus.
    """
    if rng.random() < 0.5 or draw.has_one_focus:
        return draw

    def curve(most: float) -> tuple[tuple[float, float], ...]:
        if rng.random() < 0.3:
            return ()
        blue, red = (
            float(rng.choice([-1, 1])) * most * log_uniform(rng, weakest, 1.0) for _ in range(2)
        )
        return ((450e-9, blue), (550e-9, float(rng.uniform(-1, 1)) * blue), (650e-9, red))

    lens = replace(draw.camera.lens, axial_colour=curve(4e-3), lateral_colour=curve(0.04))
    band = Band(float(rng.uniform(500e-9, 600e-9)), float(rng.uniform(5e-9, 40e-9)))
    return replace(draw, camera=replace(draw.camera, lens=lens), band=band)


def _draw(rng: np.random.Generator, strength) -> Draw:  # type: ignore[no-untyped-def]
    lens, sensor = _IDEAL.lens, _IDEAL.sensor
    on = rng.random(5) < 0.6
    if not on.any():
        on[rng.integers(5)] = True
    if on[0]:
        bent = float(rng.choice([-1, 1])) * strength(0.06)
        lens = replace(lens, distortion=(bent * (lens.image_distance / _CORNER) ** 2, 0.0))
    if on[1]:
        loss = strength(0.35)
        curve = ((0.0, 1.0), (0.6 * _CORNER, 1 - 0.4 * loss), (1.2 * _CORNER, 1 - loss))
        lens = replace(lens, relative_illumination=curve)
    if on[2]:
        y, x = rng.uniform(-1.5e-4, 1.5e-4, 2)
        speck = (float(y), float(x), strength(2e-4))
        sensor = replace(sensor, dust=(speck,), dust_distance=log_uniform(rng, 5e-4, 5e-3))
    if on[3]:
        sensor = replace(sensor, crosstalk=strength(0.15))
    exposure = log_uniform(rng, 3e-3, 0.1)
    camera = replace(_IDEAL, lens=lens, sensor=sensor)
    if on[4]:
        camera = replace(
            camera, vibration=strength(25e-6), vibration_frequency=log_uniform(rng, 2, 200)
        )
    if rng.random() < 0.5:
        camera = replace(camera, ghosts=_reflections(rng, strength))
    band, light = _NARROW, None
    if rng.random() < 0.5:
        # Within .3 mm of the axis the angle is small, and a band narrow that shifts by its width.
        width = min(1e-11 / strength(1.0), 5e-9)
        band = Band(550e-9, width, effective_index=float(rng.uniform(1.0, 1.5)))
        light = Spectrum((4e-7, 550e-9 - width, 550e-9 + width, 7e-7), (0.5, 0.5, 1.0, 1.0))
    if rng.random() < 0.4:
        place = tuple(float(one) for one in rng.uniform(-2.4e-3, 2.4e-3, 2))
        star = Star(2e-3, 1.0, 1e9, (place[0], place[1]), light=light)
        if light is None:
            camera = replace(camera, lens=_aberrated(rng, camera.lens, strength))
        return Draw(star, star, camera, exposure, band)
    # All light has one spectrum: behind a filter that shifts, prints are grey.
    grey = rng.random((24, 30, 3 if light is None else 1)).astype(np.float32)
    image = torch.from_numpy(grey).expand(-1, -1, 3)
    printed = PhotographPrint(image, 1.0, 1e8, cover=2.0, light=light)
    return Draw(printed, replace(printed, cover=1.0), camera, exposure, band)


def _reflections(rng: np.random.Generator, strength) -> tuple[Ghost, ...]:  # type: ignore[no-untyped-def]
    """One ghost or two of what lies in the frame or as far beside it as the fine picture shows."""
    found = []
    for _ in range(int(rng.integers(1, 3))):
        size = float(rng.choice([-1, 1]) * rng.uniform(0.8, 2.0))
        found.append(Ghost(strength(0.1), size, float(rng.uniform(2e-5, 1.2e-4))))
    return tuple(found)


def _aberrated(rng: np.random.Generator, lens: Lens, strength) -> Lens:  # type: ignore[no-untyped-def]
    """With some of Seidel's aberrations in half of the cases, up to a wave in the corner."""
    if rng.random() < 0.5:
        return lens
    of_all = strength(_NARROW.centre)
    parts = of_all * rng.choice([-1, 0, 1], 3) * rng.uniform(0.3, 1, 3)
    if not parts.any():
        return lens
    coma, astigmatism, curvature = (float(one) for one in parts)
    bent = FieldAberrations(_CORNER, coma, astigmatism, curvature)
    return replace(lens, field_aberrations=bent)


def rendered(s: Situation, names: tuple[str, ...], sampling: int, *, aperture: bool) -> Array:
    """By waves in a large window, with some of the imperfections and nothing else."""
    chosen = {"diffraction": 1, "PSF reach": 1, "light sampling": sampling}
    if names:
        chosen["filter bandwidth"] = Bandwidth().finest_level(s)
    present = [one.name for one in EFFECTS if one.name in names and one.is_present(s)]
    levels = (
        chosen
        | {one.name: _level(one, s) for one in EFFECTS if one.name in present}
        | ({"pixel aperture": 1} if aperture else {})
    )
    recipe = build_recipe(EFFECTS, s, levels)
    ledger = Ledger()
    found = expected_electrons(s, recipe, ByteCache(), ledger).double().numpy()
    called = ledger.effects_called & set(NAMES)
    if not called <= set(present):
        raise AssertionError(f"{sorted(called - set(present))} called, and not there")
    return found


def _level(effect: Effect, s: Situation) -> int:
    return 3 if effect.name == "field aberrations" else 1


def _noise(light: Array) -> Array:
    return np.sqrt(np.maximum(light, 0) + _IDEAL.sensor.read_noise**2)


def _apart(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other) / np.linalg.norm(other))


@single_threaded
def imperfect_camera_figures(folder: Path) -> list[Figure]:
    """Pictures with everything on, and what plans leave out of others."""
    errors = []
    for draw in draws(_DRAWS, 0.1):
        wanted = draw.judged()
        errors.append(_apart(rendered(draw.situation, NAMES, 3, aperture=True), wanted))
    off = wrong = there = 0
    worst = 0.0
    for draw in draws(_PLANS, 1e-4):
        s = draw.situation
        plan = Imaging(_TOL).plan(s)
        present = [one.name for one in EFFECTS if one.name in NAMES and one.is_present(s)]
        left = [name for name in present if not plan.level(name)]
        there, off = there + len(present), off + len(left)
        if not left:
            continue
        whole = draw.judged()
        for name in left:
            less = draw.judged(name)
            change = max(_apart(less, whole), _apart(_noise(less), _noise(whole)))
            worst, wrong = max(worst, change), wrong + (change > _TOL)
    return [
        Figure(
            f"{_DRAWS} cameras with any of {', '.join(NAMES)}, against rays and sums",
            f"≤ {_GOAL:.0%} of the picture",
            f"worst {max(errors):.2%}, median {np.median(errors):.2%}",
            max(errors) <= _GOAL,
        ),
        Figure(
            f"{_PLANS} others, weak and strong: left out at tol {_TOL:g}, but the judge sees it",
            "0",
            f"{wrong} of {off} left out ({there} were there); worst change {worst:.2%}",
            not wrong,
        ),
        _speckle_figure(),
    ]


def _speckle_figure() -> Figure:
    """Variance of even light on rough objects, against fields of surfaces that are drawn."""
    worst = 0.0
    for number in range(_ROUGH):
        rng = np.random.default_rng([_SEED, number, 1])
        lens = replace(_IDEAL.lens, f_number=log_uniform(rng, 40, 80))
        camera = replace(_IDEAL, lens=lens)
        rough = log_uniform(rng, 1e-6, 5e-5)
        even = Flat(1.0, 1e8, speckle=RoughSurface(rough))
        centre, width = _NARROW.centre, _NARROW.support[1] - _NARROW.support[0]
        waves = centre + width * (np.arange(12) + 0.5) / 12 - width / 2
        light = [float(_NARROW.transmission(one)) for one in waves]
        drawn = [speckled(rng, camera, _FINER, rough, waves, light) for _ in range(_SURFACES)]
        wanted = float(np.var(drawn) / np.mean(drawn) ** 2)
        s = _situation(even, camera, 0.01, _NARROW)
        recipe = build_recipe(EFFECTS, s, {"speckle": 1, "shot noise": 3})
        seen = Imaging(0.0).picture_moments(s, recipe)
        varied = (seen.variance - seen.mean) / seen.mean**2
        worst = max(worst, abs(float(varied.mean()) / wanted - 1))
    return Figure(
        f"contrast of {_ROUGH} rough objects, against {_SURFACES} surfaces drawn for each",
        "≤ 1% of the contrast",
        f"worst {worst / 2:.2%}",
        worst / 2 <= 0.01,
    )


MEASUREMENTS = {"imperfect cameras": imperfect_camera_figures}
