"""Questions that nobody means, drawn by seed: numbers far from any, or in another unit.

Every question runs in a forked process of its own, with limits. An answer consists of finite
numbers. A refusal is a ValueError or TypeError that the product raised itself: one that comes out
of a library, or of Python's arithmetic, tells nobody what to do.
"""

from __future__ import annotations

import math
import os
import pickle
import random
import resource
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

ANSWERED, REFUSED, RAW, NOT_FINITE, CUT = "answered", "refused", "raw", "not finite", "cut off"

_ADDRESSES, _SECONDS = 12 << 30, 60
"""Limits of a process: bytes of addresses, seconds of processor time."""

_OWN = Path(__file__).parents[2]
_ROOMS = tuple(str(_OWN / room) + os.sep for room in ("optics", "simulator"))

Values = dict[str, Any]


@dataclass(frozen=True)
class Finding:
    """How a question ended. seconds: of the processor. bytes: beyond the process' first ones."""

    question: str
    fate: str
    told: str
    seconds: float
    bytes: int


def _lens(v: Values) -> Any:
    from optics.camera import Lens
    from optics.camera.stop import Circle, Stop, regular_polygon

    blades, ring = v.get("blades"), v.get("obscuration")
    opening = Circle() if blades is None else regular_polygon(blades)
    inner = () if ring is None else (Circle(ring),)
    path = v.get("aberration")
    terms = () if path is None else ((v.get("degree", 4), v.get("cycles", 0), path),)
    return Lens(
        v["focal_length"], v["f_number"], v["focus_distance"], Stop(opening, inner),
        aberrations=terms, kind=v.get("kind", "thin"),
    )  # fmt: skip


def _pixels(v: Values) -> Any:
    from optics.plane import Plane

    shape = (v["rows"], v["columns"])
    return Plane(shape, (v["pitch"], v["pitch"]), (v.get("centre", 0.0), 0.0))


def _settings(v: Values) -> Values:
    found = {name: v[name] for name in ("tol", "phase_slope", "pixel_tol", "calls") if name in v}
    if "field" in v:
        found["field"] = (v["field"], 0.0)
    if "integrate" in v:
        found["integrate"] = v["integrate"]
    return found


def _ask_lens(v: Values) -> Any:
    from optics.psf import PSFOperator

    return PSFOperator(_lens(v), v["distance"], v["wavelength"], _pixels(v), **_settings(v))()


def _camera(v: Values) -> Any:
    from optics.camera import Camera, Panel, Sensor

    panel = Panel((v["panel_rows"], 80), v["panel_pitch"], fill_factor=v.get("fill_factor", 0.87))
    return Camera(panel, _lens(v), Sensor(), separation=v.get("separation", 0.0))


def _ask_camera(v: Values) -> Any:
    from optics.psf import PSFOperator

    camera = _camera(v)
    operator = PSFOperator(camera, v["distance"], v["wavelength"], _pixels(v), **_settings(v))
    phase = torch.full(camera.panel.shape, float(v.get("phase", 0.0)))
    amplitude = torch.full(camera.panel.shape, float(v.get("amplitude", 1.0)), dtype=torch.float64)
    return operator(phase, amplitude)


def _ask_bands(v: Values) -> Any:
    from optics.psf import PolychromaticPSF

    waves, weights = [v["wavelength"], 5.5e-7], [v.get("weight", 1.0), 1.0]
    return PolychromaticPSF(_camera(v), v["distance"], waves, weights, _pixels(v))(None)


def _ask_stack(v: Values) -> Any:
    from optics.psf import PSFStack

    return PSFStack(_camera(v), [v["distance"], 2.0], [v["wavelength"]], _pixels(v))(None)


def _ask_free_space(v: Values) -> Any:
    from optics.propagation import FreeSpace

    source, target = _pixels(v), _pixels({**v, **v.get("target", {})})
    rows, columns = source.shape
    side = v.get("cell", 1.0) * v["pitch"]
    cells = (side, side) if v.get("cells", True) else None
    way = FreeSpace(
        source, target, v["distance"], v["wavelength"], cells=cells, tol=v.get("tol", 1e-3),
        tilt=(v.get("tilt", 0.0), 0.0), carrier=(v.get("carrier", 0.0), 0.0),
    )  # fmt: skip
    field = np.exp(-(np.linspace(-4, 4, rows)[:, None] ** 2) - np.linspace(-4, 4, columns) ** 2)
    return way(torch.from_numpy(field).to(torch.complex64) * v.get("strength", 1.0))


def _ask_pattern(v: Values) -> Any:
    from optics import patterns
    from optics.camera import Panel

    panel = Panel((v["panel_rows"], 80), v["panel_pitch"])
    kinds: dict[str, Callable[[], Any]] = {
        "lens": lambda: patterns.fresnel_lens(panel, v["focal_length"], v["wavelength"]),
        "axicon": lambda: patterns.axicon(panel, v["radius"], v["distance"], v["wavelength"]),
        "grating": lambda: patterns.blazed_grating(panel, v["period"], v["direction"]),
        "sine": lambda: patterns.sine_grating(panel, v["period"], v["depth"]),
        "cubic": lambda: patterns.cubic_phase_mask(panel, v["strength"]),
        "steer": lambda: patterns.steering_grating(
            panel, (v["radius"], 0.0), v["distance"], v["wavelength"]
        ),
        "zernike": lambda: patterns.zernike_pattern(
            panel, [(v["degree"], 0, v["aberration"])], v["pupil"], v["wavelength"]
        ),
    }
    return kinds[v["kind"]]()


def _ask_scene(v: Values) -> Any:
    from optics.camera import Camera, Lens, Panel, Sensor
    from optics.light import Band
    from simulator.imaging import Imaging
    from simulator.mount import Mount
    from simulator.panel_content import PanelContent
    from simulator.scene import Star
    from simulator.situation import Situation

    panel = Panel((24, 32), v["panel_pitch"], fill_factor=0.81)
    lens = Lens(v["focal_length"], v["f_number"], v["focus_distance"])
    camera = Camera(panel, lens, Sensor(shape=(20, 24), pitch=v["pitch"], full_well=1e7, bits=16))
    star = Star(v["diameter"], v["distance"], v["radiance"])
    shown = PanelContent.of(np.zeros((1, *panel.shape), np.uint8), math.inf)
    band = Band(v["wavelength"], v["bandwidth"])
    s = Situation(camera, Mount(), star.for_camera(camera), band, shown, 0.0, v["exposure"])
    imaging = Imaging(v.get("tol", 1e-2), decide_by="estimate")
    return imaging.picture_moments(s, imaging.plan(s).recipe).mean


_OPTICS = {
    "focal_length": 0.05, "f_number": 8.0, "focus_distance": 2.0, "distance": 2.2,
    "wavelength": 5.5e-7, "rows": 8, "columns": 8, "pitch": 2e-6,
}  # fmt: skip
_BEHIND = {**_OPTICS, "panel_rows": 60, "panel_pitch": 40e-6}
_MORE = {
    "tol": 1e-3, "blades": 6, "obscuration": 0.3, "aberration": 1e-7, "degree": 4, "centre": 0.0,
    "phase_slope": 5.0, "pixel_tol": 1e-5, "calls": 10, "field": 0.0,
}  # fmt: skip
_OF_PANEL = {
    "tol": 1e-3, "centre": 0.0, "field": 1e-4, "aberration": 1e-7, "fill_factor": 0.9, "phase": 1.0,
    "amplitude": 1.0, "calls": 10,
}  # fmt: skip
_BEAM = {"distance": 0.1, "wavelength": 5.5e-7, "rows": 64, "columns": 64, "pitch": 8e-6}
_SCENE = {
    "focal_length": 0.05, "f_number": 40.0, "focus_distance": 1.0, "distance": 1.0,
    "wavelength": 5.5e-7, "bandwidth": 2e-8, "pitch": 20e-6, "panel_pitch": 40e-6,
    "diameter": 40e-6, "radiance": 2e12, "exposure": 0.01,
}  # fmt: skip
_SHOWN = {"panel_rows": 60, "panel_pitch": 8e-6, "wavelength": 5.5e-7}

KINDS: dict[str, tuple[Callable[[Values], Any], Values, Values]] = {
    "lens": (_ask_lens, _OPTICS, _MORE),
    "panel": (_ask_camera, _BEHIND, _OF_PANEL),
    "chain": (_ask_camera, {**_BEHIND, "separation": 0.05}, _OF_PANEL),
    "bands": (_ask_bands, _BEHIND, {"weight": 1.0}),
    "stack": (_ask_stack, _BEHIND, {}),
    "free space": (
        _ask_free_space,
        _BEAM,
        {"cell": 0.9, "tol": 1e-3, "tilt": 0.1, "strength": 1.0, "centre": 0.0},
    ),
    "beam": (_ask_free_space, {**_BEAM, "cells": False}, {"tol": 1e-3, "carrier": 0.0}),
    "pattern lens": (_ask_pattern, {**_SHOWN, "kind": "lens", "focal_length": 1.0}, {}),
    "axicon": (_ask_pattern, {**_SHOWN, "kind": "axicon", "radius": 1e-4, "distance": 0.1}, {}),
    "grating": (_ask_pattern, {**_SHOWN, "kind": "grating", "period": 8e-5, "direction": 0.3}, {}),
    "steering": (_ask_pattern, {**_SHOWN, "kind": "steer", "radius": 1e-4, "distance": 0.1}, {}),
    "cubic": (_ask_pattern, {**_SHOWN, "kind": "cubic", "strength": 10.0}, {}),
    "zernike": (
        _ask_pattern,
        {**_SHOWN, "kind": "zernike", "degree": 4, "aberration": 1e-7, "pupil": 2e-4},
        {},
    ),
    "scene": (_ask_scene, _SCENE, {"tol": 1e-2}),
}
"""Name: what is asked, its sound values, and further ones that may be absurd."""

_COUNTS = ("rows", "columns", "panel_rows", "blades", "degree", "calls")
_ABSURD = (
    0.0, -1.0, math.nan, math.inf, -math.inf, 5e-324, 1e-300, 1e-30, 1e-15, 1e-10, 1e10, 1e30,
    1e300, True, 3,
)  # fmt: skip
_FACTORS = (1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 1e2, 1e3, 1e4, 1e6, 1e9)
"""A sound value times one of them is a number in another unit, or a few decades off."""
_ABSURD_COUNTS = (0, -1, 1, 2, 2.5, math.nan, True, 999, 4000, 100_000, 10**7, 10**9, 10**18)


def draw(seed: int) -> tuple[str, Values]:
    """Draw a question: a kind, and its values, of which one or two are absurd."""
    rng = random.Random(seed)
    kind = rng.choice(list(KINDS))
    _, sound, more = KINDS[kind]
    values, changed = dict(sound), []
    names = [name for name in (*sound, *more) if name not in ("kind", "cells", "target")]
    for name in rng.sample(names, rng.choice((1, 1, 2))):
        usual = sound.get(name, more.get(name))
        if name in _COUNTS:
            values[name] = rng.choice(_ABSURD_COUNTS)
        elif rng.random() < 0.5 or not usual:
            values[name] = rng.choice(_ABSURD)
        else:
            values[name] = usual * rng.choice(_FACTORS)
        changed.append(f"{name}={values[name]:g}")
    return f"{kind} {seed}: {', '.join(changed)}", values


def ask(seed: int) -> Finding:
    """Ask the question of a seed in a forked process, and tell how it ended."""
    question, values = draw(seed)
    kind = question.split(":")[0].rsplit(" ", 1)[0]
    function = KINDS[kind][0]
    return run_limited(question, lambda: function(values))


def run_limited(question: str, call: Callable[[], Any]) -> Finding:
    """Run a call in a forked process with limits of time and memory."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        with os.fdopen(writing, "wb") as out:
            out.write(pickle.dumps(_fate(call)))
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as found:
        answer = found.read()
    _, _, used = os.wait4(child, 0)
    fate, told, seconds, grown = (
        pickle.loads(answer) if answer else (CUT, "", used.ru_utime + used.ru_stime, _ADDRESSES)
    )
    return Finding(question, fate, told, seconds, grown)


def _fate(call: Callable[[], Any]) -> tuple[str, str, float, int]:
    resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS + 1))
    before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    try:
        answer = torch.as_tensor(call())
        fate, told = (ANSWERED, "") if bool(torch.isfinite(answer).all()) else (NOT_FINITE, "")
    except Exception as error:
        fate, told = _refusal(error), f"{type(error).__name__}: {error}"
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return fate, told, time.process_time() - started, 1024 * grown


def _refusal(error: Exception) -> str:
    """Tell a refusal in the product's own words from an error of a library or of arithmetic."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    own = last.filename.startswith(_ROOMS) and (last.line or "").lstrip().startswith("raise")
    return REFUSED if own and isinstance(error, (ValueError, TypeError)) else RAW


def ask_all(seeds: range) -> Iterator[Finding]:
    for seed in seeds:
        yield ask(seed)
