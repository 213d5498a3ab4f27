"""`labapp train edof`: design a pattern, train its decoder, train both together, and write them."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from labapp.common.console import out
from labapp.common.errors import UserError
from labapp.edof.design_problem import EdofProblem
from labapp.edof.design_search import DesignStateFile, search_pattern
from labapp.files.bench_file import read_bench
from labapp.files.state_file import StateFile
from labapp.training.command import count_steps, show_progress, train_for_command
from labapp.training.edof.captures import MixedPictures, SceneSampler
from labapp.training.edof.config import EdofTrainingConfig
from labapp.training.edof.decoder_task import DecoderTask, decoder_schedule
from labapp.training.edof.joint_task import JointTask, PatternWithDecoder, joint_schedule
from labapp.training.edof.optics_table import tabulate_optics
from labapp.training.edof.result import (
    TrainedResult,
    choose_scenes,
    print_result,
    write_result,
)
from labapp.training.edof.training_data import measure_spectrum, read_pictures
from labapp.training.processes import Processes, join_processes
from labapp.training.task import TrainingTask
from optics.edof.learned import DecoderNetwork
from optics.edof.pattern_rating import SearchState
from optics.slm import phase_to_grey
from optics.threads import single_threaded

DEFAULT_STEPS = 20000
"""Steps unless others or minutes are asked for. Chosen."""

_SHOWN_DEPTHS = 16
"""Depths of the scenes in the picture of the result. Chosen."""

_STEPS_AHEAD = 8
"""Steps of which scenes are drawn while a GPU trains. Chosen."""


@dataclass(frozen=True, eq=False)
class TrainingRequest:
    """What `labapp train edof` is asked for.

    folder: the folder that the configuration's paths are relative to.
    pictures: folders of photographs; none for drawn pictures alone.
    test_pictures: pictures, folders or fingerprints of what the result will be tested on.
    steps: in all.
    minutes: time of which the number of steps is made once, in the place of `steps`.
    device: "auto", "cpu" or "cuda".
    """

    config: EdofTrainingConfig
    folder: Path
    pictures: Sequence[Path]
    test_pictures: Sequence[Path]
    steps: int | None
    minutes: float | None
    device: str


@single_threaded
def train_edof(request: TrainingRequest, files: Sequence[Path]) -> None:
    """Train a pattern for depth of field with its decoder, and write both.

    Raises UserError if the configuration, the bench, the pictures, the device or a kept state can't
    be used, or there are more processes than scenes of a step.
    files: the design file (.h5), the pattern (.png), its picture with scores and decoded scenes
    (.png), and the list of the data (.json).
    """
    started = time.process_time()
    with join_processes(request.device) as processes:
        require_samples(request.config, processes)
        training = _EdofTraining(request, files, processes)
        training.run()
        if processes.is_writer:
            training.write(time.process_time() - started)


class _EdofTraining:
    """Trains a pattern with its decoder, stage by stage."""

    def __init__(
        self, request: TrainingRequest, files: Sequence[Path], processes: Processes
    ) -> None:
        config = request.config
        self._request, self._files, self._processes = request, files, processes
        with show_progress(processes) as progress:
            photographs, self._manifest = read_pictures(
                request.pictures, request.test_pictures, config, progress
            )
        self._digest = "drawn" if self._manifest is None else self._manifest.digest
        pictures = MixedPictures(photographs, config.scenes.procedural_share)
        ahead = _STEPS_AHEAD if processes.device.type == "cuda" else 0
        self._sampler = SceneSampler(pictures, config, ahead)
        asked = config.design_request(request.folder)
        assert asked.bench is not None
        self._bench = read_bench(asked.bench)
        self._spectrum = measure_spectrum(pictures, config)
        self._design_problem = EdofProblem(asked, self._bench.build_camera(), self._spectrum)
        scenes = replace(asked, size=config.training.side)
        self._problem = EdofProblem(scenes, self._design_problem.camera, self._spectrum)
        self._start = self._design_problem.start_phase()
        try:
            self._problem.transfer(config.wavelength)
            phase_to_grey(self._problem.camera.panel, self._start, config.wavelength, 1)
        except ValueError as error:
            raise UserError(
                f"train edof, bench {asked.bench}, wavelength_nm = {config.wavelength_nm:g}: "
                f"{error}."
            ) from error
        # All that the result depends on: files by their content, not by their name.
        self._settings = {
            **config.as_settings(),
            "data": self._digest,
            "bench checksum": _checksum(self._bench.model_dump_json().encode()),
            "start checksum": _checksum(self._start.numpy().tobytes()),
        }
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self._network = DecoderNetwork(config.decoder.settings(config.scenes.light))
        self._network.to(processes.device)
        self._account: dict[str, Any] = {}

    def run(self) -> None:
        """Design the pattern, train its decoder, and then both together."""
        config, processes = self._request.config, self._processes
        parameters = self._design()
        table = tabulate_optics(self._problem, parameters, config).to(processes.device)
        task = DecoderTask(self._network, table, self._sampler, config, self._settings)
        steps, joint = self._count_stages(task, parameters)
        settings = {**self._settings, "joint_steps": joint}
        task = DecoderTask(self._network, table, self._sampler, config, settings)
        if processes.is_writer:
            out.print(f"{steps} steps of the decoder, {joint} joint ones")
        schedule = decoder_schedule(config, steps)
        alone = train_for_command(task, schedule, self._state("decoder"), processes, steps=steps)
        self._network.load_state_dict(alone.weights)
        self._account |= {
            "decoder_steps": steps,
            "decoder_skipped": alone.skipped,
            "decoder_validation": alone.history[-1][1],
            "history": [list(one) for one in alone.history],
            "joint_steps": 0,
        }
        self._parameters = parameters
        if joint:
            self._train_jointly(joint)

    def write(self, cpu_seconds: float) -> None:
        """Write the pattern with its decoder, and print what was reached."""
        config = self._request.config
        self._account |= {
            "seed": config.seed,
            "processes": self._processes.count,
            "device": self._processes.device.type,
            "cpu_seconds": cpu_seconds,
            "data": self._digest,
        }
        result = TrainedResult(
            config,
            self._bench,
            self._problem,
            self._spectrum,
            self._problem.whole_phase(self._parameters).detach(),
            self._network,
            self._manifest,
            self._account,
        )
        # A few validation scenes, decoded behind the pattern, are in its picture.
        few = config.depths.model_copy(update={"count": _SHOWN_DEPTHS})
        config = config.model_copy(update={"depths": few})
        table = tabulate_optics(self._problem, self._parameters, config)
        table = table.to(self._processes.device)
        task = DecoderTask(self._network, table, self._sampler, config, self._settings)
        write_result(result, choose_scenes(task, self._sampler), self._files)
        for name in ("design", "decoder", "joint"):
            self._state(name).unlink(missing_ok=True)
        print_result(result, self._files)

    def _design(self) -> torch.Tensor:
        """Design the pattern without pictures, in the writing process, for all of them."""
        config, problem = self._request.config, self._design_problem
        start = problem.parametrisation.fit(self._start)
        steps = config.pattern.design_steps
        holder = torch.nn.Module()
        holder.register_buffer("pattern", start.detach().clone().double())
        if steps and self._processes.is_writer:
            out.print(f"{steps} steps of the pattern, without pictures")
            file = StateFile(self._state("design"), "design")
            kept = DesignStateFile(file, {**self._settings, "steps": steps})
            transfer = problem.transfer(problem.request.wavelengths[0])
            with show_progress(self._processes) as progress:
                state = kept.read() or SearchState()
                result = search_pattern(problem, transfer, start, steps, state, kept, progress)
            kept.write(state)
            holder.get_buffer("pattern").copy_(result.parameters)
        holder.to(self._processes.device)
        self._processes.share_weights(holder)
        shared: torch.Tensor = holder.get_buffer("pattern").cpu()
        return shared

    def _train_jointly(self, steps: int) -> None:
        """Train pattern and decoder together, and keep that only if validation improves."""
        task = self._joint_task(self._parameters)
        first = float(task.validate())
        schedule = joint_schedule(self._request.config, steps)
        kept = self._state("joint")
        decoder = {name: value.clone() for name, value in self._network.state_dict().items()}
        result = train_for_command(task, schedule, kept, self._processes, steps=steps)
        last = result.history[-1][1]
        self._account |= {
            "joint_steps": steps,
            "joint_skipped": result.skipped,
            "joint_validation": [first, last],
            "joint_accepted": last > first,
            "joint_history": [list(one) for one in result.history],
        }
        if last > first:
            task.module.load_state_dict(result.weights)
            self._parameters = task.module.pattern.detach().cpu().clone()
        else:
            self._network.load_state_dict(decoder)

    def _joint_task(self, parameters: torch.Tensor) -> JointTask:
        """Return the joint task of a pattern and the network as it is."""
        module = PatternWithDecoder(self._network, parameters).to(self._processes.device)
        config, processes = self._request.config, self._processes
        return JointTask(module, self._problem, self._sampler, config, processes, self._settings)

    def _count_stages(self, task: TrainingTask, parameters: torch.Tensor) -> tuple[int, int]:
        """Return the steps of the decoder alone, and of pattern and decoder together.

        They are those that are asked for, or those of a kept state.
        """
        request, config, processes = self._request, self._request.config, self._processes
        share, steps = config.joint.share, request.steps
        if steps is None:
            kept = StateFile(self._state("decoder"), "training").read_settings()
            if kept is not None:
                return int(kept["steps"]), int(kept.get("joint_steps", 0))
        if steps is not None or request.minutes is None:
            steps = DEFAULT_STEPS if steps is None else steps
            joint = round(steps * share)
            return max(steps - joint, 1), joint
        minutes = request.minutes
        alone = count_steps(task, decoder_schedule(config, 1000), minutes * (1 - share), processes)
        if not share:
            return alone, 0
        both = self._joint_task(parameters)
        return alone, count_steps(both, joint_schedule(config, 1000), minutes * share, processes)

    def _state(self, stage: str) -> Path:
        """Return the file that keeps the state of a stage."""
        return self._files[0].with_suffix(f".{stage}-state")


def _checksum(content: bytes) -> str:
    """Return a short checksum of what the result depends on, by which a change is noticed."""
    return hashlib.sha256(content).hexdigest()[:16]


def require_samples(config: EdofTrainingConfig, processes: Processes) -> None:
    """Raise UserError if a step has fewer scenes than there are processes."""
    tables = {"training": config.training.samples}
    if config.joint.share:
        tables["joint"] = config.joint.samples
    for name, samples in tables.items():
        if samples < processes.count:
            raise UserError(
                f"samples = {samples} in [{name}]: there are {processes.count} processes. Give as "
                "many scenes, or start fewer processes."
            )
