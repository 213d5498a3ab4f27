"""Numbers typed into the window, its prompts and the command line, in several languages."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from figures import Figure
from figures.startup import display, environment_of

_LOCALES = "de_DE", "fr_CH", "en_US", "ar_EG", "C"
_COUNT = 40
_SEED = 55


def typed_number_figures(folder: Path) -> list[Figure]:
    """What is set beside what was typed; the language is the desktop's and the process's."""
    with display() as environment:
        if environment is None:
            return [Figure("typed numbers", "0", "no display: apt-get install xvfb", None)]
        window, options, lists = ([], [], [])
        for seed, locale in enumerate(_LOCALES, _SEED):
            language = environment | environment_of(folder) | _variables(locale)
            there = folder / locale
            there.mkdir()
            window.append(_run("typed_fields.py", [locale, seed, _COUNT, there], language))
            first, second = _run("typed_options.py", [seed, _COUNT], language)
            options.append(first)
            lists.append(second)
    places = "fields of the window", "numbers of command line and prompts", "lists of numbers"
    return [_figure(*one) for one in zip(places, (window, options, lists), strict=True)]


def _variables(locale: str) -> dict[str, str]:
    language = locale if locale == "C" else f"{locale}.UTF-8"
    return {"LC_ALL": language, "LANG": language, "QT_LOGGING_RULES": "qt.text.font.db=false"}


def _run(script: str, words: list[Any], environment: dict[str, str]) -> Any:
    tests = str(Path(__file__).parents[1])
    paths = f"{tests}:{environment['PYTHONPATH']}"
    command = [sys.executable, "-P", str(Path(__file__).with_name(script)), *map(str, words)]
    variables = environment | {"PYTHONPATH": paths}
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=variables)
    return json.loads(done.stdout.splitlines()[-1])


def _figure(what: str, found: list[dict[str, Any]]) -> Figure:
    fates = sum((Counter(one["fates"]) for one in found), Counter[str]())
    bad = {name: fates[name] for name in fates if name not in ("set", "kept")}
    wrong = fates["set to something else"]
    said = ", ".join(f"{count} {name}" for name, count in sorted(fates.items()))
    examples = [f"{one[0]!r}: {one[-1]}" for run in found for one in run["wrong"]][:3]
    return Figure(
        f"{len(found)} locales x {_COUNT} texts x {found[0]['fields']} {what}: set to something "
        "else than typed; refused without a word; sound ones refused",
        "0; 0; 0",
        f"{wrong}; {fates['kept without a word']}; {fates['sound, but refused']} ({said})"
        + (f"; {examples}" if examples else ""),
        not bad,
    )


MEASUREMENTS = {"typed numbers": typed_number_figures}
