"""Text tables as spreadsheets, instruments and panels' makers write them, with what they hold."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from itertools import product

ENCODINGS = (
    "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-le", "utf-32-be",
    "latin-1", "cp1252", "mac_roman", "ascii",
)  # fmt: skip
UNTELLABLE = ("cp437", "cp1251", "shift_jis", "gbk", "koi8-r")
"""Encodings that a file doesn't show: numbers may be read, letters only if they are right."""

_ENDS = {"LF": "\n", "CRLF": "\r\n", "CR": "\r"}
_LAYOUTS = {
    "semicolons, comma": (";", ","),
    "semicolons, point": (";", "."),
    "tabs, comma": ("\t", ","),
    "tabs, point": ("\t", "."),
    "commas": (",", "."),
    "commas and blanks": (", ", "."),
    "blanks, comma": ("  ", ","),
    "blanks, point": (" ", "."),
}

_WORDS = {
    "latin-1": "gemessen für Höhe 3 µm, 20 °C",
    "mac_roman": "gemessen für Höhe",
    "ascii": "measured",
    "cp1251": "измерено",
    "koi8-r": "измерено",
    "shift_jis": "測定",
    "gbk": "测量",
    "cp437": "gemessen für Höhe",
}


@dataclass(frozen=True)
class TextTable:
    """A file, and the rows of numbers that it holds; None if it must be refused by name.

    words: of which one must be in a refusal. refusable: whether a refusal by these words is right.
    """

    name: str
    data: bytes
    rows: tuple[tuple[float, ...], ...] | None
    words: tuple[str, ...] = ()
    refusable: bool = False


def spectra_tables(seed: int) -> list[TextTable]:
    """A table of wavelengths and two columns in every encoding, layout and end of line."""
    rng = random.Random(seed)
    found = []
    for encoding, layout, end in product((*ENCODINGS, *UNTELLABLE), _LAYOUTS, _ENDS):
        separator, sign = _LAYOUTS[layout]
        rows = _rows(rng)
        words = _WORDS.get(encoding, _WORDS["latin-1"])
        heading = f"# {words}" if rng.random() < 0.5 else ""
        title = words.split()[0] if encoding in UNTELLABLE and not heading else "nm"
        body = [separator.join(_write(one, sign) for one in row) for row in rows]
        lines = [heading, separator.join([title, "a", "b"]), *body, ""]
        data = _ENDS[end].join(lines if heading else lines[1:]).encode(encoding)
        untold = encoding in UNTELLABLE and not heading
        found.append(
            TextTable(f"{encoding}, {layout}, {end}", data, rows, ("encoding",), refusable=untold)
        )
    return found


def _rows(rng: random.Random) -> tuple[tuple[float, ...], ...]:
    start, step = rng.randint(380, 450), rng.choice([1, 2.5, 10])
    return tuple(
        (start + k * step, round(rng.random(), 3), round(rng.random(), 4)) for k in range(8)
    )


def _write(number: float, sign: str) -> str:
    return f"{number:.6g}".replace(".", sign)


def vendor_tables(seed: int) -> list[TextTable]:
    """Look-up tables of panels: levels with phases in several units, or with voltages."""
    rng = random.Random(seed)
    slope = rng.uniform(1.6, 2.4) / 255
    levels = range(0, 256, 15)
    units = {
        "grey;532": 1.0,
        "Grey level;532 nm (rad)": math.pi,
        "Level;phase [°] 532 nm": 180.0,
        "gray value;532 nm [waves]": 0.5,
        "grey;phase (π rad) 532 nm": 1.0,
        "Index;532 nm": 1.0,
    }
    found = []
    for heading, factor in units.items():
        rows = tuple((level, slope * level) for level in levels)
        text = "\n".join([heading, *(f"{a};{_write(factor * b, ',')}" for a, b in rows)])
        found.append(TextTable(heading, text.encode(), rows))
    for heading in (
        "level;voltage", "Grey level;Voltage (V)", "Graustufe;Spannung / V", "level;U [V]",
        "grey;DAC", "Level;mV", "gray;Vrms", "index;drive voltage (V) 532 nm", "LUT in;volts",
    ):  # fmt: skip
        found.append(_refused(heading, levels, ("voltages", "must say 'grey'")))
    for heading in ("", "level;phase", "level;phase (rad)", "grey;phase 532 nm", "a;b", "x;532"):
        found.append(_refused(heading, levels, ("must say 'grey'",)))
    return found


def _refused(heading: str, levels: range, words: tuple[str, ...]) -> TextTable:
    body = [f"{level};{_write(level / 51, ',')}" for level in levels]
    lines = [heading, *body] if heading else body
    return TextTable(f"heading {heading!r}", "\n".join(lines).encode("cp1252"), None, words)


def broken_tables() -> list[TextTable]:
    """Tables whose numbers can't be told, and files that are no text."""
    texts = {
        "both signs": "nm;a\n400;1.234,5\n500;2",
        "points and commas": "nm;a\n400,5;1\n500.5;2",
        "groups": "nm;a\n400;1 234\n500;2",
        "apostrophes": "nm;a\n400;1'234\n500;2",
        "commas for both": "nm,a\n400,0,5\n500,0,6",
        "underscores": "nm;a\n400;1_0\n500;2",
        "micrometres": "nm;a\n0,4;1\n0,5;2",
        "unknown unit": "energy (eV);a\n2;1\n3;2",
        "logarithm": "nm;OD\n400;1\n500;2",
        "short line": "nm;a\n400;1\n500",
        "nan": "nm;a\n400;nan\n500;1",
    }
    found = [TextTable(name, text.encode(), None) for name, text in texts.items()]
    noise = random.Random(1).randbytes(4000)
    binary = {"noise": noise, "PNG": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + noise[:50]}
    return found + [
        TextTable(name, data, None, ("is not a text file",)) for name, data in binary.items()
    ]
