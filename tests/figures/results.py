"""What was seen of every figure, kept as a page that the measuring itself writes.

A section a measurement: when, on which machine, from which commit, and a table of its figures.
Measuring one replaces its section and leaves the others as they are.
"""

from __future__ import annotations

import datetime
import re
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from figures import Figure
from figures.measurements import MEASUREMENTS
from labapp.accuracy.row_output import describe_machine
from labapp.files.writing import write_atomically

RESULTS = Path(__file__).with_name("RESULTS.md")
PAGE = Path(__file__).parents[2] / "labapp/docs/figures.md"
"""Of the guide; it quotes some rows of the results."""

_HEAD = """# What was seen of every figure

Written by `make figures`, which measures each figure on the machine at hand beside its goal;
`make figures ONLY=psf` measures a part and leaves the rest with its own date. Nothing here is
typed. Misses are in bold.
"""
_TABLE = ("| figure | goal | seen | |", "| --- | --- | --- | --- |")
_QUOTED = re.compile(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)
"""A row of a page that quotes some: figure, goal, seen."""

_UNKNOWN = "Not measured yet: "


@dataclass(frozen=True)
class Stamp:
    """When, from which commit, on which machine."""

    date: str
    commit: str
    machine: str

    @staticmethod
    def now() -> Stamp:
        return Stamp(datetime.date.today().isoformat(), _commit(), describe_machine())

    def __str__(self) -> str:
        return f"{self.date}, {self.commit}, {self.machine}"


@dataclass(frozen=True)
class Section:
    """One measurement's figures."""

    name: str
    stamp: Stamp
    figures: tuple[Figure, ...]

    def __str__(self) -> str:
        lines = [f"## {self.name}", "", str(self.stamp), "", *_TABLE]
        for figure in self.figures:
            cells = (
                _cell(figure.name),
                _cell(figure.goal),
                _seen(figure),
                _emphasise(figure, figure.verdict),
            )
            lines.append("| " + " | ".join(cells) + " |")
        return "\n".join([*lines, ""])


def update(section: Section, path: Path = RESULTS) -> None:
    """Put a section in its place, and leave all others as they are."""
    sections = read_sections(path)
    sections[section.name] = str(section)
    write_atomically(path, _page(sections, list(MEASUREMENTS)).encode())


def read_sections(path: Path = RESULTS) -> dict[str, str]:
    """The page's sections by name, as they stand; none if there is no page."""
    if not path.exists():
        return {}
    parts = re.split(r"^(?=## )", path.read_text(), flags=re.MULTILINE)[1:]
    parts = [part.split(_UNKNOWN)[0].rstrip() + "\n" for part in parts]
    return {part.splitlines()[0].removeprefix("## "): part for part in parts}


def quote(path: Path, results: Path = RESULTS) -> None:
    """Bring the rows that another page quotes up to what was seen; their names choose them."""
    seen = seen_rows(results)

    def newer(row: re.Match[str]) -> str:
        name, goal, before = (cell.strip() for cell in row.groups())
        return f"| {name} | {goal} | {seen.get(name, before)} |"

    text = path.read_text()
    changed = _QUOTED.sub(newer, text)
    if changed != text:
        write_atomically(path, changed.encode())


def quoted_rows(path: Path) -> dict[str, str]:
    """What another page says was seen of each figure, by the figure's name."""
    rows = (row.groups() for row in _QUOTED.finditer(path.read_text()))
    return {name: seen for name, _, seen in rows if name != "figure" and set(name) != {"-"}}


def seen_rows(path: Path = RESULTS) -> dict[str, str]:
    """What was seen of each figure, by the figure's name."""
    rows = re.findall(r"^\| (.+?) \| .+? \| (.+?) \| .* \|$", path.read_text(), re.MULTILINE)
    return {name: seen for name, seen in rows if name != "figure" and not name.startswith("---")}


def _page(sections: dict[str, str], known: Sequence[str]) -> str:
    there = [sections[name] for name in known if name in sections]
    missing = [name for name in known if name not in sections]
    last = [f"{_UNKNOWN}{', '.join(missing)}.\n"] if missing else []
    return "\n".join([_HEAD, *there, *last])


def _seen(figure: Figure) -> str:
    return _emphasise(figure, _cell(figure.measured))


def _emphasise(figure: Figure, words: str) -> str:
    return f"**{words}**" if figure.met is False else words


def _cell(words: str) -> str:
    """A bar would begin another cell."""
    return " ".join(words.split()).replace("|", "/")


def _commit() -> str:
    """The checkout's commit, and whether files differ from it."""
    where = Path(__file__).parent

    def git(*words: str) -> str:
        command = ["git", "-C", str(where), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        number = git("rev-parse", "--short=10", "HEAD")
        changed = git("status", "--porcelain", "--", ":(top,exclude)*RESULTS.md")
    except (OSError, subprocess.CalledProcessError):
        return "no commit"
    return f"commit {number}" + (" with changes" if changed else "")
