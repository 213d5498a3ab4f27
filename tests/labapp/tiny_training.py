"""Tasks that train in milliseconds, and a program that trains in processes that are ended.

`-m tiny_training train FOLDER STEPS` does what a command of `labapp train` does, and prints each
step's number when it begins; the state is FOLDER/state, the result of each process
FOLDER/resultRANK. `-m tiny_training FOLDER STEPS TIMES` forks processes that do so, because loading
torch in each would take seconds, ends them in all ways, and prints what happened.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import socket
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from labapp.files import state_file
from labapp.training.command import train_for_command
from labapp.training.processes import Processes, join_processes
from labapp.training.state import TrainingSchedule
from labapp.training.task import VALIDATION_STEP, sample_generator
from optics.progress import Cancelled

SEED = 3


class LineTask:
    """A line through random points, by least squares, in float64.

    broken: steps without a finite loss; steep: steps with a finite loss and no finite gradient.
    """

    samples = 5

    def __init__(self, broken: Collection[int] = (), steep: Collection[int] = ()) -> None:
        self.module = torch.nn.Linear(4, 1, dtype=torch.float64)
        torch.nn.init.constant_(self.module.weight, 0.5)
        torch.nn.init.constant_(self.module.bias, -0.25)
        self.broken, self.steep = broken, steep
        self.settings = {"trained": "line"}

    def parameter_groups(self):
        return [
            {"params": [self.module.weight], "rate": 1.0},
            {"params": [self.module.bias], "rate": 0.1},
        ]

    def losses(self, step: int, samples: Sequence[int]) -> torch.Tensor:
        places, heights = map(torch.from_numpy, points(step, samples))
        errors = (self.module(places)[:, 0] - heights) ** 2
        if step in self.broken:
            errors = errors / 0
        if step in self.steep:
            errors = errors + (0 * self.module.weight.sum()).abs().sqrt()
        return errors

    def validate(self) -> float:
        return float(self.module.weight.sum() + self.module.bias)


def points(step: int, samples: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Places (samples, 4) and heights (samples,) that LineTask learns from."""
    sources = [sample_generator(SEED, step, one) for one in samples]
    places = np.stack([one.standard_normal(4) for one in sources])
    return places, places @ [1.0, -2.0, 0.5, 3.0] + 1


class PictureTask:
    """Two convolutions that learn to smooth noise of 8x8, and remember the mean of what they gave.

    The memory is part of the loss, so that it must be kept when training is interrupted.
    """

    def __init__(self, processes: Processes | None = None, samples: int = 6) -> None:
        self.processes, self.samples = processes or Processes(), samples
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(SEED)
            self.module = torch.nn.Sequential(
                torch.nn.Conv2d(1, 4, 3, padding=1), torch.nn.ReLU(), torch.nn.Conv2d(4, 1, 3)
            )
        self.memory = torch.zeros(())
        self.settings = {"trained": "pictures", "samples": samples}

    def parameter_groups(self):
        return [{"params": list(self.module.parameters()), "rate": 1.0}]

    def losses(self, step: int, samples: Sequence[int]) -> torch.Tensor:
        seen = self._draw(step, samples)
        given = self.module(seen)
        errors = (given - torch.nn.functional.avg_pool2d(seen, 3, 1)).square().mean((1, 2, 3))
        errors = errors + 0.1 * (given.mean((1, 2, 3)) - self.memory) ** 2
        means = self.processes.gather(given.mean((1, 2, 3)))
        self.memory = 0.9 * self.memory + 0.1 * means.mean() + 0.01
        return errors

    def validate(self) -> float:
        seen = self._draw(VALIDATION_STEP, range(4))
        given = self.module(seen) - torch.nn.functional.avg_pool2d(seen, 3, 1)
        return float(-10 * given.square().mean().log10())

    def extra_state(self):
        return {"memory": self.memory}

    def load_extra_state(self, state):
        self.memory = state["memory"]

    def _draw(self, step: int, samples: Sequence[int]) -> torch.Tensor:
        drawn = [
            sample_generator(SEED, step, one).standard_normal((1, 8, 8), dtype=np.float32)
            for one in samples
        ]
        return torch.from_numpy(np.stack(drawn))


class SpokenTask(PictureTask):
    """Prints each step's number when it begins."""

    def losses(self, step: int, samples: Sequence[int]) -> torch.Tensor:
        print(step, flush=True)
        return super().losses(step, samples)


def schedule(steps: int) -> TrainingSchedule:
    """That of PictureTask."""
    return TrainingSchedule(steps, 1e-2, 1e-4, warm_up=3, validation_interval=15, seed=SEED)


PICTURES = schedule(40)

LINE = TrainingSchedule(
    30, 0.3, 0.01, warm_up=4, average_decay=0.6, validation_interval=12, seed=SEED
)


def same(a: Mapping[str, torch.Tensor], b: Mapping[str, torch.Tensor]) -> bool:
    """Whether weights are the same, bit for bit."""
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


def train(folder: Path, steps: int) -> int:
    """Do what a command of `labapp train` does, and return its exit code."""
    state_file.WRITE_INTERVAL = 0.0
    with join_processes("cpu") as processes:
        task = SpokenTask(processes)
        if not processes.is_writer:
            torch.nn.init.zeros_(task.module[0].weight)  # All start from the writer's weights.
        try:
            result = train_for_command(task, schedule(steps), folder / "state", processes)
        except Cancelled:
            return 130
        own = torch.tensor([float(one) for one in processes.own_samples(5)])
        kept = {
            "weights": result.weights,
            "history": result.history,
            "work": result.work,
            "memory": task.memory,
            "gathered": processes.gather(own),
            "wishes": (processes.agree(not processes.is_writer), processes.agree(False)),
        }
        torch.save(kept, folder / f"result{processes.rank}")
    return 0


class Child:
    """A forked process that trains; `numbers` gives those of its steps when they begin."""

    def __init__(
        self, folder: Path, steps: int, environment: Mapping[str, str] | None = None
    ) -> None:
        reading, writing = os.pipe()
        self.pid = os.fork()
        if not self.pid:
            code = 1
            try:
                os.environ.update(environment or {})
                os.dup2(writing, 1)
                code = train(folder, steps)
            finally:
                os._exit(code)
        os.close(writing)
        self._lines = os.fdopen(reading)
        self.numbers = (int(line) for line in self._lines if line.strip().isdigit())

    def end(self, number: int | None = None) -> int:
        """Send a signal, if any, wait for the end, and return the exit code as subprocess does."""
        if number is not None:
            os.kill(self.pid, number)
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


def kill_often(folder: Path, steps: int, times: int, seed: int) -> list[tuple[int, int, int]]:
    """Kill a training and go on with it, so many times, and let it end.

    Returns first and last step of each process, and its exit code.
    """
    rng = np.random.default_rng(seed)
    report = []
    for stop in np.sort(rng.choice(np.arange(3, steps - 20), times, replace=False)):
        child = Child(folder, steps)
        first = last = next(child.numbers)
        while last < stop:
            last = next(child.numbers)
        time.sleep(rng.uniform(0, 0.006))
        code = child.end(signal.SIGKILL)
        report.append((first, max([last, *child.numbers]), code))
    child = Child(folder, steps)
    numbers = list(child.numbers)
    return [*report, (numbers[0], numbers[-1], child.end())]


def send_signal(folder: Path, number: int) -> tuple[int, int]:
    """Send a signal to a training; the last step that it began, and its exit code."""
    folder.mkdir()
    child = Child(folder, 100000)
    while next(child.numbers) < 5:
        pass
    os.kill(child.pid, number)
    return max([5, *child.numbers]), child.end()


def train_in_two(folder: Path, steps: int) -> list[int]:
    """Train in two processes with the environment that torchrun sets; their exit codes."""
    folder.mkdir()
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
    common = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    children = [
        Child(folder, steps, {**common, "RANK": rank, "LOCAL_RANK": rank}) for rank in ("0", "1")
    ]
    return [child.end() for child in children]


def main(folder: Path, steps: int, times: int) -> None:
    """Train in processes of all kinds, and print what happened as JSON."""
    # Adam loads this when it is first used, which takes a second: now, and not in each process.
    importlib.import_module("torch._dynamo")

    report = {"killed": kill_often(folder, steps, times, seed=0)}
    if times < 10:
        report["signals"] = [
            send_signal(folder / number.name, number)
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        ]
        report["two"] = train_in_two(folder / "two", 40)
    print(json.dumps(report))


if __name__ == "__main__":
    if sys.argv[1] == "train":
        sys.exit(train(Path(sys.argv[2]), int(sys.argv[3])))
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
