"""Refuse configurations that can't be trained for, before anything is computed."""

from __future__ import annotations

import torch

from labapp.common.errors import UserError
from labapp.edof.design_problem import EdofProblem
from labapp.training.edof.config import EdofTrainingConfig
from labapp.training.processes import Processes
from optics.slm import phase_to_grey


def require_usable(problem: EdofProblem, phase: torch.Tensor, config: EdofTrainingConfig) -> None:
    """Raise UserError if a bench can't be trained for.

    problem: the optics in training.
    phase: the pattern before training, (rows, columns), radians.
    """
    try:
        problem.transfer(config.wavelength)
        phase_to_grey(problem.camera.panel, phase, config.wavelength, 1)
    except ValueError as error:
        raise UserError(
            f"train edof, bench {problem.request.bench}, wavelength_nm = "
            f"{config.wavelength_nm:g}: {error}."
        ) from error


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
