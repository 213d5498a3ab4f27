"""Run commands on crafted files, each in a child of one process that has loaded the program.

`python -m hostile.running FOLDER` makes the files in the folder, and prints an outcome a line.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import forked
from figures.own_memory import own_memory

SECONDS = 20.0
"""After so long a command hangs: the figure is 5 seconds of processor time."""

MOST_WRITTEN = 1 << 28
"""Bytes of a file that a command may write: a disk that is filled stops more than a test."""


@dataclass(frozen=True)
class Outcome:
    """What became of a command: seconds of processor time, and memory in bytes, beyond start-up.

    hung: whether it had to be ended, as it does when it opens the named pipe.
    """

    case: str
    file: str
    code: int
    said: str
    seconds: float
    memory: int
    hung: bool
    may_pass: bool

    @property
    def is_named(self) -> bool:
        """Whether the command ended with an error in words, or with what it may do."""
        if self.hung or "Traceback" in self.said or "unexpected " in self.said:
            return False
        is_told = self.file in self.said.replace("\n", "")
        return (self.code == 1 and is_told) or (self.may_pass and self.code == 0)


def run_crafted(folder: Path, part: int = 0, parts: int = 1) -> list[Outcome]:
    """Run every `parts`-th case from number `part` on, in a process of its own."""
    command = [sys.executable, "-m", "hostile.running", str(folder), str(part), str(parts)]
    paths = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    done = forked.run(command, stdout=forked.PIPE, text=True, check=True, env=environment)
    return [Outcome(**json.loads(line)) for line in done.stdout.splitlines()]


def _main(folder: Path, part: int, parts: int) -> None:
    from small_bench.files import write_tiny

    from hostile.cases import crafted_cases
    from labapp.common.memory import give_back_freed_memory

    write_tiny(folder)
    _prepare(folder)
    # Memory that the program keeps would hide what a command takes.
    give_back_freed_memory()
    for case in list(crafted_cases(folder))[part::parts]:
        print(json.dumps(asdict(_run(case, folder))), flush=True)


def _prepare(folder: Path) -> None:
    """Write a record, a design and a PSF, which also loads what the commands need."""
    import numpy as np

    np.save(folder / "psf.npy", np.ones((5, 5), np.float32))
    bench = ["--bench", folder / "bench.toml"]
    pattern = ["pattern", "cubic", "strength_rad=20", *bench, "--out", folder / "design.h5"]
    _call(["run", folder / "plan.toml", *bench, "--scene", folder / "scene.toml",
           "--out", folder / "run.h5", "--force"])  # fmt: skip
    _call([*pattern, "--force"])
    psf = ["--psf", folder / "psf.npy", "--out", folder / "out.png", "--force"]
    _call(["reconstruct", folder / "picture.png", *psf, "--budget", "0.5"])


def _call(arguments: Sequence[Any]) -> None:
    code = _command(tuple(map(str, arguments)), os.devnull)
    assert code == 0, f"{arguments}: {code}"


def _command(arguments: Sequence[str], output: str) -> int:
    """Run a command in this process with its output in a file; give its exit code."""
    from labapp.cli import main

    kept = [os.dup(1), os.dup(2)]
    with open(output, "w") as file:
        sys.stdout.flush()
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
        sys.argv = ["labapp", *arguments]
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        finally:
            sys.stdout.flush()
            for stream, saved in zip((1, 2), kept, strict=True):
                os.dup2(saved, stream)
    return code


def _run(case: Any, folder: Path) -> Outcome:
    """Run a case in a fork of this process, and end it when it takes too long."""
    said, grown = folder / "said", folder / "grown"
    for one in (said, grown):
        one.write_text("")
    child = os.fork()
    if child == 0:
        os.setsid()
        code = 99
        try:
            code = _run_limited(case.arguments, said, grown)
        finally:
            os._exit(code)
    status, used, hung = _wait(child)
    text = said.read_text(errors="replace")
    seconds, memory = used.ru_utime + used.ru_stime, int(grown.read_text() or 0)
    code = os.waitstatus_to_exitcode(status)
    return Outcome(case.name, case.file, code, text[-3000:], seconds, memory, hung, case.may_pass)


def _run_limited(arguments: tuple[str, ...], said: Path, grown: Path) -> int:
    """Run a command with limits in this fork, and note how many bytes it grew by at most."""
    resource.setrlimit(resource.RLIMIT_CPU, (int(SECONDS), int(SECONDS) + 1))
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_WRITTEN, MOST_WRITTEN))
    # The highest amount of memory is counted anew.
    Path("/proc/self/clear_refs").write_text("5")
    before = own_memory("VmRSS")
    code = _command(arguments, str(said))
    grown.write_text(str(max(own_memory("VmHWM") - before, 0)))
    return code


def _wait(child: int) -> tuple[int, resource.struct_rusage, bool]:
    """Wait for a child: its status, what it used, and whether it had to be ended."""
    begun = time.monotonic()
    while time.monotonic() - begun < SECONDS:
        found, status, used = os.wait4(child, os.WNOHANG)
        if found:
            return status, used, status == signal.SIGXCPU
        time.sleep(0.005)
    os.killpg(child, signal.SIGKILL)
    _, status, used = os.wait4(child, 0)
    return status, used, True


if __name__ == "__main__":
    _main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
