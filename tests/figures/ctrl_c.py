"""That Ctrl-C ends every command at any moment: 130, no traceback, nothing left running."""

from __future__ import annotations

import json
import os
import secrets
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from textwrap import indent

import numpy as np

from figures import Figure
from figures.where import ENVIRONMENT, ROOT
from labapp.common.console import print_message

_MOMENTS = 200

_LATEST = 5.0
"""Seconds after the command's first import, up to which Ctrl-C is pressed."""

_ENDS_WITHIN = 60.0
"""Seconds after which a command that goes on counts as one that Ctrl-C doesn't end."""

_MARK = "LABAPP_CTRL_C_TRIAL"
"""Environment variable by which the processes of a command are known."""

_ORPHANS_END_WITHIN = 15.0
"""Seconds that child processes have to make their devices safe; they are told to in 10."""

COMMANDS = {
    "run": "run coded-snapshot --out {folder}/run.h5 --json",
    "demo": "demo --out {folder}/demo",
    "serve": "virtual-bench serve --camera none",
    "psf": "psf --focal-length 0.1 --f-number 5.6 --distance 2 --tol 1e-6 --out {folder}/psf.npy",
    "retrieve": "retrieve letters text=EI --frames 8 --budget 3 --out {folder}/letters.h5 --json",
    "devices": "devices list --json",
    "plan check": "plan check psf-over-wavelengths",
    "explain": "explain --json",
}

_SCRIPT = """
import os, sys
def act():
{action}
class FirstImport:
    def find_spec(name, path=None, target=None):
        if name == "labapp.common":
            sys.meta_path.remove(FirstImport)
            act()
sys.meta_path.insert(0, FirstImport)
sys.argv[0] = "labapp"
from labapp.__main__ import main
try:
    main()
finally:
{at_end}
"""


@dataclass(frozen=True)
class Interrupted:
    """A command that Ctrl-C was pressed for. wrong: what isn't as it must, in words."""

    name: str
    moment: float
    wrong: str


def any_moment(folder: Path) -> list[Figure]:
    """Ctrl-C at 200 random moments of eight commands."""
    found = interrupt_often(folder, _MOMENTS)
    wrong = [one for one in found if one.wrong]
    measured = f"{len(found) - len(wrong)} of {len(found)} as they must be"
    if wrong:
        first = wrong[0]
        measured += f"; first trouble: {first.name} at {first.moment:.2f} s: {first.wrong}"
    return [
        Figure(
            f"Ctrl-C at {_MOMENTS} moments of eight commands, from the first import to 5 s",
            "130, no traceback, one JSON document with --json, nothing left running",
            measured,
            not wrong,
        )
    ]


def interrupt_often(
    folder: Path, moments: int, seed: int = 0, latest: float = _LATEST
) -> list[Interrupted]:
    """Press Ctrl-C at random moments; commands that had ended before aren't counted."""
    found: list[Interrupted] = []
    for number in range(10 * moments):
        if len(found) == moments:
            break
        rng = np.random.default_rng([seed, number])
        name = list(COMMANDS)[number % len(COMMANDS)]
        # Half of the moments lie where modules are imported.
        moment = float(rng.uniform(0, latest if rng.random() < 0.5 else 0.2 * latest))
        place = folder / str(number)
        place.mkdir()
        # An impatient person presses it twice.
        again = float(rng.exponential(0.3)) if rng.random() < 0.25 else None
        wrong = _interrupt(COMMANDS[name].format(folder=place).split(), moment, again)
        if wrong is not None:
            found.append(Interrupted(name, moment, wrong))
        if len(found) % 20 == 0:
            print_message(f"  {len(found)} of {moments} moments")
    return found


def command_with(action: str, at_end: str = "pass") -> list[str]:
    """Python and a script that runs labapp, and some lines of code within its first import.

    Before that, Python itself starts and looks for the command, and prints what it likes if it is
    interrupted. As the finder of modules runs the lines, they can't come too early. `at_end` runs
    when the command has ended, and Python only takes itself down.
    """
    lines = {"action": indent(action, "    "), "at_end": indent(at_end, "    ")}
    return [sys.executable, "-c", _SCRIPT.format(**lines)]


def _interrupt(words: list[str], moment: float, again: float | None) -> str | None:
    """Press Ctrl-C some seconds after a command's first import; what is wrong then.

    again: seconds after which it is pressed a second time. None if the command had ended before.
    """
    mark = secrets.token_hex(8)
    reading, told = os.pipe()
    ended = f"import time\nos.write({told}, str(time.monotonic()).encode())"
    process = subprocess.Popen(
        [*command_with(f"os.write({told}, b'x')", ended), *words],
        cwd=ROOT,
        env=ENVIRONMENT | {"PYTHONPATH": str(ROOT), _MARK: mark},
        pass_fds=[told],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    os.close(told)
    with open(reading, "rb", buffering=0) as times:
        times.read(1)
        time.sleep(moment)
        if process.poll() is not None:
            process.communicate()
            return None
        # A terminal sends the signal to all processes in its foreground.
        os.killpg(process.pid, signal.SIGINT)
        pressed = time.monotonic()
        if again is not None:
            time.sleep(again)
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGINT)
        try:
            printed, said = process.communicate(timeout=_ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return f"goes on for {_ENDS_WITHIN:g} s"
        # Python hears no signal while it takes itself down.
        if process.returncode == 0 and float(times.read(64) or "inf") <= pressed:
            return None
    return _wrong_end(process.returncode, printed, said, "--json" in words) or _left_running(mark)


def _wrong_end(status: int, printed: str, said: str, wants_json: bool) -> str:
    """What is wrong with a command's exit status and with what it printed."""
    code = status if status >= 0 else 128 - status
    if "Traceback" in said or "Exception ignored" in said:
        return f"traceback: {said[-2000:]}"
    if code != 128 + signal.SIGINT:
        return f"exit code {code}: {said[-500:]}"
    if wants_json:
        try:
            json.loads(printed)
        except ValueError:
            return f"no single JSON document: {printed[:200]!r}"
    return ""


def _left_running(mark: str) -> str:
    """Which processes of a command don't end, in words."""
    late = time.monotonic() + _ORPHANS_END_WITHIN
    while (left := _marked(mark)) and time.monotonic() < late:
        time.sleep(0.05)
    return f"left running: {', '.join(left)}" if left else ""


def _marked(mark: str) -> list[str]:
    """The commands of the living processes that have a mark in their environment."""
    found = []
    for entry in Path("/proc").iterdir():
        with suppress(OSError):
            if entry.name.isdigit() and mark.encode() in (entry / "environ").read_bytes():
                found.append((entry / "cmdline").read_text().replace("\0", " ")[:100])
    return found


MEASUREMENTS = {"ctrl-c": any_moment}
