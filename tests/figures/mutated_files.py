"""Mutated text files through their loaders and the check commands; commands with little memory."""

from __future__ import annotations

import os
import re
import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hostile.mutated_files import MutatedFile, mutated_files, mutations, write_whole_files
from hostile.running import _command
from hostile.watched_tries import DIED, HUNG, Watch, allow_seconds, watched

from figures import Figure
from labapp.common.errors import UserError

_SEEDS, _COUNT = (1, 2, 3), 5000

_SECONDS = 10.0
"""Processor time of reading a file, and of each command, after which it hangs."""

_BAD = re.compile(r"unexpected \w+|Traceback|[Ww]arning: |an error of its own")
"""What a person must never read."""


def mutated_files_figure(folder: Path) -> list[Figure]:
    """Three seeds of mutated files, each with its kind's loader and commands."""
    return [_seed_figure(folder, seed) for seed in _SEEDS]


def _seed_figure(folder: Path, seed: int) -> Figure:
    fates = Counter[str]()
    examples = []
    for name, content, found in try_mutations(folder / str(seed), seed, _COUNT):
        fates[found.split(":")[0]] += 1
        if is_bad(found):
            examples.append((name, content, found))
    bad = sum(count for name, count in fates.items() if is_bad(name))
    said = ", ".join(f"{count} {name}" for name, count in sorted(fates.items()))
    first = f"; {examples[0][0]}: {examples[0][2][:200]}" if examples else ""
    return Figure(
        f"{_COUNT} mutated text files, seed {seed}: unexpected, tracebacks, hung or killed",
        "0",
        f"{bad} ({said}){first}",
        not bad,
    )


def is_bad(found: str) -> bool:
    return found.startswith((HUNG, DIED, "unexpected"))


def try_mutations(folder: Path, seed: int, count: int) -> Any:
    """Yield name, content and fate of each: "refused", "checked", or what went wrong."""
    texts, kinds = write_whole_files(folder), mutated_files()
    drawn = list(mutations(texts, seed, count))
    prepare(folder, kinds)

    def attempt(one: tuple[str, bytes]) -> str:
        name, content = one
        (folder / name).write_bytes(content)
        try:
            return _try(kinds[name], folder)
        finally:
            (folder / name).write_text(texts[name])

    for (name, content), found in watched(drawn, attempt, Watch()):
        if is_bad(found):
            (folder / name).write_text(texts[name])
        yield name, content, found


def prepare(folder: Path, kinds: Mapping[str, MutatedFile]) -> None:
    """Run each command on the whole files, which loads what it needs before forks do."""
    os.environ["COLUMNS"] = "400"
    for one in kinds.values():
        one.load(folder / one.name)
        for command in one.commands:
            code, said = run_command(command, folder)
            assert code == 0, f"{command}: {said}"
            assert not _BAD.search(said), f"{command}: {said}"


def run_command(command: Any, folder: Path) -> tuple[int, str]:
    """Exit code of a command in this process, and the end of what it printed."""
    said = folder / "said"
    code = _command(tuple(word.format(folder=folder) for word in command), str(said))
    return code, said.read_text(errors="replace")[-5000:]


def _try(one: MutatedFile, folder: Path) -> str:
    allow_seconds(_SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            one.load(folder / one.name)
    except UserError:
        return "refused"
    except Exception as error:
        return f"unexpected: loader: {type(error).__name__}: {error}"[:600]
    for command in one.commands:
        allow_seconds(_SECONDS)
        code, said = run_command(command, folder)
        if code not in (0, 1) or _BAD.search(said):
            return f"unexpected: {' '.join(command[:2])} ({code}): {said[-500:]}"
    return "checked"


MEASUREMENTS = {"mutated files": mutated_files_figure}
