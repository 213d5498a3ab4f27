"""Other libraries on the same way through free space: one adapter for each of them.

A library gets the same samples of a smooth field and gives the field on the same plane. What it
computes once for a plane and a distance is left out of its time where it keeps that. All of
them but DeepLens' transfer function count the factor exp(ikz), which is taken away. None takes
a tolerance: their knobs are how far a field is padded, and hcipy's finer transfer functions.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch

from labapp.accuracy.propagate import FieldCase
from labapp.accuracy.references.free_space import Complex, Real, SmoothLight
from labapp.accuracy.work_precision import Candidate, PlannedCall, Row, raise_refusal
from labapp_peers.library import (
    COMPLEX,
    MOST_BYTES,
    Call,
    in_words,
    load_library,
    torchoptics_precision,
)

_PADS = (1, 2, 4)
_DEEPLENS = ("deeplens.optics.wave", "deeplens.light.wave", "deeplens.optics.light.wave")
"""Where its releases keep wave propagation."""


@dataclass(frozen=True)
class _Way:
    """A way through a library: in words, and `set_up(library, case, pad, precision)`.

    same: it gives the field on the source's own samples only. turns: with exp(ikz). pads: the
    planes that it is tried on, in sides of the source.
    """

    words: str
    set_up: Callable[[Any, FieldCase, int, str], Call]
    same: bool = True
    turns: bool = True
    pads: tuple[int, ...] = _PADS
    precisions: tuple[str, ...] = tuple(COMPLEX)


def candidates(case: FieldCase, seen: Callable[[Any], Real]) -> Iterator[Candidate]:
    """hcipy, DeepLens and torchoptics with every padding and precision that they offer.

    seen: of a whole answer, what is compared. A library that can't be loaded, or isn't made
    for the question, is one candidate, whose plan says why; whatever it raises is a ValueError
    in words.
    """
    for name, ways in _ways(case).items():
        try:
            if not isinstance(case.field, SmoothLight):
                raise ValueError(
                    "peers are compared on smooth fields, which their samples stand for"
                )
            library, label = _load(name)
        except ValueError as error:
            yield Candidate(
                Row("propagate", case.name, name, "float64", None), partial(raise_refusal, error)
            )
            continue
        for way in ways:
            for pad in way.pads:
                for precision in way.precisions:
                    words = f"{label}, {way.words}, {pad * case.source.shape[0]}² samples"
                    plan = partial(_plan, label, way, library, case, pad, precision, seen)
                    yield Candidate(Row("propagate", case.name, words, precision, None), plan)


def _ways(case: FieldCase) -> dict[str, list[_Way]]:
    if case.paraxial:
        return {
            "hcipy": [
                _Way(f"Fresnel, {finer}x finer", partial(_hcipy, "FresnelPropagator", finer))
                for finer in (1, 2)
            ],
            "deeplens": [
                _Way("Fresnel TF", partial(_deeplens, "FresnelDiffraction", TF=True), turns=False),
                _Way("Fresnel IR", partial(_deeplens, "FresnelDiffraction", TF=False)),
            ],
            "torchoptics": [
                _Way("ASM_FRESNEL", partial(_torchoptics, "ASM_FRESNEL"), same=False),
                _Way("DIM_FRESNEL", partial(_torchoptics, "DIM_FRESNEL"), same=False, pads=(1,)),
            ],
        }
    return {
        "hcipy": [
            _Way(
                f"angular spectrum, {finer}x finer",
                partial(_hcipy, "AngularSpectrumPropagator", finer),
            )
            for finer in (1, 2)
        ],
        # Its Rayleigh-Sommerfeld integral takes a minute where these take milliseconds.
        "deeplens": [_Way("angular spectrum", partial(_deeplens, "AngularSpectrumMethod"))],
        "torchoptics": [
            _Way("ASM", partial(_torchoptics, "ASM"), same=False),
            _Way("DIM", partial(_torchoptics, "DIM"), same=False, pads=(1,)),
        ],
    }


def _load(name: str) -> tuple[Any, str]:
    library, label = load_library(name)
    if name != "deeplens":
        return library, label
    for where in _DEEPLENS:
        try:
            return importlib.import_module(where), label
        except ModuleNotFoundError as error:
            if not where.startswith(str(error.name)):
                raise ValueError(f"{name} is installed but can't be loaded: {error}") from error
    raise ValueError(f"{name} is installed, and its wave propagation isn't where it was")


def _plan(
    label: str,
    way: _Way,
    library: Any,
    case: FieldCase,
    pad: int,
    precision: str,
    seen: Callable[[Any], Real],
) -> PlannedCall:
    """Candidate's plan, with a library's troubles in words and its answers checked."""
    source, target = case.source, case.target
    if way.same and target != source:
        raise ValueError(f"{label} gives the field on the source's own samples only")
    used = 6 * np.dtype(COMPLEX[precision]).itemsize * (2 * pad * max(source.shape)) ** 2
    if used > MOST_BYTES:
        raise ValueError(f"{label}: {used / 1e9:.1f} GB, more than is tried")
    with in_words(label):
        call = way.set_up(library, case, pad, precision)
    turns = case.distance / case.wavelength if way.turns else 0.0
    back = np.exp(-2j * np.pi * (turns % 1))

    def answer() -> Real:
        with in_words(label):
            values = call()
            if tuple(values.shape) != target.shape:
                raise ValueError(f"an array of {tuple(values.shape)}, not of {target.shape}")
            compared = seen(values)
            turned = (compared[0] + 1j * compared[1]) * back
        if not math.isfinite(float(np.abs(turned).sum())):
            raise ValueError(f"{label} gave a field with values that aren't finite")
        return np.stack([turned.real, turned.imag])

    return PlannedCall(answer, used)


def _padded(case: FieldCase, pad: int, precision: str) -> tuple[Complex, tuple[slice, slice]]:
    """The source's field in the middle of a larger plane, and where it is there."""
    rows, columns = case.source.shape
    wide: Complex = np.zeros((pad * rows, pad * columns), dtype=COMPLEX[precision])
    # The origin n // 2 stays the origin.
    y, x = pad * rows // 2 - rows // 2, pad * columns // 2 - columns // 2
    middle = (slice(y, y + rows), slice(x, x + columns))
    wide[middle] = case.field.samples
    return wide, middle


def _hcipy(name: str, finer: int, hcipy: Any, case: FieldCase, pad: int, precision: str) -> Call:
    """hcipy's Fresnel or angular spectrum, which pad twice themselves and average the transfer
    function over `finer`² places a frequency."""
    light, middle = _padded(case, pad, precision)
    extent = [n * p for n, p in zip(light.shape[::-1], case.source.pitch[::-1], strict=True)]
    grid = hcipy.make_uniform_grid(list(light.shape[::-1]), extent, has_center=True)
    propagator = getattr(hcipy, name)(grid, case.distance, num_oversampling=finer)
    wave = hcipy.Wavefront(hcipy.Field(light.ravel(), grid), case.wavelength)
    return lambda: np.asarray(propagator.forward(wave).electric_field.shaped)[middle]


def _deeplens(
    name: str, wave: Any, case: FieldCase, pad: int, precision: str, **settings: Any
) -> Call:
    """DeepLens' functions, which pad by half to each side; millimetres, and micrometres of
    wavelength."""
    if case.source.pitch[0] != case.source.pitch[1]:
        raise ValueError("its pixels are square")
    light, middle = _padded(case, pad, precision)
    field = torch.from_numpy(light)[None, None]
    lengths = {
        "z": 1e3 * case.distance,
        "wvln": 1e6 * case.wavelength,
        "ps": 1e3 * case.source.pitch[0],
    }
    function = getattr(wave, name)
    return lambda: function(field, **lengths, **settings)[0, 0][middle]


def _torchoptics(method: str, torchoptics: Any, case: FieldCase, pad: int, precision: str) -> Call:
    """torchoptics' angular spectrum, padded `pad` times its field to each side, or its direct
    sum, which needs none. Other samples than the source's it finds by interpolation."""
    source, target = case.source, case.target
    with torchoptics_precision(torchoptics, getattr(torch, precision)):
        field = torchoptics.Field(
            torch.from_numpy(case.field.samples.astype(COMPLEX[precision])),
            case.wavelength,
            spacing=source.pitch,
            offset=_middle(case, "source"),
        )
    settings: dict[str, Any] = {"propagation_method": method, "interpolation_mode": "bicubic"}
    if method.startswith("ASM"):
        settings["asm_pad"] = tuple(pad * n for n in source.shape)
    if target.pitch == source.pitch:
        settings["interpolation_mode"] = "nearest"
    offset = _middle(case, "target")

    def call() -> Any:
        with torchoptics_precision(torchoptics, getattr(torch, precision)):
            where = target.shape, case.distance, target.pitch, offset
            return field.propagate(*where, **settings).data

    return call


def _middle(case: FieldCase, name: str) -> tuple[float, float]:
    """Halfway between a plane's first and last samples, as torchoptics centres its grids."""
    plane = getattr(case, name)
    ends = [plane.coordinates(axis)[[0, -1]].mean().item() for axis in (0, 1)]
    return ends[0], ends[1]
