"""Bounds of the effects of optics are not much larger than what the effects change.

A bound that is too large is never broken, but makes the simulator compute what no scene calls
for. Each effect stands here in a situation that comes near the worst that its bound knows of, at
every level that one finds there; what is left between the two is its slack. A slack is said as a
number with its reason, and is less than four times what was found. An estimate of what an effect
changes isn't exceeded even there, but where it is said.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from optical_situations import EFFECTS, PANEL, finest, rendered, situation

from optics.caching import ByteCache
from optics.camera import Camera, Ghost, Lens, Panel, Sensor
from optics.camera.field_aberrations import FieldAberrations
from optics.light import Band, Spectrum
from optics.polarisation import PathEffect
from optics.slm import PanelMap, PhaseResponse
from optics.slm.panel import max_phase
from simulator.panel_content import PanelContent
from simulator.scene import Flat, PhotographPrint, Star, Target
from simulator.situation import Situation

ROWS, COLUMNS = PANEL.shape
Y, X = np.mgrid[:ROWS, :COLUMNS]
CHECKERS = (X // 4 + Y // 4) % 2
"""A binary grating: its orders hold what light an error of its step takes from the middle."""

IDEAL = replace(PANEL, unmodulated=0.0)
NARROW = Band(550e-9, 1e-9)
STAR = Star(40e-6, 1.0, 2e10)
RANDOM = np.random.default_rng(0).integers(0, 60, PANEL.shape)
LENS = Lens(0.05, 40.0, 1.0)


def camera(panel: Panel = IDEAL, pitch: float = 60e-6, shape=(20, 24), lens: Lens = LENS):
    """A spot in focus is 25 µm wide. Electrons are read as they come, and no well is full."""
    return Camera(panel, lens, Sensor(shape=shape, pitch=pitch, full_well=6e4, bits=16, gain=1.0))


def seen(
    camera: Camera, grey: np.ndarray | None = None, target: Target = STAR, band: Band = NARROW,
    **more,
) -> Situation:  # fmt: skip
    grey = np.zeros(camera.panel.shape) if grey is None else grey
    shown = PanelContent.of(grey.astype(np.uint8)[None], math.inf)
    return situation(target, camera, band, shown, **more)


def lens_pattern(radians: float) -> np.ndarray:
    """A lens whose phase falls by so much at the panel's left and right edges."""
    x, y = ((one - one.mean()) / (COLUMNS / 2) for one in (X, Y))
    phase = radians * (x**2 + y**2) % (2 * np.pi)
    return np.round(255 * phase / max_phase(PANEL, 550e-9))


def at_the_corner(camera: Camera, inside: int) -> Star:
    """A star's image so many pixels from either side of the frame."""
    scale, pitch = camera.magnification(1.0), camera.sensor.pitch
    y, x = ((n / 2 - inside) * pitch / scale for n in camera.sensor.shape)
    return replace(STAR, offset=(y, x))


@dataclass(frozen=True)
class Worst:
    """A situation that comes near the worst, and by level how much larger a bound may be."""

    effect: str
    situation: Callable[[], Situation]
    slack: dict[int, float]
    because: str
    also: dict[str, int] | None = None
    """Levels of other effects; by default the PSF's structure is at its finest, all else off."""
    label: str = ""
    finer: int = 1
    """Levels above those, to tell what changes; all that are finer still take too long."""
    beyond_estimate: float = 1.0
    """How much more changes than is estimated: no estimate knows all of the worst."""

    def __str__(self) -> str:
        return f"{self.effect} {self.label}".strip()


def reach() -> Situation:
    wide = camera(pitch=5e-6, shape=(100, 100))
    return seen(wide, RANDOM, at_the_corner(wide, 8))


def sampling(pitch: float = 10e-6) -> Situation:
    """Noise finer than pixels; on large pixels, it is the light that needs several samples."""
    image = torch.from_numpy(np.random.default_rng(1).random((100, 100, 3)).astype(np.float32))
    return seen(camera(pitch=pitch), target=PhotographPrint(image, 1.0, 1e7, cover=0.7))


def leaking(most: float) -> Situation:
    """The pattern's phase turns often over what leaks: few wavelengths see chance parts of it."""
    table = ((400e-9, 1.4 * most), (550e-9, most), (700e-9, 0.78 * most))
    thick = camera(replace(IDEAL, max_phase=table))
    return seen(thick, 255 * CHECKERS, band=Band(550e-9, 10e-9, leak=3e-3))


def beside() -> Situation:
    return seen(camera(pitch=20e-6), target=Flat(1.0, 1e7), band=Band(550e-9, 10e-9, leak=3e-3))


def aslant() -> Situation:
    """A steep spectrum, of which the corner's band has half as much."""
    lamp = Spectrum((400e-9, 540e-9, 560e-9, 700e-9), (0.0, 0.0, 1.0, 1.0))
    wide = camera(pitch=80e-6, shape=(40, 48), lens=Lens(0.01, 80.0, 1.0))
    band = Band(550e-9, 5e-9, "interference", effective_index=1.5)
    return seen(wide, target=Flat(1.0, 1e6, light=lamp), band=band)


def thick_grating() -> Situation:
    return seen(camera(), 240 * CHECKERS, band=Band(550e-9, 30e-9))


def on_sensor(s: Situation, **data) -> Situation:
    return replace(s, camera=replace(s.camera, sensor=replace(s.camera.sensor, **data)))


def bent() -> Situation:
    wide = camera(pitch=20e-6, lens=replace(LENS, distortion=(2000.0, 0.0)))
    return seen(wide, target=at_the_corner(wide, 3))


def out_of_focus_by_colour() -> Situation:
    """A slope over a band about a wavelength in focus: the rim's light lands pixels away."""
    lens = Lens(0.05, 40.0, 1.0, axial_colour=((450e-9, -4e-3), (650e-9, 4e-3)))
    return seen(camera(pitch=20e-6, lens=lens), band=Band(580e-9, 5e-9))


def colours_apart() -> Situation:
    lens = replace(LENS, lateral_colour=((450e-9, -0.06), (650e-9, 0.06)))
    wide = camera(pitch=20e-6, lens=lens)
    return seen(wide, target=at_the_corner(wide, 3), band=Band(580e-9, 5e-9))


SPECK = (1e-4, -1e-4, 3e-4)


def panel(grey: np.ndarray | None = None, **data) -> Callable[[], Situation]:
    return lambda: seen(camera(replace(IDEAL, **data)), grey)


def uneven_light() -> Situation:
    """A pattern that spreads the panel over the sensor shows how unevenly it is lit."""
    x = np.mgrid[-1:1:6j, -1:1:8j][1]
    return panel(lens_pattern(7), illumination=PanelMap(np.exp(-(x**2)) + 0.1))()


def crystal() -> Situation:
    video = np.stack([0 * CHECKERS, 40 * CHECKERS]).astype(np.uint8)
    slow = camera(replace(IDEAL, response_time=1e-3))
    return situation(STAR, slow, NARROW, PanelContent.of(video, 1 / 60), exposure=1 / 60)


def interfering() -> Situation:
    path = PathEffect(torch.tensor(0.5), torch.tensor(0.05), torch.tensor(0.1 + 0.05j))
    return seen(camera(), path=path)


def apart() -> Situation:
    far = replace(camera(), separation=1e-3)
    return seen(far, lens_pattern(7), at_the_corner(far, 1), numerics=0.1)


def aberrated() -> Situation:
    by = FieldAberrations(1e-3, curvature=1e-7)
    bent = camera(pitch=20e-6, lens=replace(LENS, field_aberrations=by), shape=(60, 80))
    return seen(bent, target=at_the_corner(bent, 2), numerics=1e-3)


def gratings_orders() -> Situation:
    return seen(camera(replace(IDEAL, pitch=80e-6), shape=(8, 28)))


def orders_on_cells() -> Situation:
    """Behind a panel of more pixels, whose spots are smaller than a cell."""
    fine = replace(IDEAL, shape=(96, 128), pitch=40e-6)
    pattern = np.zeros((96, 128))
    return seen(camera(fine, pitch=10e-6, shape=(400, 400)), pattern)


def wide_angle(target: Target | None = None) -> Callable[[], Situation]:
    def made() -> Situation:
        wide = camera(pitch=80e-6, shape=(100, 120), lens=Lens(0.01, 80.0, 1.0))
        star = replace(at_the_corner(wide, 2), diameter=6e-3, radiance=2e7)
        return seen(wide, target=target or star)

    return made


RAYS = {"diffraction": 0}
BAND = {"filter bandwidth": 9}
TWICE = "light that moves counts where it was and where it goes; a spot is spread over pixels"
FIELDS = "Cauchy-Schwarz; a change in one place and the other counts by their sum"

WORST = [
    Worst("PSF reach", reach, {0: 5, 1: 6}, "×1.5, ×1.3 for other wavelengths, and by energy"),
    Worst("light sampling", sampling, {0: 12, 1: 8, 2: 8}, "×2; every frequency at its worst"),
    Worst("light sampling", lambda: sampling(30e-6), {0: 14, 1: 8},
          "×2; every frequency at its worst", label="of the light", finer=2),
    Worst("light sampling", lambda: seen(camera(pitch=30e-6)), {0: 8},
          "×2; every frequency at its worst", label="of a star's light", finer=2),
    Worst("diffraction", lambda: seen(camera()), {0: 8}, "×1.5; waves and rays each from sharp"),
    Worst(
        "filter bandwidth", lambda: seen(camera(pitch=20e-6), lens_pattern(14),
                                         band=Band(550e-9, 120e-9)),
        {0: 7, 1: 6, 2: 6, 3: 6, 4: 8, 5: 12, 6: 22}, "×2; all parts of the picture in phase",
    ),
    Worst("out-of-band leak", beside, {0: 1.2}, "all of it is missing", label="of even light"),
    Worst("out-of-band leak", lambda: leaking(100), {0: 7, 2: 11}, TWICE,
          BAND | {"panel dispersion": 1}, beyond_estimate=2.7),
    Worst("out-of-band leak", lambda: leaking(300), {1: 30}, "as if none of it were as it is",
          BAND | {"panel dispersion": 1}, "by few wavelengths", 2),
    Worst("filter angle", aslant, {0: 4}, "all light as from the corner, and at its worst channel"),
    Worst("panel dispersion", thick_grating, {0: 15},
          FIELDS + "; errors of either sign as if they were of one", BAND),
    Worst("illumination", uneven_light, {0: 10}, FIELDS),
    Worst("front reflection", panel(RANDOM, front_reflection=0.05), {0: 5}, TWICE),
    Worst("unmodulated light", panel(RANDOM, unmodulated=0.05), {0: 5}, TWICE),
    Worst("jitter", panel(jitter=0.2), {0: 5}, TWICE),
    Worst("gap light", panel(gap_reflection=0.3), {0: 2.5}, "a spot is spread over pixels"),
    Worst(
        "panel response",
        panel(15 * CHECKERS, response=PhaseResponse.from_curve(
            550e-9, 1.1 * (np.arange(256) / 255) ** 1.1)),
        {0: 5}, FIELDS,
    ),
    Worst("neighbour coupling", panel(20 * (X // 2 % 2), coupling=8e-6), {0: 7}, "×1.5; " + FIELDS),
    Worst("flicker", panel(40 * CHECKERS, flicker=0.1), {0: 8}, "×1.5; mean and power add up"),
    Worst("flatness", panel(20 * CHECKERS, flatness=PanelMap(CHECKERS * 2e-8)), {0: 5}, FIELDS),
    Worst("liquid-crystal response", crystal, {0: 18}, "×1.2; " + FIELDS + ", and power"),
    Worst("polarisation interference", interfering, {0: 3.5}, "×1.2; in phase wherever they meet",
          {"unmodulated light": 1}),
    Worst("field position", apart, {0: 170},
          "the root of the light that is lit anew, as if it met the rest in phase"),
    Worst("field aberrations", aberrated, {0: 12, 1: 130},
          "trace norms: as if every pattern were the worst, and light in phase wherever it lands"),
    Worst("vignetting", wide_angle(), {0: 3}, "the margin's corner is darker still", RAYS, "star"),
    Worst("vignetting", wide_angle(Flat(1.0, 1e5)), {0: 6}, "as all were as dark as that", RAYS,
          "even light"),
    Worst("panel orders", gratings_orders, {0: 11},
          "×1.5; orders that lie apart as if they were one", finer=2),
    Worst("panel orders", orders_on_cells, {1: 50},
          "×1.5; orders that lie apart as if they were one, and all of their light lost",
          label="on cells"),
    Worst("lens ghosts", lambda: seen(replace(camera(), ghosts=(Ghost(0.05, -1.2, 3e-4),))),
          {0: 2}, "the panel spreads the spot, too"),
    Worst("veiling glare", lambda: seen(replace(camera(), glare=0.05)), {0: 1.5},
          "a spot has a mean of its own"),
    Worst("vibration", lambda: seen(replace(camera(pitch=10e-6), vibration=10e-6)), {0: 4},
          "no PSF is known so well; what pixels fold back counts again"),
    Worst("axial colour", out_of_focus_by_colour, {0: 6}, "×1.3; every frequency at its worst"),
    Worst("lateral colour", colours_apart, {0: 16},
          "all light as in the corner, its phases as they are"),
    Worst("focus drift", lambda: seen(replace(camera(pitch=20e-6), focus_drift=4e-3,
                                              focus_drift_time=1e-6)),
          {0: 6}, "×1.3; every frequency at its worst"),
    Worst("distortion", bent, {0: 12}, "all light takes the longest way, its phases as they are"),
    Worst("dust", lambda: on_sensor(seen(target=Flat(1.0, 1e7), camera=camera()), dust=(SPECK,),
                                    dust_distance=2e-3), {0: 1.5},
          "pixels that are brighter than even light"),
    Worst("pixel crosstalk", lambda: on_sensor(seen(camera(pitch=60e-6)), crosstalk=0.05),
          {0: 2.5}, "a spot holds all frequencies, and few of them lose the most"),
]  # fmt: skip


def levels_of(s: Situation, one: Worst) -> dict[str, int]:
    """The structure of a PSF at its finest, other effects off unless they are wanted."""
    structure, top = ("PSF reach", "light sampling", "diffraction"), finest(s)
    wanted = {name: top[name] for name in structure} | (one.also or {})
    return {name: min(wanted.get(name, 0), level) for name, level in top.items()}


@pytest.mark.parametrize("one", WORST, ids=str)
def test_a_bound_is_near_what_its_effect_changes(one: Worst):
    s, cache = one.situation(), ByteCache()
    effect = next(effect for effect in EFFECTS if effect.name == one.effect)
    top = min(max(one.slack) + one.finer, effect.finest_level(s))
    levels = levels_of(s, one)
    whole = rendered(s, {**levels, one.effect: top}, cache)
    for level, slack in one.slack.items():
        changed = np.linalg.norm(rendered(s, {**levels, one.effect: level}, cache) - whole)
        assert changed > 1e-4 * np.linalg.norm(whole), "the effect doesn't matter here"
        assert changed <= effect.error_bound(s, level).mean <= slack * changed, (level, one.because)
    bounds = [effect.error_bound(s, level).mean for level in range(effect.finest_level(s) + 1)]
    assert bounds == sorted(bounds, reverse=True)


def test_every_effect_has_its_worst():
    assert {one.effect for one in WORST} == {effect.name for effect in EFFECTS}
