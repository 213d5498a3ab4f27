"""A training of a pattern with its decoder that takes half a second, on the small bench.

`-m tiny_edof two FOLDER` trains in two processes, and `-m tiny_edof kill FOLDER TIMES` in processes
that are killed, and goes on; the folder holds what `write_files` writes. `-m tiny_edof gradients
FOLDER` computes gradients in two processes.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from small_bench.files import write_small
from tiny_training import same

import labapp.training.edof.command as command
from labapp.edof.design_problem import EdofProblem
from labapp.files import state_file
from labapp.files.bench_file import read_bench
from labapp.files.output_paths import trained_output_paths
from labapp.training.edof.captures import DrawnScene, MixedPictures, SceneSampler
from labapp.training.edof.config import EdofTrainingConfig, read_edof_config
from labapp.training.edof.decoder_task import DecoderTask
from labapp.training.edof.joint_task import JointTask, PatternWithDecoder
from labapp.training.edof.optics_table import OpticsTable, tabulate_optics
from labapp.training.edof.result import ShownScene, TrainedResult
from labapp.training.processes import Processes, join_processes
from labapp.training.scenes import Scene
from optics.edof.learned import DecoderNetwork

TABLES: dict[str, Any] = {
    "": {"version": 1, "near_dioptre": 0.9, "far_dioptre": 0.3, "bench": "bench/bench.toml"},
    "pattern": {"design_steps": 0},
    "scenes": {"spectrum": "natural"},
    "depths": {"count": 5},
    "decoder": {"channels": 2, "levels": 2},
    "training": {
        "side": 32,
        "samples": 4,
        "validation_interval": 3,
        "validation_scenes": 4,
        "warm_up": 2,
    },
    "joint": {"share": 0.5, "samples": 3, "parts": 3, "pattern_rate": 0.3, "first_rate": 1e-3},
}
"""Of a quarter of a pattern of 108 x 192 pixels, and 812 weights."""


def merge(changes: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The tables with some keys changed; keys that are None are left out."""
    names = {**TABLES, **changes}
    merged = {name: {**TABLES.get(name, {}), **changes.get(name, {})} for name in names}
    return {
        name: {key: value for key, value in table.items() if value is not None}
        for name, table in merged.items()
    }


def write_files(folder: Path, changes: Mapping[str, Mapping[str, Any]] | None = None) -> Path:
    """Write a configuration and the small bench, and return the configuration's path."""
    write_small(folder / "bench")
    lines: list[str] = []
    for name, table in merge(changes or {}).items():
        lines += [f"[{name}]"] if name else []
        lines += [f"{key} = {json.dumps(value)}" for key, value in table.items()]
    path = folder / "train.toml"
    path.write_text("\n".join(lines))
    return path


def make_config(changes: Mapping[str, Mapping[str, Any]] | None = None) -> EdofTrainingConfig:
    tables = merge(changes or {})
    return EdofTrainingConfig(**tables.pop(""), **tables)


@cache
def _bench_folder() -> TemporaryDirectory[str]:
    folder = TemporaryDirectory(prefix="tiny-edof-")
    write_small(Path(folder.name) / "bench")
    return folder


def bench_folder() -> Path:
    """A folder with the small bench, for all trainings of a process; it goes with the process."""
    return Path(_bench_folder().name)


def make_problem(config: EdofTrainingConfig) -> EdofProblem:
    asked = replace(config.design_request(bench_folder()), size=config.training.side)
    assert asked.bench is not None
    return EdofProblem(asked, read_bench(asked.bench).build_camera())


def make_sampler(config: EdofTrainingConfig) -> SceneSampler:
    return SceneSampler(MixedPictures(None, 0.0), config)


def make_network(config: EdofTrainingConfig) -> DecoderNetwork:
    """Random, also where training starts from zero."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(5)
        network = DecoderNetwork(config.decoder.settings(config.scenes.light))
        torch.nn.init.normal_(network.refining.tail.weight, std=0.05)
    return network


def start_of(problem: EdofProblem) -> torch.Tensor:
    return problem.parametrisation.fit(problem.start_phase())


def make_table(config: EdofTrainingConfig) -> OpticsTable:
    problem = make_problem(config)
    return tabulate_optics(problem, start_of(problem), config)


def make_decoder_task(config: EdofTrainingConfig) -> DecoderTask:
    network, sampler = make_network(config), make_sampler(config)
    return DecoderTask(network, make_table(config), sampler, config, {})


def make_joint_task(config: EdofTrainingConfig, processes: Processes | None = None) -> JointTask:
    problem = make_problem(config)
    module = PatternWithDecoder(make_network(config), start_of(problem))
    return JointTask(module, problem, make_sampler(config), config, processes or Processes(), {})


def plane(seed: int, layers: int = 1, noise: float = 0.03) -> DrawnScene:
    """A scene of random pixels, with random mattes if it has several layers."""
    rng = np.random.default_rng(seed)
    pictures = rng.random((layers, 16, 16), dtype=np.float32)
    mattes = np.ones((layers, 16, 16), np.float32)
    mattes[:-1] = rng.random((16, 16)) < 0.5
    depths = np.sort(rng.random(layers))[::-1]
    grain = rng.standard_normal((16, 16), dtype=np.float32)
    return DrawnScene(Scene(pictures, mattes), depths, noise, 0.0, grain)


def random_transfers(count: int, seed: int = 0) -> torch.Tensor:
    """Transfer functions of random PSFs of 16 x 16 pixels."""
    psfs = np.random.default_rng(seed).random((count, 16, 16)) ** 6
    psfs /= psfs.sum((1, 2), keepdims=True)
    return torch.from_numpy(np.fft.rfft2(psfs)).to(torch.complex64)


def train(
    folder: Path, steps: int | None = 8, minutes: float | None = None, device: str = "cpu"
) -> TrainedResult | None:
    """Do what `labapp train edof` does with a folder's configuration; None if it doesn't write."""
    written: list[TrainedResult] = []
    write = command.write_result

    def note(result: TrainedResult, scenes: list[ShownScene], files: list[Path]) -> None:
        written.append(result)
        write(result, scenes, files)

    path = folder / "train.toml"
    request = command.TrainingRequest(
        read_edof_config(path), folder, (), (), steps, minutes, device
    )
    command.write_result = note
    try:
        command.train_edof(request, trained_output_paths(folder / "a.h5", force=True))
    finally:
        command.write_result = write
    return written[0] if written else None


def check_same(result: TrainedResult, other: TrainedResult) -> None:
    """Weights and patterns are the same, bit for bit."""
    assert same(result.network.state_dict(), other.network.state_dict())
    assert torch.equal(result.phase, other.phase)


def step_gradients(processes: Processes) -> dict[str, list[torch.Tensor]]:
    """Gradients of two steps of both stages, over the samples of all processes."""
    config, found = make_config(), {}
    tasks = {"decoder": make_decoder_task(config), "joint": make_joint_task(config, processes)}
    for name, task in tasks.items():
        gradients = []
        for step in (0, 1):
            task.module.zero_grad()
            losses = task.losses(step, processes.own_samples(task.samples))
            (losses.sum() / task.samples).backward()
            processes.sum_gradients(task.module.parameters())
            gradients += [one.grad.clone() for one in task.module.parameters()]
        found[name] = [*gradients, processes.gather(losses)]
    return found


def fork(work: Callable[[], object]) -> int:
    """Do work in a forked process, and return its number."""
    process = os.fork()
    if not process:
        code = 1
        try:
            work()
            code = 0
        finally:
            os._exit(code)
    return process


def do_in_two(folder: Path, work: Callable[[Path], object]) -> list[int]:
    """Work in two processes with the environment that torchrun sets; their exit codes."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
    common = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}

    def begin(rank: str) -> None:
        os.environ.update({**common, "RANK": rank, "LOCAL_RANK": rank})
        work(folder)

    children = [fork(lambda rank=rank: begin(rank)) for rank in ("0", "1")]
    return [os.waitstatus_to_exitcode(os.waitpid(one, 0)[1]) for one in children]


def write_gradients(folder: Path) -> None:
    with join_processes("cpu") as processes:
        torch.save(step_gradients(processes), folder / f"gradients{processes.rank}")


def write_result(folder: Path, steps: int = 8) -> None:
    result = train(folder, steps)
    if result is not None:
        kept = {"weights": result.network.state_dict(), "phase": result.phase}
        torch.save(kept, folder / "result")


def kill_often(folder: Path, times: int) -> list[str]:
    """Kill a training again and again, until it ends; what was there when it was killed."""
    state_file.WRITE_INTERVAL = 0.0
    rng, seen = np.random.default_rng(1), []

    # On a busy machine, more goes that last longer: until one came to the joint stage.
    while len(seen) < times or (
        len(seen) < 4 * times and not any(".joint-state" in one for one in seen)
    ):
        child = fork(lambda: write_result(folder, 40))
        time.sleep(rng.uniform(0.05, 0.6) * max(1.0, len(seen) / times))
        os.kill(child, signal.SIGKILL)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        states = sorted(one.suffix for one in folder.glob("a.*-state"))
        seen.append(" ".join([str(code), *states]))
        if code == 0:
            (folder / "a.h5").unlink()
    child = fork(lambda: write_result(folder, 40))
    return [*seen, str(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))]


if __name__ == "__main__":
    where = Path(sys.argv[2])
    if sys.argv[1] == "gradients":
        print(json.dumps(do_in_two(where, write_gradients)))
    else:
        # Adam loads this when it is first used, which takes a second: now, and not in each process.
        importlib.import_module("torch._dynamo")
        both = sys.argv[1] == "two"
        done = do_in_two(where, write_result) if both else kill_often(where, int(sys.argv[3]))
        print(json.dumps(done))
