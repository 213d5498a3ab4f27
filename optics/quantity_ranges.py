"""Hold the range that each optical quantity can have, and ask about values in another unit.

A range is wide: sound but unusual optics, microscopes and telescopes, lie within it. Beyond it
stands what nobody builds, mostly a number in another unit than metres.
"""

from __future__ import annotations

from dataclasses import dataclass

_UNITS = {"nm": 1e-9, "µm": 1e-6, "mm": 1e-3}


@dataclass(frozen=True)
class QuantityRange:
    """The sizes that a quantity can have. Ranges are chosen."""

    least: float
    most: float
    unit: str = "m"  # or "" for a ratio
    usual: tuple[float, float] = (0.0, 0.0)  # by which a number in another unit is recognised
    units: tuple[str, ...] = ()  # others in which people give it
    example: str = ""  # what to give, for the message
    zero: bool = False  # whether it may be zero
    beyond: tuple[str, str] = ("", "")  # words for sizes below and above; the limits, if empty


RANGES = {
    # Optical radiation lies between X-rays and radio waves: extreme ultraviolet begins at 10 nm
    # (ISO 21348), and radio waves begin at about 1 mm (CIE S 017, 17-21-002).
    "wavelength": QuantityRange(
        1e-8,
        1e-3,
        usual=(1e-7, 2e-5),
        units=("nm", "µm"),
        example="550e-9 for green light",
        beyond=("shorter than ten nanometres", "longer than a millimetre"),
    ),
    # A laser's linewidth of 1 MHz is a femtometre.
    "bandwidth": QuantityRange(
        1e-15, 1e-3, usual=(1e-10, 1e-6), units=("nm",), example="10e-9 for 10 nm"
    ),
    "focal_length": QuantityRange(
        1e-6, 1e6, usual=(1e-3, 10.0), units=("mm",), example="0.05 for 50 mm"
    ),
    # A lens in air that obeys the sine condition has 0.5 at least; a paraxial one has no limit. A
    # stop may be closed as far as its square is a number.
    "f_number": QuantityRange(
        0.01, 1e120, unit="", example="focal length over the stop's diameter, 5.6"
    ),
    "panel_pitch": QuantityRange(
        1e-9, 1.0, usual=(5e-7, 1e-3), units=("µm", "nm"), example="8e-6 for 8 µm"
    ),
    "pixel_pitch": QuantityRange(
        1e-12, 1.0, usual=(5e-7, 1e-3), units=("µm", "nm"), example="3.45e-6 for 3.45 µm"
    ),
    "separation": QuantityRange(
        1e-12, 1e6, usual=(1e-3, 1.0), units=("mm",), example="0.05 for 50 mm", zero=True
    ),
    "aberration": QuantityRange(
        0.0, 0.01, usual=(1e-10, 1e-4), units=("nm", "µm"), example="55e-9 for 55 nm", zero=True
    ),
    "fill_factor": QuantityRange(1e-4, 1.0, unit="", example="share of a pixel's area, 0.87"),
    # On the sensor: points off the axis, and the middle of its pixels.
    "field": QuantityRange(
        0.0, 1e3, usual=(1e-6, 1.0), units=("mm", "µm"), example="2e-3 for 2 mm", zero=True
    ),
    "object_size": QuantityRange(
        1e-12, 1e15, usual=(1e-6, 10.0), units=("µm", "mm"), example="1e-3 for 1 mm"
    ),
    "object_distance": QuantityRange(0.0, 1e30, example="math.inf for an object at infinity"),
    # In free space all lengths may be scaled together: only what overflows is beyond.
    "travel": QuantityRange(1e-40, 1e40, example="0.3 for 300 mm"),
    "place": QuantityRange(0.0, 1e40, example="1e-3 for 1 mm", zero=True),
}


def ask_about_unit(quantity: str, value: float) -> str:
    """Return a question about a number that is usual in another unit, or "" for other numbers.

    A number that was converted twice, or by another unit, is asked about, too.
    """
    known = RANGES[quantity]
    low, high = known.usual
    for unit in known.units:
        if low <= abs(value * _UNITS[unit]) <= high:
            return f": did you mean {value:g} {unit}, {value * _UNITS[unit]:g}?"
    for wrong in (1e3, 1e6, 1e9):
        if low <= abs(value * wrong) <= high:
            return f": did you mean {value * wrong:g}?"
    return ""


def refuse_size(quantity: str, name: str, value: float) -> str:
    """Return the sentence that refuses a finite number beyond its quantity's range, or ""."""
    known, size = RANGES[quantity], abs(value)
    if known.least <= size <= known.most or (known.zero and size == 0):
        return ""
    unit = f" {known.unit}" if known.unit else ""
    is_above = size > known.most
    limit = known.most if is_above else known.least
    words = known.beyond[is_above] or f"{('less', 'more')[is_above]} than {limit:g}{unit}"
    metres = "metres, for instance " if known.unit else "the "
    return (
        f"{name} is {value:g}{unit}, {words}; give {metres}{known.example}"
        f"{ask_about_unit(quantity, value)}"
    )
