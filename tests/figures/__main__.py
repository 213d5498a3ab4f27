"""Measure the figures and keep what was seen, as `make figures` does: `python -m figures`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.text import Text

from figures import Figure
from figures.measurements import MEASUREMENTS, ON_REQUEST, measurement
from figures.results import PAGE, RESULTS, Section, Stamp, quote, update
from labapp.common.console import out, print_json, print_message, print_table, styled_line
from labapp.common.threads import use_one_thread

_COLOURS = {True: "green", False: "red", None: "dim"}


def main() -> int:
    """Exit code 1 if a figure misses its goal, 2 if none has that name."""
    asked = _arguments()
    chosen = [name for name in MEASUREMENTS if is_asked(name, asked.only)]
    if not chosen:
        print_message(f"{' '.join(asked.only)}: no such figure. Choose {', '.join(MEASUREMENTS)}.")
        return 2
    use_one_thread()
    sections = list(_measured(chosen, keep=not asked.dry_run))
    if asked.json:
        print_json([asdict(section) for section in sections])
    else:
        _print(sections)
    return int(any(figure.met is False for one in sections for figure in one.figures))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="figures",
        description="Measure what labapp claims beside its goal, and write it into RESULTS.md. "
        "Measurements that aren't asked for keep what was seen of them, with its date. "
        "Measurements: "
        + ", ".join(MEASUREMENTS)
        + "; only where all words are given: "
        + ", ".join(ON_REQUEST)
        + ".",
    )
    parser.add_argument("only", nargs="*", help="names, or words in names; all without any")
    parser.add_argument("--json", action="store_true", help="print JSON, not a table")
    parser.add_argument("--dry-run", action="store_true", help=f"leave {RESULTS.name} as it is")
    return parser.parse_args()


def is_asked(name: str, only: list[str]) -> bool:
    """A whole name asks for that measurement alone, any other word for all that have it."""
    if name in ON_REQUEST:
        return name in only or set(name.split()) <= set(only)
    exact = [word for word in only if word in MEASUREMENTS]
    return not only or name in only or any(word in name for word in only if word not in exact)


def _measured(names: list[str], *, keep: bool) -> Iterator[Section]:
    """One after the other, each written as soon as it is there: a long run may be cut off."""
    for name in names:
        print_message(f"measuring: {name}")
        stamp = Stamp.now()
        with TemporaryDirectory(prefix="labapp-") as folder:
            section = Section(name, stamp, tuple(measurement(name)(Path(folder))))
        if keep:
            update(section)
            quote(PAGE)
        yield section


def _print(sections: list[Section]) -> None:
    found: list[Figure] = [figure for section in sections for figure in section.figures]
    rows = [[f.name, f.measured, f.goal, _verdict(f)] for f in found]
    print_table("Figures", ["figure", "measured", "goal", ""], rows)
    out.print(sections[-1].stamp.machine, style="dim")


def _verdict(figure: Figure) -> Text:
    colour = _COLOURS[figure.met]
    return styled_line((figure.verdict, colour))


if __name__ == "__main__":
    sys.exit(main())
