"""The kinds of patterns that the window offers: what is asked for, and the plan table it makes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from labapp.window.messages import PatternTable

Values = dict[str, Any]
"""What the fields of a page hold, by key."""


@dataclass(frozen=True)
class Number:
    """A number between two limits; whole numbers have no decimals."""

    key: str
    label: str
    unit: str
    low: float
    high: float
    first: float
    decimals: int = 2


@dataclass(frozen=True)
class Words:
    """A line of text."""

    key: str
    label: str
    first: str = ""
    longest: int = 80


@dataclass(frozen=True)
class PictureFile:
    """The path of a picture."""

    key: str
    hint: str


Field = Number | Words | PictureFile


def _as_it_is(kind: str) -> Callable[[Values], PatternTable]:
    return lambda values: {"kind": kind} | values


def _psf(shape: str) -> Callable[[Values], PatternTable]:
    return lambda values: {"kind": "psf", "target": {"shape": shape} | values}


@dataclass(frozen=True)
class Kind:
    """A kind by the name that the window remembers it by, and what a person calls it.

    table: of the fields' values, as a plan file writes the pattern. coded: whether it is made
    for a wavelength.
    """

    name: str
    title: str
    fields: tuple[Field, ...]
    table: Callable[[Values], PatternTable]
    coded: bool = True


_RADIUS = Number("radius_um", "Radius", " µm", 1, 2000, 80)
_WIDTH = Number("width_um", "Width", " µm", 0.5, 500, 8)
_ANGLE = Number("angle_deg", "Direction", "°", -360, 360, 0)
_DEEPEST = 10_000


def _aberrations(values: Values) -> PatternTable:
    orders = {"defocus": (2, 0), "astigmatism": (2, 2), "coma": (3, 1), "spherical": (4, 0)}
    terms = [[n, m, values[name]] for name, (n, m) in orders.items()]
    return {"kind": "zernike", "terms": terms}


def _path(key: str, label: str, first: float = 0) -> Number:
    return Number(key, label, " nm rms", -_DEEPEST, _DEEPEST, first)


KINDS: tuple[Kind, ...] = (
    Kind("constant", "Neutral", (), _as_it_is("constant"), coded=False),
    Kind("ring", "Ring", (_RADIUS, _WIDTH), _as_it_is("ring")),
    Kind("spiral", "Spiral", (_RADIUS, _WIDTH), _psf("spiral")),
    Kind("heart", "Heart", (_RADIUS, _WIDTH), _psf("heart")),
    Kind("infinity", "Infinity", (_RADIUS, _WIDTH), _psf("infinity")),
    Kind("eye", "Eye", (_RADIUS, _WIDTH), _psf("eye")),
    Kind(
        "dots",
        "Dots",
        (Number("count", "Count", "", 1, 200, 8, decimals=0), _RADIUS, _WIDTH),
        _psf("dots"),
    ),
    Kind(
        "letters",
        "Letters",
        (
            Words("text", "Text", "EI"),
            Number("height_um", "Height", " µm", 5, 2000, 100),
            Number("width_um", "Width", " µm", 0.5, 500, 5),
        ),
        _psf("letters"),
    ),
    Kind(
        "logo",
        "Logo from a picture",
        (
            PictureFile("file", "8-bit picture, bright is light"),
            Number("size_um", "Size", " µm", 5, 4000, 160),
        ),
        _psf("logo"),
    ),
    Kind(
        "lens",
        "Fresnel lens",
        (Number("focal_length_m", "Focal length", " m", -1000, 1000, 20),),
        _as_it_is("lens"),
    ),
    Kind(
        "axicon",
        "Axicon",
        (Number("radius_um", "Radius", " µm", 1, 5000, 80),),
        _as_it_is("axicon"),
    ),
    Kind(
        "cubic",
        "Cubic",
        (Number("strength_rad", "Strength", " rad", -_DEEPEST, _DEEPEST, 60),),
        _as_it_is("cubic"),
    ),
    Kind(
        "annular",
        "Annular",
        (
            Number("rings", "Rings", "", 1, 500, 8, decimals=0),
            Number("depth_rad", "Depth", " rad", -_DEEPEST, _DEEPEST, 6.28),
        ),
        _as_it_is("annular"),
    ),
    Kind(
        "blaze",
        "Blazed grating",
        (Number("period_px", "Period", " px", 1, 10_000, 40), _ANGLE),
        _as_it_is("blaze"),
    ),
    Kind(
        "sine",
        "Sine",
        (
            Number("amplitude_rad", "Amplitude", " rad", 0, _DEEPEST, 3.14),
            Number("period_px", "Period", " px", 4, 10_000, 120),
            _ANGLE,
        ),
        _as_it_is("sine"),
    ),
    Kind(
        "patches",
        "Random patches",
        (
            Number("rows", "Rows", "", 1, 4096, 9, decimals=0),
            Number("columns", "Columns", "", 1, 4096, 16, decimals=0),
        ),
        _as_it_is("patches"),
    ),
    Kind(
        "zernike",
        "Aberrations",
        (
            _path("defocus", "Defocus"),
            _path("astigmatism", "Astigmatism"),
            _path("coma", "Coma"),
            _path("spherical", "Spherical", 100),
        ),
        _aberrations,
    ),
    Kind(
        "image",
        "Image file",
        (PictureFile("file", "8-bit picture of the panel's size, or a design file"),),
        _as_it_is("image"),
        coded=False,
    ),
)
