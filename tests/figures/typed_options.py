"""`python typed_options.py SEED COUNT`: what the command line makes of texts.

It prints one JSON line: the options, and the texts by how they were taken.
"""

from __future__ import annotations

import json
import locale
import math
import random
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from decimal import Decimal
from types import SimpleNamespace
from typing import Any, cast, get_args

from judges.typed_texts import Field, draw_texts, fate

Take = Callable[[str], float]
"""What a place makes of a text; it raises an error in words for one that it refuses."""

_WIDE = Decimal("1e6")
_ENDLESS = ("--speed", "--focus", "--distance")
"""Options whose help says that inf is allowed."""

_UNITS = {"_um": "µm", "_m": "m", "_s": "s"}
"""Units that may follow a number, of those that are tried as wrong ones."""

_REFUSED = -1234567.0
"""Stands for the number that a place had before: it has none."""


def command_line_places() -> Iterator[tuple[str, Field, Take]]:
    """Every option and argument that is a number, found without labapp's help."""
    from labapp.cli import build_command_line

    for words, command, one in _parameters(build_command_line(), ()):
        kind = one.type_descriptor.annotation
        kinds = get_args(kind) or (kind,)
        if kinds[0] not in (int, float):
            continue
        context = command.context_class(command, info_name=command.name)

        def take(text: str, one: Any = one, context: Any = context) -> float:
            several = one.multiple or one.nargs != 1
            found = one.process_value(context, (text,) if several else text)
            return float(found[0] if several else found)

        yield " ".join((*words, one.opts[0])), _field(one, whole=kinds[0] is int), take


def _parameters(command: Any, words: tuple[str, ...]) -> Iterator[tuple[Any, ...]]:
    for one in command.params:
        yield words, command, one
    for name, part in getattr(command, "commands", {}).items():
        yield from _parameters(part, (*words, name))


def _field(one: Any, *, whole: bool) -> Field:
    low, high = (Decimal(str(limit)) if limit is not None else None for limit in (one.min, one.max))
    if "wavelength" in one.name:
        low, high = Decimal(200), Decimal(2000)
    unit = next((unit for end, unit in _UNITS.items() if one.name.endswith(end)), "")
    return Field(-_WIDE if low is None else low, high or _WIDE, 0 if whole else None, unit)


def prompt_places() -> Iterator[tuple[str, Field, Take]]:
    """The seconds of a fault, typed to a served bench; and single numbers within lists."""
    from labapp.bench.virtual_bench.command_interpreter import CommandInterpreter
    from labapp.prediction.lens_options import read_centre, read_field, read_panel, read_stop
    from labapp.refining.refinement_request import parse_milliseconds

    given: list[float] = []
    instrument = SimpleNamespace(fault_kinds=("mute",), inject_fault=_injector(given))
    prompt = CommandInterpreter(cast(Any, None), [], {"filter": cast(Any, instrument)})

    def seconds(text: str) -> float:
        given.clear()
        prompt.execute(f"fault filter mute {text}")
        return given[0]

    positive = Field(Decimal("0.001"), _WIDE, None)
    yield "fault SECONDS", positive, seconds
    yield "--exposures-ms", positive, lambda text: _only(parse_milliseconds(text), text)
    any_ = Field(-_WIDE, _WIDE, None)
    yield "--centre 0;X", any_, lambda text: read_centre(f"0;{text}")[1] * 1e6
    yield "--field 0;X", any_, lambda text: read_field(f"0;{text}")[1] * 1e3
    pitch = Field(Decimal("0.001"), _WIDE, None, "µm")
    yield "--panel 8x8xUM", pitch, lambda text: read_panel(f"8x8x{text}")[1] * 1e6
    share = Field(Decimal("0.001"), Decimal("0.9"), None)
    yield "--rectangle", share, lambda text: float(_width(read_stop(0, 0.0, f"0.1x{text}")))


def list_places() -> Iterator[tuple[str, Field, int, Callable[[str], Sequence[float]]]]:
    """Options that take lists, how many numbers each, and what they make of a text."""
    from labapp.cli.brackets import _read_range
    from labapp.pictures.merging.exposure_words import parse_exposures
    from labapp.prediction.lens_options import read_aberrations, read_centre
    from labapp.refining.refinement_request import parse_milliseconds
    from labapp.spectral.band_list import parse_bands

    positive = Field(Decimal("0.001"), _WIDE, 3)
    yield "--electrons", positive, 2, lambda text: _read_range(text) or []
    yield "--exposures-ms", positive, 3, parse_milliseconds
    yield "--exposures", positive, 3, parse_exposures
    yield "--centre", positive, 2, lambda text: [1e6 * one for one in read_centre(text)]
    bands = Field(Decimal(400), Decimal(700), 2)
    yield "--bands", bands, 3, lambda text: [1e9 * one for one in parse_bands(text) or ()]
    orders = Field(Decimal(2), Decimal(9), 0)
    yield (
        "--zernike",
        orders,
        3,
        lambda text: [
            one * unit for one, unit in zip(read_aberrations([text])[0], (1, 1, 1e9), strict=True)
        ],
    )


def judge_lists(rng: random.Random, count: int) -> dict[str, Any]:
    """Lists as their options describe them, with decimal points or commas where they may stand."""
    fates, wrong = Counter[str](), []
    for name, field, size, take in list_places():
        for _ in range(count):
            numbers = sorted({field.draw(rng) for _ in range(20)})[-size:]
            separator, sign = rng.choice(
                [(",", "."), (", ", "."), (";", "."), (";", ","), ("; ", ",")]
            )
            text = separator.join(f"{one:f}".replace(".", sign) for one in numbers)
            found = "sound, but refused"
            with suppress(Exception):
                taken = list(take(text))
                same = len(taken) == size and all(map(_is_close, taken, numbers))
                found = "set" if same else "set to something else"
            fates[found] += 1
            if found != "set":
                wrong.append((f"{name} {text}", "list", 0.0, found))
    return {"fields": 6, "fates": fates, "wrong": wrong[:20]}


def _is_close(one: float, other: Decimal) -> bool:
    return math.isclose(one, other, rel_tol=1e-12)


def _injector(given: list[float]) -> Callable[[str, float], None]:
    def inject(kind: str, seconds: float) -> None:
        if kind != "mute":
            raise ValueError(f"there is no fault {kind!r}")
        given.append(seconds if math.isfinite(seconds) else _REFUSED)

    return inject


def _only(numbers: list[float], text: str) -> float:
    """The one number of a list, or what it was before: two commas and more only separate."""
    if len(numbers) > 1 and text.count(",") == len(numbers) - 1 > 1:
        raise ValueError("a list, as its option says")
    return numbers[0] if len(numbers) == 1 else math.nan


def _width(stop: Any) -> float:
    corners = stop.opening.corners
    return (max(x for _, x in corners) - min(x for _, x in corners)) / 2


def judge_places(rng: random.Random, count: int) -> dict[str, Any]:
    fates, wrong, places = Counter[str](), [], 0
    for name, field, take in [*command_line_places(), *prompt_places()]:
        places += 1
        for typed in draw_texts(field, rng, count):
            if typed.text.endswith("inf") and name.endswith(_ENDLESS):
                continue
            if name.startswith("fault") and not typed.text.strip():
                continue  # Without seconds, a fault is for good.
            after, told = _REFUSED, False
            try:
                after = take(typed.text)
            except Exception as error:
                told = len(str(error)) > 10
            if typed.number is not None and math.isclose(after, typed.number, rel_tol=1e-12):
                after = float(typed.number)
            found = fate(typed, _REFUSED, after, told)
            if name == "--exposures-ms" and "," in typed.text and found == "sound, but refused":
                # It may be two numbers: the refusal says how to type either.
                found = "kept" if told else found
            fates[found] += 1
            if found not in ("set", "kept"):
                wrong.append((f"{name} {typed.text}", typed.rule, after, found))
    return {"fields": places, "fates": fates, "wrong": wrong[:20]}


def main(arguments: list[str]) -> None:
    # Where the language isn't installed, the process has that of C.
    with suppress(locale.Error):
        locale.setlocale(locale.LC_ALL, "")
    seed, count = map(int, arguments)
    rng = random.Random(seed)
    found = judge_places(rng, count), judge_lists(rng, count)
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
