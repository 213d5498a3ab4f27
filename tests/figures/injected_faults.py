"""Faults at the n-th call of the system or message, of commands that write records and files."""

from __future__ import annotations

import itertools
import random
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from small_bench.files import TINY, write_tiny

from figures import Figure
from figures.fault_cases import Case, Finding, Workshop
from figures.faulty_calls import CAUSES, CUT, GONE, KINDS, MESSAGE, STUCK, Fault
from figures.faulty_command import FaultyCommands

_WHOLE = ("run", "resume")
"""Commands of which every call fails; of others every fifth does, and the last of each kind."""

_COARSE = 5

_RARE = 40
"""Every so many messages, their process stops whenever it's opened again."""

_IN_OWN_PROCESS = (
    'driver = "simulated-camera"',
    f'driver = "strange-camera"\noptions = {{ shape = {[*TINY.sensor]} }}\nown_process = true',
)
"""What a bench file says of its camera, and what it is to say."""


def injected_faults_figure(folder: Path) -> list[Figure]:
    """Each call of a small run fails, once and from then on; told, and nothing is lost."""
    figures = []
    with workshop_in(folder) as workshop:
        for case in workshop.cases():
            step = 1 if case.name in _WHOLE else _COARSE
            faults = [*faults_of(workshop, case, step)]
            figures.append(_figure(case, [workshop.judge(case, fault) for fault in faults]))
    return figures


@contextmanager
def workshop_in(folder: Path, *, own_process: bool = False) -> Iterator[Workshop]:
    """A folder for commands with faults. own_process: whether the bench's camera has one."""
    files = write_tiny(folder / "files")
    if own_process:
        files.bench.write_text(files.bench.read_text().replace(*_IN_OWN_PROCESS))
    with FaultyCommands() as commands:
        yield Workshop(folder, files, commands, patience=200.0 if own_process else 30.0)


def faults_of(workshop: Workshop, case: Case, step: int = 1) -> Iterator[Fault]:
    """The faults at every step-th call of each kind that a command makes, and at the last one."""
    for kind in KINDS:
        calls = workshop.run_once(case, Fault(kind, 0, 0, False)).calls
        numbers = {*range(1, calls + 1, step), *([calls] if calls else [])}
        for number, cause in itertools.product(sorted(numbers), CAUSES[kind]):
            yield from (Fault(kind, number, cause, lasting) for lasting in (False, True))


def message_faults_figure(folder: Path) -> list[Figure]:
    """Each message to and from the process of a run's camera fails, once and from then on."""
    with workshop_in(folder, own_process=True) as workshop:
        case = workshop.run_case
        calls = workshop.run_once(case, Fault(MESSAGE, 0, 0, False)).calls
        faults = [
            Fault(MESSAGE, number, cause, lasting)
            for number in range(1, calls + 1)
            for cause in (GONE, STUCK, CUT)
            for lasting in (False, True)
            # Each time that such a camera is opened again, half a minute is waited for it.
            if not (cause == STUCK and lasting and number % _RARE)
        ]
        return [_figure(case, [workshop.judge(case, fault) for fault in faults])]


def draw(faults: Iterable[Fault], count: int, seed: int) -> list[Fault]:
    """So many of the faults, by chance, but of each kind alike."""
    chance = random.Random(seed)
    kinds: dict[str, list[Fault]] = {}
    for fault in faults:
        kinds.setdefault(fault.kind, []).append(fault)
    for some in kinds.values():
        chance.shuffle(some)
    alike = itertools.chain.from_iterable(itertools.zip_longest(*kinds.values()))
    return [fault for fault in alike if fault is not None][:count]


def _figure(case: Case, found: list[Finding]) -> Figure:
    wrong = [one for one in found if one.wrong]
    counts = Counter(one.fault.kind for one in found)
    codes = Counter(one.ended.code for one in found)
    kinds = ", ".join(f"{number} {kind}" for kind, number in counts.items())
    ends = ", ".join(f"{number} with {code}" for code, number in codes.most_common())
    measured = f"{len(wrong)} of {len(found)} ({kinds}; ended {ends})"
    if wrong:
        measured += f"; first: {wrong[0].fault}: {wrong[0].wrong[:200]}"
    return Figure(
        f"{case.name}, a call fails: silent, hung, a traceback, a signal, false COMPLETE, lost "
        "frames, or no way on",
        "0",
        measured,
        not wrong,
    )


MEASUREMENTS = {
    "injected faults": injected_faults_figure,
    "message faults": message_faults_figure,
}
