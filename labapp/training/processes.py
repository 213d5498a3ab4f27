"""Compute in one process or in several that share the samples of each step."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import torch
from torch import distributed

from labapp.common.errors import UserError

DEVICES = ("auto", "cpu", "cuda")
"""What a person may ask to compute on."""


@dataclass(frozen=True)
class Processes:
    """All processes that share the samples of each step, as one of them sees them.

    Sample i of a step belongs to the process of rank i modulo `count`. All methods that exchange
    something must be called by all processes in the same order.
    rank: number of this process, from 0.
    count: number of processes.
    device: what this process computes on.
    """

    rank: int = 0
    count: int = 1
    device: torch.device = field(default_factory=lambda: torch.device("cpu"))

    @property
    def is_writer(self) -> bool:
        """Whether this process writes files and messages, for all of them."""
        return self.rank == 0

    def own_samples(self, samples: int) -> range:
        """Return the numbers of the samples that this process computes, of so many in all."""
        return range(self.rank, samples, self.count)

    def sum_gradients(self, parameters: Iterable[torch.nn.Parameter]) -> None:
        """Replace the gradient of each parameter by its sum over all processes.

        A parameter without a gradient gets one of zeros, whatever the number of processes.
        """
        given = [one for one in parameters if one.requires_grad]
        for one in given:
            if one.grad is None:
                one.grad = torch.zeros_like(one.detach())
        gradients = [one.grad for one in given if one.grad is not None]
        if self.count == 1 or not gradients:
            return
        # One exchange of all numbers takes less time than one for each parameter.
        kind = max((one.dtype for one in gradients), key=lambda dtype: dtype.itemsize)
        flat = torch.cat([one.reshape(-1).to(kind) for one in gradients])
        distributed.all_reduce(flat)
        parts = torch.split(flat, [one.numel() for one in gradients])
        for gradient, part in zip(gradients, parts, strict=True):
            gradient.copy_(part.view_as(gradient))

    def sum_number(self, number: float) -> float:
        """Return the sum of a number over all processes."""
        if self.count == 1:
            return number
        total = torch.tensor(number, dtype=torch.float64, device=self.device)
        distributed.all_reduce(total)
        return float(total)

    def agree(self, wish: bool) -> bool:
        """Return whether any process wishes something: the same in all of them."""
        return self.sum_number(float(wish)) > 0

    def take_from_writer(self, number: float) -> float:
        """Return the number that the writing process passes in."""
        return self.sum_number(number if self.is_writer else 0.0)

    def gather(self, values: torch.Tensor) -> torch.Tensor:
        """Return the values of all samples of a step, (samples, ...), in the order of the samples.

        They are the same in all processes; gradients don't pass.
        values: of this process' own samples, (own samples, ...).
        """
        own = values.detach()
        if self.count == 1:
            return own
        samples = round(self.sum_number(len(own)))
        most = -(-samples // self.count)
        padded = own.new_zeros((most, *own.shape[1:]))
        padded[: len(own)] = own
        parts = [torch.empty_like(padded) for _ in range(self.count)]
        distributed.all_gather(parts, padded)
        return torch.stack(parts, 1).flatten(0, 1)[:samples]

    def share_weights(self, module: torch.nn.Module) -> None:
        """Give the weights of the writing process to the modules of all processes."""
        if self.count > 1:
            for value in module.state_dict().values():
                distributed.broadcast(value, 0)


@contextmanager
def join_processes(device: str = "auto") -> Iterator[Processes]:
    """Join the processes that torchrun has started, or compute in this one alone.

    Their connection is closed when the block ends. Raises UserError if there is no such device.
    device: "auto" takes a GPU where there is one. Each process has its own GPU.
    """
    count = int(os.environ.get("WORLD_SIZE", "1"))
    local = int(os.environ.get("LOCAL_RANK", "0")) if count > 1 else 0
    found = _find_device(device, local)
    if count == 1:
        yield Processes(device=found)
        return
    if found.type == "cuda":
        torch.cuda.set_device(found)
    # Its functions keep the group of processes that there is when they are loaded, as optimizers
    # do later. A group that's kept outlives the block, and its threads end the program by a crash.
    importlib.import_module("torch.distributed.nn.functional")
    distributed.init_process_group("nccl" if found.type == "cuda" else "gloo")
    try:
        yield Processes(distributed.get_rank(), count, found)
    finally:
        distributed.destroy_process_group()


def _find_device(device: str, local_rank: int) -> torch.device:
    """Return the device that this process computes on; raise UserError if there is none."""
    if device not in DEVICES:
        raise UserError(f"--device {device}: is unknown. Choose {', '.join(DEVICES)}.")
    gpus = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if device == "cpu" or (device == "auto" and not gpus):
        return torch.device("cpu")
    if not gpus:
        raise UserError(f"--device {device}: torch finds no GPU here. Choose cpu, or leave it out.")
    if local_rank >= gpus:
        raise UserError(
            f"--device {device}: process {local_rank + 1} on this machine has no GPU of its own, "
            f"there are {gpus}. Start fewer with torchrun --nproc-per-node, or choose cpu."
        )
    return torch.device("cuda", local_rank)
