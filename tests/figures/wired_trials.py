"""One kill of a process of a wired bench, and what it leaves at the wires."""

from __future__ import annotations

import json
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from judges.wired_state import unsafe_devices
from small_bench.files import write_small

from figures.startup import environment_of
from figures.window_kills import write_plans
from figures.wired_victim import MARK, WiredVictims, marked
from labapp.runs.record.reader import Record

_SAFE_WITHIN = 30.0
"""Seconds after the end of a run's application, within which all that it left must be safe."""

PLAN: dict[str, Any] = {
    "version": 1,
    "title": "To be killed",
    "patterns": {"neutral": {"kind": "constant"}, "lens": {"kind": "lens", "focal_length_m": 5}},
    "acquire": [
        {
            "targets": ["star"],
            "patterns": ["lens", "neutral"],
            "wavelengths_nm": [500, 600],
            "exposures_ms": [20, 150],
        }
    ],
}


@dataclass(frozen=True)
class Killed:
    """A run of which a process was killed at a state, and what it left.

    was_there: whether there was such a process to kill. end: the application's exit status.
    """

    whom: str
    state: str
    was_there: bool
    end: int
    unsafe: list[str]
    orphans: int
    lost: int

    @property
    def trouble(self) -> str:
        """What is wrong, in words; empty if nothing is."""
        told = [*self.unsafe, *([f"{self.orphans} orphans"] if self.orphans else [])]
        told += [f"{self.lost} frames lost"] if self.lost else []
        return f"{self.whom} killed at {self.state}: {', '.join(told)}" if told else ""


class Trials:
    """Runs of which a process is killed, one after the other. devices: options by role."""

    def __init__(
        self, victims: WiredVictims, folder: Path, devices: Mapping[str, Mapping[str, Any]]
    ) -> None:
        self._victims, self._folder, self._devices = victims, folder, devices
        self._count = 0

    def run(self, bench: Path, whom: str, call: int, delay: float) -> tuple[Killed, list[str]]:
        """One run; what became of it, and the calls of devices that it made. call: -1 for none."""
        self._count += 1
        place = self._folder / str(self._count)
        place.mkdir()
        mark = secrets.token_hex(8)
        files = {name: str(place / name) for name in ("path", "acknowledged", "events")}
        self._victims.begin_killed(
            bench=str(bench), plan=PLAN, mark=mark, whom=whom, call=call, delay=delay, **files
        )
        end = self._victims.end()
        left, unsafe = self._leavings(mark)
        events = Path(files["events"]).read_text().splitlines()
        calls = [one for one in events if one != "killed"]
        state = f"call {call} ({calls[call]}) + {delay:.2f} s" if 0 <= call < len(calls) else ""
        lost = _lost_frames(Path(files["path"]), Path(files["acknowledged"]))
        return Killed(whom, state, "killed" in events, end, unsafe, left, lost), calls

    def window(self, bench: Path, whom: str, moment: float, environment: dict[str, str]) -> Killed:
        """A window that asks for runs; it or its engine is killed some seconds after its start."""
        self._count += 1
        place = self._folder / str(self._count)
        (place / "runs").mkdir(parents=True)
        write_small(place)
        write_plans(place)
        (place / "bench.toml").write_text(bench.read_text())
        mark = secrets.token_hex(8)
        victim = Path(__file__).with_name("wired_window.py")
        process = subprocess.Popen(
            [sys.executable, "-P", str(victim), str(place), str(self._count)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment | environment_of(place) | {MARK: mark},
        )
        time.sleep(moment)
        killed = process.pid if whom == "window" else _engine(process.pid)
        if killed:
            os.kill(killed, signal.SIGKILL)
        if whom == "window":
            process.wait()
        left, unsafe = self._leavings(mark, *([] if whom == "window" else [process.pid]))
        process.kill()
        process.wait()
        state = f"{moment:.1f} s"
        return Killed(whom, state, bool(killed), 0, unsafe, left, _lost_in_window(place))

    def _leavings(self, mark: str, *stay: int) -> tuple[int, list[str]]:
        """How many processes of a run don't end, and what isn't safe at the wires."""
        late = time.monotonic() + _SAFE_WITHIN
        while (left := set(marked(mark)) - {*stay}) and time.monotonic() < late:
            time.sleep(0.05)
        while True:
            with suppress(OSError):
                unsafe = unsafe_devices(self._devices)
                if not unsafe or time.monotonic() > late:
                    return len(left), unsafe
            time.sleep(0.2)


def _engine(window: int) -> int:
    """The process of a window's engine; 0 if there is none yet."""
    children = Path(f"/proc/{window}/task/{window}/children").read_text().split()
    return int(children[0]) if children else 0


def _lost_in_window(place: Path) -> int:
    """How many frames records lack that a window had shown as stored."""
    journal, stored = place / "journal.jsonl", dict[str, int]()
    for line in journal.read_text().splitlines() if journal.exists() else []:
        told = json.loads(line)
        if "run" in told:
            stored[told["path"]] = max(stored.get(told["path"], 0), told["stored"])
    lost = 0
    for path, count in stored.items():
        if count:
            with Record(Path(path)) as record:
                lost += max(0, count - (record.frame_count - len(record.missing_frames())))
    return lost


def _lost_frames(path: Path, acknowledged: Path) -> int:
    """How many of the frames that were acknowledged a record lacks."""
    told = {int(line) for line in acknowledged.read_text().split()}
    if not told:
        return 0
    with Record(path) as record:
        return len(told & set(record.missing_frames()))
