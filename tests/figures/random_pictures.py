"""Pictures of random scenes by random benches, and how near a plan's is to everything on."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from figures.problems import log_uniform
from figures.random_benches import random_bench
from figures.random_targets import Chance
from labapp.prediction.simulating.all_effects import REFERENCE_TOL, Deviation
from optics.accuracy import ToleranceError
from optics.camera import Camera, Ghost, Lens, Sensor
from optics.camera.field_aberrations import FieldAberrations
from optics.camera.pupil import pupil_amplitude
from optics.speckle import RoughSurface
from simulator.effects.electron_bounds import without_clipping
from simulator.effects.registry import EFFECTS
from simulator.imaging import Imaging, PictureMoments
from simulator.planning import DecidedBy, Effect, EffectPlan
from simulator.planning.effect_plan import EFFECTS_SHARE, build_recipe
from simulator.recipe import Recipe
from simulator.scene import Target
from simulator.situation import Situation

_ORDERS = "panel orders"

_COARSER = 3e-5

_SPOT = 10.0
"""Pixels that a point's light lies on, about."""

_ROUNDING = 1e-6
"""Share of a point's light in the frame that rounding may leave where there is none."""


class TooLong(Exception):
    """The finest picture of a case takes longer than somebody waits."""


@dataclass(frozen=True)
class Case:
    """A situation drawn by chance. number: of the draw, by which it can be found again.

    orders: whether the panel's orders are in it; they are left out of both sides where they alone
    would take too long.
    """

    number: int
    situation: Situation
    orders: bool = True

    @property
    def effects(self) -> list[Effect]:
        return [
            one
            for one in EFFECTS
            if one.is_present(self.situation) and (self.orders or one.name != _ORDERS)
        ]

    @property
    def forced(self) -> dict[str, str | bool]:
        return {} if self.orders else {_ORDERS: False}

    @property
    def finest(self) -> dict[str, int]:
        """Level of every effect."""
        return {one.name: one.finest_level(self.situation) for one in self.effects}

    @property
    def finest_work(self) -> float:
        """Operations of a picture with every effect at its finest."""
        levels = {_ORDERS: 0} | self.finest
        return sum(one.added_operations(self.situation, levels) for one in self.effects)

    @property
    def finest_recipe(self) -> Recipe:
        return build_recipe(self.effects, self.situation, self.finest)

    def at(self, tol: float) -> Situation:
        """With the arithmetic that goes with a tolerance."""
        return replace(self.situation, numerics=max((1 - EFFECTS_SHARE) * tol, REFERENCE_TOL))

    @property
    def words(self) -> str:
        """What to copy into a report."""
        s = self.situation
        caused = ", ".join(one.name for one in self.effects)
        rows, columns = s.camera.sensor.shape
        return (
            f"draw {self.number}: {type(s.target).__name__} at {s.target.distance:.2f} m, "
            f"{s.camera.panel.shape[0]}x{s.camera.panel.shape[1]} panel, {rows}x{columns} pixels, "
            f"{s.wavelength * 1e9:.0f} nm, {s.exposure * 1e3:.3g} ms, {caused}"
        )


def cases(seed: int, most_work: float = 2e10) -> Iterator[Case]:
    """Without end; those that would take more than so many operations are left out."""
    for number in range(1 << 31):
        s = random_situation(np.random.default_rng([seed, number]))
        if not pupil_amplitude(s.camera).any():
            continue
        if (case := affordable_case(number, s, most_work)) is not None:
            yield case


def affordable_case(number: int, s: Situation, most_work: float) -> Case | None:
    """Without the panel's orders if it would take more than so many operations at its finest with
    them; None if it would without them, too."""
    tried = (Case(number, s, orders) for orders in (True, False))
    return next((one for one in tried if one.finest_work <= most_work), None)


def random_situation(rng: np.random.Generator) -> Situation:
    """A target of any kind before a bench with any effects, from dim to burnt."""
    bench = random_bench(rng)
    chance = Chance(rng, bench.camera, bench.distance)
    target = chance.target(bench.band.centre)
    exposure = log_uniform(rng, 1e-3, 0.1)
    s = Situation(
        bench.camera,
        bench.mount,
        target,
        bench.band,
        bench.shown,
        float(rng.uniform(0, 0.1)),
        exposure,
        bench.path,
    )
    wanted = bench.camera.sensor.full_well * log_uniform(rng, 0.02, 3.0)
    unit = replace(s, target=lit(target, 1.0)).picture_probe
    brightest = min(unit.brightest, unit.total / _SPOT) * exposure
    # A target that has moved beside the frame leaves the rounding of its spectrum there.
    if brightest < _ROUNDING * unit.brightest * exposure:
        brightest = 0.0
    glare = log_uniform(rng, 1e-3, 0.3) if rng.random() < 0.5 else 0.0
    lens = _imperfect(rng, s.camera)
    s = replace(
        s, camera=replace(s.camera, glare=glare, sensor=_unclean(rng, s.camera.sensor), lens=lens)
    )
    if rng.random() < 0.4:
        trembling = log_uniform(rng, 0.03, 3) * s.camera.sensor.pitch
        frequency = log_uniform(rng, 0.05, 5) / exposure
        s = replace(s, camera=replace(s.camera, vibration=trembling, vibration_frequency=frequency))
    if rng.random() < 0.4:
        s = replace(s, camera=replace(s.camera, ghosts=_reflections(rng, s.camera.sensor)))
    if rng.random() < 0.3:
        drift = float(rng.choice([-1, 1])) * min(
            log_uniform(rng, 0.01, 10) * _focus_per_pixel(s.camera),
            0.03 * s.camera.lens.image_distance,
        )
        camera = replace(s.camera, focus_drift=drift, focus_drift_time=log_uniform(rng, 0.01, 1))
        s = replace(s, camera=camera)
    if s.band.shape != "lyot" and rng.random() < 0.4:
        s = replace(s, band=replace(s.band, effective_index=float(rng.uniform(1.0, 2.2))))
    if rng.random() < 0.25:
        rough = RoughSurface(log_uniform(rng, 1e-7, 1e-3), patterns=log_uniform(rng, 1, 100))
        target = replace(target, speckle=rough)
    return replace(s, target=lit(target, wanted / brightest)) if brightest else s


def _reflections(rng: np.random.Generator, sensor: Sensor) -> tuple[Ghost, ...]:
    """One ghost or a few, sharp or as wide as the frame."""
    side = min(sensor.shape) * sensor.pitch
    return tuple(
        Ghost(
            log_uniform(rng, 1e-4, 0.1),
            float(rng.choice([-1, 1])) * log_uniform(rng, 0.6, 4),
            float(rng.choice([0.0, 1.0])) * log_uniform(rng, 0.01, 1.0) * side,
        )
        for _ in range(int(rng.integers(1, 4)))
    )


def _focus_per_pixel(camera: Camera) -> float:
    """The shift of focus that blurs over a pixel, metres."""
    return camera.sensor.pitch * camera.lens.image_distance / camera.lens.stop_diameter


def _imperfect(rng: np.random.Generator, camera: Camera) -> Lens:
    """With distortion of up to 4 % or half a wave of Seidel's aberrations in the corner, a curve of
    relative illumination, or colour that blurs over up to ten pixels."""
    corner = math.hypot(*camera.sensor.shape) * camera.sensor.pitch / 2
    lens = camera.lens
    if rng.random() < 0.4:
        most = float(rng.choice([-1, 1])) * log_uniform(rng, 1e-4, 0.04)
        lens = replace(lens, distortion=(most * (lens.image_distance / corner) ** 2, 0.0))
    if rng.random() < 0.4:
        least = float(rng.uniform(0.3, 1.0))
        curve = ((0.0, 1.0), (0.6 * corner, 0.6 + 0.4 * least), (1.1 * corner, least))
        lens = replace(lens, relative_illumination=curve)
    if rng.random() < 0.4:
        per_pixel = _focus_per_pixel(camera)
        blue, red = (
            float(rng.choice([-1, 1]))
            * min(log_uniform(rng, 0.01, 10) * per_pixel, 0.03 * lens.image_distance)
            for _ in range(2)
        )
        lens = replace(lens, axial_colour=_curve(blue, red))
    if rng.random() < 0.3:
        parts = log_uniform(rng, 1e-3, 0.5) * 550e-9 * rng.uniform(-1, 1, 3)
        by = FieldAberrations(corner, *(float(one) for one in parts))
        lens = replace(lens, field_aberrations=by)
    if rng.random() < 0.3:
        apart = float(rng.choice([-1, 1])) * log_uniform(rng, 0.05, 5)
        blue = max(-0.09, min(apart * camera.sensor.pitch / corner, 0.09))
        lens = replace(lens, lateral_colour=_curve(blue, -blue))
    return lens


def _curve(blue: float, red: float) -> tuple[tuple[float, float], ...]:
    """What a lens does by wavelength, and no more where filters leak."""
    return ((300e-9, blue), (400e-9, blue), (550e-9, 0.0), (700e-9, red), (1200e-9, red))


def _unclean(rng: np.random.Generator, sensor: Sensor) -> Sensor:
    """With dust on the cover glass, or pixels whose neighbours collect some of their electrons."""
    specks = []
    for _ in range(int(rng.integers(1, 6)) if rng.random() < 0.4 else 0):
        y, x = (float(rng.uniform(-0.5, 0.5)) * n * sensor.pitch for n in sensor.shape)
        specks.append((y, x, log_uniform(rng, 0.5, 20) * sensor.pitch))
    return replace(
        sensor,
        dust=tuple(specks),
        dust_distance=log_uniform(rng, 1e-4, 5e-3),
        crosstalk=log_uniform(rng, 1e-3, 0.15) if rng.random() < 0.4 else 0.0,
    )


def lit(target: Target, radiance: float) -> Target:
    """The same at another radiance, which every kind has as a field of its own."""
    changes: dict[str, Any] = {"radiance": radiance}
    return replace(target, **changes)


def everything(case: Case, patience: float = math.inf) -> PictureMoments:
    """With every effect at its finest, and the finest arithmetic that can be kept: where hardly
    any light meets the sensor, a stop's edge takes some of it.

    patience: seconds of processor time, beyond which it is given up with TooLong.
    """
    begun = time.process_time()

    def check() -> None:
        if time.process_time() - begun > patience:
            raise TooLong(case.words)

    for numerics in (REFERENCE_TOL, _COARSER, 10 * _COARSER):
        s = replace(case.situation, numerics=numerics)
        with contextlib.suppress(ToleranceError):
            return Imaging(0.0).picture_moments(s, without_clipping(s, case.finest_recipe), check)
    raise ToleranceError(f"no tolerance can be kept of {case.words}")


def deviation(
    case: Case, tol: float, truth: PictureMoments, decide_by: DecidedBy = "bound"
) -> tuple[Deviation, EffectPlan]:
    """Of the picture by the plan for a tolerance from one with everything on."""
    s, imaging = case.at(tol), Imaging(tol, case.forced, decide_by=decide_by)
    plan = imaging.plan(s)
    return Deviation.of(imaging.picture_moments(s, without_clipping(s, plan.recipe)), truth), plan
