"""The command behind `make mutants MODULE=optics/plane.py`."""

from __future__ import annotations

import argparse
import os
import random
import sys
import time
from pathlib import Path

from mutants.changes import Mutant, mutants
from mutants.related import related
from mutants.report import as_json, line, summary
from mutants.running import Bench, TestFile, Verdict

ROOT = Path(__file__).resolve().parents[2]

TEACHES = """\
  make mutants MODULE=optics/plane.py
  make mutants MODULE="optics/plane.py --count 0 --lines 30-52"
  make mutants MODULE="optics/plane.py optics/beam.py --seed 2 --json plane.json"

A line of the table is one small bug that was put into the module:

    31  operator       SURVIVED  noise + step → noise - step        4 files of tests
    32  constant       killed    12 → 13                            test_effects.py::test_steps

Of a bug that survived: is the module still right with it (a tolerance, a faster way to the same
value)? Then it's no bug. Would a user see it? Then write the test that fails, and run this again
with the same seed. "no test" means that no test comes to that line at all.

Related tests are found by their imports, nearest first, and run for as long as --seconds allow,
no file for more than a third of it; a bug that survives may still be seen by a test further away.
"""


def main() -> None:
    asked = _arguments()
    # One thread each: the tests are small, and the other cores may have work of their own.
    os.environ["OMP_NUM_THREADS"] = "1"
    sys.dont_write_bytecode = True
    found = [
        (place, one) for module in asked.modules for place in [_place(module, asked.root)]
        for one in _verdicts(place, asked)
    ]  # fmt: skip
    if asked.json:
        asked.json.write_text(as_json(asked.root, found))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="mutants",
        description="Put small bugs into a module, and see which of them its tests notice.",
        epilog=TEACHES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("modules", nargs="+", metavar="MODULE", help="a file of the product: optics/plane.py")
    add("--count", type=int, default=20, help="bugs a module, chosen by --seed; 0: all (20)")
    add("--seed", type=int, default=0, help="the same seed chooses the same bugs (0)")
    add("--lines", default="", metavar="FROM-TO", help="only bugs in these lines")
    add("--seconds", type=float, default=60, help="of related tests without a bug (60)")
    add("--tests", nargs="+", type=Path, default=[], help="these files, instead of related ones")
    add("--json", type=Path, help="write what became of each into this file")
    add("--root", type=Path, default=ROOT, help=argparse.SUPPRESS)
    return parser.parse_args()


def _place(module: str, root: Path) -> Path:
    place = Path(module) if Path(module).is_absolute() else root / module
    if not place.is_file() or place.suffix != ".py":
        raise SystemExit(f"{module} is no module; name a file, such as optics/plane.py")
    return place


def _verdicts(module: Path, asked: argparse.Namespace) -> list[Verdict]:
    chosen = choose(mutants(module.read_text()), asked.count, asked.seed, asked.lines)
    bench = Bench(asked.root, module)
    tests = [one.resolve() for one in asked.tests] or related(asked.root, module)
    files = _timed(bench, tests, asked.seconds)
    print(f"{module.relative_to(asked.root)}: {len(chosen)} bugs, {_told(files)}", flush=True)
    found = []
    for mutant in chosen:
        found.append(bench.verdict(mutant, files))
        print(line(found[-1]), flush=True)
    print(summary(found), flush=True)
    return found


def choose(every: list[Mutant], count: int, seed: int, lines: str = "") -> list[Mutant]:
    """So many mutants by chance, no second one of a statement before each has had one."""
    if lines:
        first, _, last = lines.partition("-")
        every = [one for one in every if int(first) <= one.line <= int(last or first)]
    mixed = list(every)
    random.Random(seed).shuffle(mixed)
    turns: dict[int, int] = {}
    turn = []
    for one in mixed:
        turns[one.line] = turns.get(one.line, 0) + 1
        turn.append(turns[one.line])
    order = sorted(range(len(mixed)), key=turn.__getitem__)
    chosen = [mixed[at] for at in order[: count or None]]
    return sorted(chosen, key=every.index)


def _timed(bench: Bench, tests: list[Path], seconds: float) -> list[TestFile]:
    """As many of the tests as there's time for; no file takes all of it from the others."""
    files: list[TestFile] = []
    began = time.monotonic()
    for test in tests:
        spent = sum(one.seconds for one in files)
        if spent > seconds or time.monotonic() - began > 3 * seconds:
            break
        file = bench.without_a_mutant(test, seconds / 3)
        if file.useful:
            files.append(file)
    return files


def _told(files: list[TestFile]) -> str:
    seconds = sum(one.seconds for one in files)
    failed = [name for one in files for name in one.failed]
    also = f"; left out, as they fail without a bug: {', '.join(failed)}" if failed else ""
    return f"{len(files)} files of tests that take {seconds:.0f} s{also}"


if __name__ == "__main__":
    main()
