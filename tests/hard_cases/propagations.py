"""Free space: distances, models, planes, light that misses, refusals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
from figures.free_space import Form, soft_disc
from judges import Beam
from judges.fields import Cells, Gaussians, Pulse
from judges.view import WAVELENGTH

from hard_cases import propagation_laws
from hard_cases.table import DOUBLE, SINGLE, Agrees, Case, Refused
from hard_cases.ways import (
    BEAM,
    BEAMS,
    BY_EDGES,
    BY_FORM,
    BY_FRESNEL,
    BY_HANKEL,
    BY_NODES,
    BY_WAVES,
    EVANESCENT,
    SOURCE,
    Arrives,
    Way,
    beams_at,
    cells,
    corner,
    fringes,
    orders,
    reshaped,
    whole,
)
from optics.accuracy import Budget
from optics.plane import Plane
from optics.propagation import METHODS, FreeSpace


def on_the_axis(name: str, form: Form, tols: tuple[float, ...]) -> Agrees:
    return Agrees(
        f"the axis behind {name}",
        "a factor of 2 in the kernel, or an area left out, shows nowhere else as well",
        "radius 20 µm, 0.1 mm on, an edge of 1.2 µm",
        lambda tol: form.operator(tol)(torch.from_numpy(form.light)),
        lambda: form.truth,
        "Osterberg and Smith's closed form",
        tols=tols,
    )


DISC, ARAGO = (soft_disc(20e-6, 100e-6, 1.2e-6, opaque=o, paraxial=False) for o in (False, True))


# Refusals


def refused(
    name: str,
    hard_because: str,
    given: str,
    ask: Callable[[], Any],
    words: str,
    remedy: Callable[[float], Any] = lambda tol: BEAMS.operator(tol)(BEAMS.field),
) -> Refused:
    return Refused(name, hard_because, given, ask, words, remedy)


def lens(pitch: float) -> torch.Tensor:
    """A beam of 60 µm behind a lens whose fringes are 2 µm wide at its rim."""
    n = round(2.4e-4 / pitch)
    plane = Plane((n, n), (pitch, pitch))
    alpha = complex((40e-6) ** -2, math.pi / (WAVELENGTH * 2e-4))
    pulse = Pulse(0.0, 0.0, alpha)
    field = torch.from_numpy(Gaussians(((1.0, pulse, pulse),)).samples(plane))
    return FreeSpace(plane, Plane((5, 5), (1e-6, 1e-6)), 2e-4, WAVELENGTH)(field)


def wide_open(**settings: Any) -> torch.Tensor:
    """A field that its plane cuts off."""
    n = settings.pop("n", 24)
    plane = Plane((n, n), (1e-6, 1e-6))
    field = torch.from_numpy(Beam(6e-6).samples(plane))
    return FreeSpace(plane, BEAMS.target, 1e-4, WAVELENGTH, **settings)(field)


def huge(source: int, target: int, **settings: Any) -> FreeSpace:
    planes = [Plane((n, n), (1e-6, 1e-6)) for n in (source, target)]
    distance = settings.pop("distance", 1e-2)
    budget = Budget(memory=1 << 28)
    return FreeSpace(planes[0], planes[1], distance, WAVELENGTH, budget=budget, **settings)


def dark(centre: float, tol: float = SINGLE) -> torch.Tensor:
    way = replace(BEAMS, target=replace(BEAMS.target, centre=(centre, 0.0)))
    return way.operator(tol)(way.field)


CASES: list[Case] = [
    # Distances
    *(
        Arrives(
            f"two beams, {z:g} m on" + (", paraxial" if paraxial else ""),
            "so near a kernel is a needle, so far it is a plane, and k z has no digit left",
            beams_at(z, paraxial=paraxial),
            BY_FORM if paraxial else f"{BY_WAVES}, or over the field",
            # A million metres away phases have 1e9 turns, and float64 seven digits of one.
            tols=(SINGLE, DOUBLE if z < 1e3 else 1e-5),
        )
        for paraxial in (False, True)
        for z in (1e-9, -1e-6, 1e-3, -1.0, 1e6)
    ),
    *(
        Arrives(f"cells, {z:g} m on, paraxial",
                "edges ring: ever finer fringes, or 1e5 of them between two planes",
                cells(z, paraxial=True), BY_FRESNEL)
        for z in (1e-9, -1e-6, 1e-4)
    ),
    *(
        Arrives(f"cells, {z:g} m on",
                "a kernel as narrow as the distance, in cells that it must be integrated over",
                cells(z), BY_EDGES)
        for z in (3e-5, -1e-4, 3e-3)
    ),
    Arrives("cells a metre away, half a metre aside",
            "k r is 1e7 rad, and the way beyond z alone a million: single precision has none left",
            cells(1.0, Plane((4, 5), (3e-3, 4e-3), (0.3, -0.4)), kind=Cells), BY_NODES,
            tols=(SINGLE, 1e-5)),
    Arrives("cells a metre away, half a metre aside, paraxial",
            "chirps of 1e6 rad, to be kept in single precision",
            cells(1.0, Plane((4, 5), (3e-3, 4e-3), (0.3, -0.4)), paraxial=True), BY_FRESNEL,
            every=1, tols=(SINGLE, 1e-5)),
    Arrives("cells a thousand kilometres away", "the whole source is a point but for its phases",
            cells(1e6, orders(1e6, 0.5), kind=Cells), BY_NODES, tols=(SINGLE, 1e-4)),
    # Ways
    Arrives("two beams, by all ways", "a method's error is invisible to itself", BEAMS, BY_WAVES,
            every=2),
    Arrives("two beams, back by all ways", "a sign of the phase, which no intensity shows",
            replace(BEAMS, distance=-1e-4), BY_WAVES, every=2),
    Arrives("two beams, paraxial, by all ways",
            "three integrals that only the exact one is equal to", replace(BEAMS, paraxial=True),
            BY_FORM, every=2),
    Arrives("two beams, far on, paraxial, by all ways",
            "one transform, two of them, and convolutions", beams_at(-0.02, paraxial=True), BY_FORM,
            every=2),
    Arrives("a beam of two micrometres",
            "called exact elsewhere, with a paraxial kernel inside: 4 % off", BEAM, BY_HANKEL,
            every=2),
    Arrives("cells, by all ways", "sharp edges, which no spectrum holds", cells(1e-3), BY_EDGES,
            every=1),
    Arrives("cells, paraxial, by all ways", "chirps that are sampled, and integrals that aren't",
            cells(2e-2, paraxial=True), BY_FRESNEL, every=2),
    # Samples
    *(
        Arrives(f"{source[0]}x{source[1]} samples to {target[0]}x{target[1]}",
                "a swapped fftshift shows for odd sizes only, half a sample for even ones",
                reshaped(source, target), BY_WAVES, every=2)
        for source, target in (((71, 74), (8, 9)), ((74, 71), (9, 8)), ((75, 75), (15, 15)),
                               ((74, 74), (14, 14)))
    ),
    Arrives("samples finer than a wavelength",
            "the root of a negative number is NaN at half of the frequencies",
            replace(BEAM, distance=5e-6, target=Plane((7, 8), (0.5e-6, 0.6e-6), (1e-7, 0.0))),
            BY_HANKEL, every=2),
    Arrives("a target of ten nanometres", "a hundredth of the finest fringe",
            replace(BEAMS, target=Plane((5, 4), (1e-8, 1e-8), (7e-6, -4e-6))), BY_WAVES, every=1),
    Arrives("a target fifteen times coarser one way",
            "one pitch for both axes is the usual assumption",
            replace(BEAMS, target=Plane((10, 3), (0.6e-6, 9e-6), (4e-6, -5e-6))), BY_WAVES,
            every=1),
    Arrives("one sample of a target", "no neighbours, no frequencies",
            replace(BEAMS, target=Plane((1, 1), (1e-6, 1e-6), (6e-6, -5e-6))), BY_WAVES, every=1),
    *(
        Arrives(f"one cell, {'paraxial' if paraxial else 'scalar'}",
                "an axis of length 1 on both sides",
                cells(1e-3, Plane((1, 1), (1e-6, 1e-6), (2e-5, 0.0)), Plane((1, 1), (10e-6, 10e-6)),
                      (9e-6, 8e-6), paraxial=paraxial), BY_FRESNEL if paraxial else BY_EDGES,
                every=1)
        for paraxial in (False, True)
    ),
    Arrives("cells smaller than a wavelength", "most of their light grazes, or dies at once",
            cells(3e-6, Plane((5, 6), (1e-6, 1.5e-6)), Plane((6, 5), (0.3e-6, 0.4e-6)),
                  (0.3e-6, 0.35e-6)), BY_EDGES),
    Arrives("cells that are nearly all gap", "a thousandth of the area, over hundreds of orders",
            cells(1e-2, orders(1e-2, 3.0), sides=(0.3e-6, 0.2e-6), paraxial=True), BY_FRESNEL),
    # Steep light
    Arrives("fringes finer than two samples",
            "the carrier is aliased: without its name the light goes the other way",
            fringes(2.5e-6, 3.4e5), BY_WAVES, every=1),
    Arrives("fringes of nine samples", "a tilt that splits in two at some numbers of samples",
            fringes(1e-6, 1.1e5, 4.5e5), BY_WAVES, every=2),
    Arrives("light at 50 degrees", "the transfer function's phase is steepest where it ends",
            cells(2e-4, Plane((5, 6), (5e-6, 6e-6), (1.7e-4, -1.7e-4)), Plane((4, 5), (3e-6, 2e-6)),
                  (3e-6, 2e-6)), BY_EDGES),
    Arrives("the far corner of a wide window",
            "nodes that suffice on the axis are too few in the corner",
            cells(1e-3, Plane((4, 4), (8e-6, 8e-6), (6e-4, 6e-4))), BY_EDGES, every=1),
    Arrives("a far corner, paraxial", "the chirp turns by a wave from sample to sample",
            cells(1e-3, Plane((4, 4), (8e-6, 8e-6), (6e-4, 6e-4)), paraxial=True), BY_FRESNEL,
            every=1),
    Arrives("a hundred windows aside", "what is centred on the axis has to reach that far",
            cells(0.1, Plane((4, 5), (1e-5, 1e-5), (5e-3, -4e-3)), paraxial=True), BY_FRESNEL,
            every=1),
    # Copies
    Arrives("the third order of cells",
            "spectra repeat; light doesn't: under the envelope of a cell it is a tenth",
            cells(5e-2, orders(5e-2, 3.0), paraxial=True), BY_FRESNEL, every=1),
    Arrives("a target wider than the spectrum's copies",
            "nine spots for one: the same light again at every period of the transform",
            replace(BEAMS, distance=2e-3, paraxial=True,
                    target=Plane((9, 10), (3e-4, 3e-4), SOURCE.centre)), BY_FORM, every=1),
    Arrives("one lit cell in a corner, seen opposite",
            "what wraps around comes out there, where hardly any light is",
            cells(3e-4, Plane((3, 3), (8e-6, 8e-6), (-1e-4, 1e-4)),
                  Plane((12, 13), (16e-6, 16e-6)), (16e-6, 16e-6), corner(12, 13)), BY_EDGES,
            every=1),
    Arrives("one lit cell in a corner, seen opposite, paraxial",
            "the same for a Fresnel transfer function",
            cells(3e-4, Plane((3, 3), (8e-6, 8e-6), (-1e-4, 1e-4)),
                  Plane((12, 13), (16e-6, 16e-6)), (16e-6, 16e-6), corner(12, 13), paraxial=True),
            BY_FRESNEL, every=1),
    # Little light
    *(
        Arrives(f"{share} of the light",
                "errors of a transform are shares of all the light, and most of it is elsewhere",
                replace(BEAMS, target=replace(BEAMS.target, centre=(y, 0.0)), paraxial=True),
                BY_FORM, tols=tols)
        for share, y, tols in (("a thousandth", 2.1e-5, (SINGLE, DOUBLE)),
                               ("a millionth", 2.9e-5, (SINGLE, 1e-6)))
    ),
    # Tilted targets
    *(
        Arrives(f"a plane turned by ({a:g}, {b:g}) rad",
                "each sample has a distance of its own, and a tilt of its own wave",
                replace(BEAMS, distance=z, tilt=(a, b),
                        target=Plane((6, 7), (3e-6, 3e-6), (8e-6, 0.0))),
                BY_WAVES, every=1)
        for a, b, z in ((0.3, -0.7, 1e-4), (-1.2, 0.4, -1e-4))
    ),
    Arrives("a turned plane before cells", "sharp edges under a tilt",
            cells(1e-3, Plane((5, 4), (9e-6, 8e-6), (2e-5, 0.0)), tilt=(0.5, 0.6)), BY_EDGES),
    Arrives("a turned plane before cells, paraxial", "the axial phase of each sample remains",
            cells(1e-3, Plane((5, 4), (9e-6, 8e-6), (2e-5, 0.0)), tilt=(0.5, 0.6), paraxial=True),
            BY_FRESNEL),
    # On the axis
    on_the_axis("a disc", DISC, (SINGLE, DOUBLE, 5e-10)),
    on_the_axis("an opaque disc", ARAGO, (SINGLE, DOUBLE)),
    # Evanescent light
    *(
        Arrives(f"a beam of a quarter of a micrometre, {z:g} m on",
                "half of it is evanescent: on the way back it grows by 1e33 elsewhere, then NaN",
                Way(Beam(0.25e-6), EVANESCENT,
                    Plane((5, 6), (0.1e-6 + abs(z) / 10, 0.1e-6 + abs(z) / 9)), z,
                    settings=whole(EVANESCENT)), BY_HANKEL)
        for z in (1e-7, -1e-7, -1e-6, -1e-5, -1e-4)
    ),
    *propagation_laws.CASES,
    # Refusals
    refused("fringes that the samples don't hold",
            "a lens' phase, sampled too coarsely, is accepted elsewhere: 99 % off, no warning",
            "a 60 µm beam behind a lens of 0.2 mm, 2 µm samples",
            lambda: lens(2e-6), "outside carrier ± band .* Sample it finer",
            lambda tol: lens(0.25e-6)),
    refused("a tilt that nobody announced", "0.45 cycles a sample: what comes of it depends on N",
            "carrier left out", lambda: replace(fringes(1e-6, 4.5e5), settings={}).operator(SINGLE)(
                fringes(1e-6, 4.5e5).field), "outside carrier ± band .* carrier=",
            lambda tol: fringes(1e-6, 4.5e5).operator(SINGLE)(fringes(1e-6, 4.5e5).field)),
    refused("a field that its plane cuts off", "its copies next door are what an FFT shows there",
            "waist 6 µm on 24 µm",
            wide_open, "doesn't vanish at the source's edges", lambda tol: wide_open(n=64)),
    refused("a smooth field of one sample", "an axis of length 1 has no frequencies but zero",
            "1x1 sample",
            lambda: FreeSpace(Plane((1, 1), (1e-6, 1e-6)), BEAMS.target, 1e-4, WAVELENGTH)(
                torch.ones(1, 1)), "doesn't vanish at the source's edges.* cells=",
            lambda tol: FreeSpace(Plane((1, 1), (1e-6, 1e-6)), BEAMS.target, 1e-4, WAVELENGTH,
                                  cells=(1e-6, 1e-6))(torch.ones(1, 1))),
    refused("cells a nanometre on", "no ray leaves a point for the next cell but along the plane",
            "scalar, 7x8 cells of 10 µm",
            lambda: cells(1e-9).operator(SINGLE), "1e-09 m away|graze",
            lambda tol: cells(3e-5).operator(tol)(cells(3e-5).field)),
    *(
        refused(f"free space without memory: {name}",
                "allocating first and failing then takes the machine along",
                given, ask, "MB|memory", remedy)
        for name, given, ask, remedy in (
            ("a huge target", "60x60 to 1e6 x 1e6 samples", lambda: huge(60, 10**6),
             lambda tol: huge(60, 10)),
            ("a huge source", "1e6 x 1e6 samples", lambda: huge(10**6, 60),
             lambda tol: huge(60, 60)),
            ("huge cells", "1e6 x 1e6 cells", lambda: huge(10**6, 60, cells=(1e-6, 1e-6)),
             lambda tol: huge(60, 60, cells=(1e-6, 1e-6))),
            ("huge, paraxial", "1e6 x 1e6 samples", lambda: huge(10**6, 60, paraxial=True),
             lambda tol: huge(60, 60, paraxial=True)),
            ("huge and tilted", "60x60 to 1e5 x 1e5",
             lambda: huge(60, 10**5, tilt=(0.01, 0.0), distance=1.0),
             lambda tol: huge(60, 20, tilt=(0.01, 0.0))),
        )
    ),
    refused("a target that gets no light", "a relative error of nothing",
            "a beam of 6 µm, 0.1 mm beside it",
            lambda: dark(1.2e-4), "hardly any light|none of the field's light",
            lambda tol: dark(1e-5)),
    refused("free space to a tolerance below rounding", "float64 ends at 1e-16", "tol 1e-15",
            lambda: BEAMS.operator(1e-15), "tol 1e-15 can't be kept",
            lambda tol: BEAMS.operator(tol)(BEAMS.field)),
    *(
        refused(f"free space with {name}",
                "NaN passes every comparison that is written the wrong way round",
                name, ask, words)
        for name, ask, words in (
            ("a distance of 0 m", lambda: replace(BEAMS, distance=0.0).operator(SINGLE),
             "distance is 0 m"),
            ("a distance of NaN", lambda: replace(BEAMS, distance=math.nan).operator(SINGLE),
             "distance is nan"),
            ("an infinite distance", lambda: replace(BEAMS, distance=math.inf).operator(SINGLE),
             "distance is inf"),
            ("a wavelength of 0 m", lambda: replace(BEAMS, wavelength=0.0).operator(SINGLE),
             "wavelength is 0"),
            ("a wavelength of NaN", lambda: replace(BEAMS, wavelength=math.nan).operator(SINGLE),
             "wavelength is nan"),
            ("a tolerance of NaN", lambda: BEAMS.operator(math.nan), "tol is nan"),
            ("a tolerance of 0", lambda: BEAMS.operator(0.0), "tol is 0"),
            ("cells wider than their pitch",
             lambda: huge(60, 60, cells=(2e-6, 1e-6)), "cells are 2e-06 m wide"),
            ("a band beyond the samples", lambda: huge(60, 60, band=(6e5, 1e5)),
             "band is 600000|band is 6e"),
            ("a target turned through the source",
             lambda: replace(BEAMS, tilt=(1.5, 0.0), distance=1e-6).operator(SINGLE),
             "on the other side|through the source's plane"),
            ("a target seen edge-on", lambda: replace(BEAMS, tilt=(1.6, 0.0)).operator(SINGLE),
             "must face the source"),
            ("a method that nobody has", lambda: BEAMS.operator(SINGLE, "FFT"),
             "method is 'FFT'; choose one of angular spectrum"),
            ("a method for another question", lambda: cells(1e-3).operator(SINGLE, METHODS[0]),
             "serves smooth fields"),
            ("NaN among the samples",
             lambda: BEAMS.operator(SINGLE)(torch.full(SOURCE.shape, math.nan)),
             "field has 5400 NaN"),
            ("a transposed field", lambda: BEAMS.operator(SINGLE)(BEAMS.field.T),
             r"field is \(75, 72\)"),
        )
    ),
]  # fmt: skip
