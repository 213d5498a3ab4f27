"""Describe the memory that a computation may use, and the speed of the machine."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class MachineSpeed:
    """State the machine's speed: seconds of basic operations, on one thread, in float32.

    The defaults were measured on a 2-core server. Pass your own values where you know them.

    Parameters
    ----------
    call : float, optional
        Overhead of any function call, whatever its size.
    multiply_add : float, optional
        One multiplication and addition in a product of matrices.
    fft : float, optional
        A floating-point operation of an FFT.
    touch : float, optional
        Passing over a complex number once.
    fresh : float, optional
        Allocating one byte of memory beyond what caches and allocators retain.
    gridding : float, optional
        Spreading a sample to one point of a regular grid, row by row.
    spread : float, optional
        Spreading a scattered sample to one point of a regular grid.
    point : float, optional
        Fixed cost of a scattered sample, in addition to `spread`.
    stream : float, optional
        Using an element of a matrix once.
    gather : float, optional
        Fetching one value from an arbitrary address.
    tap : float, optional
        Adding a fine sample's share to a pixel.
    double : float, optional
        Factor by which double precision is slower.
    """

    call: float = 5e-4
    multiply_add: float = 2e-11
    fft: float = 7.3e-11
    touch: float = 2e-10
    fresh: float = 2.5e-10
    gridding: float = 3.4e-10
    spread: float = 5e-10
    point: float = 2.1e-8
    stream: float = 1.6e-9
    gather: float = 1.1e-8
    tap: float = 3.8e-10
    double: float = 2.0


@dataclass(frozen=True)
class Budget:
    """State a computation's budget: the memory that it may use, and the machine's speed.

    Parameters
    ----------
    memory : int, optional
        Bytes; 4 GiB by default.
    speed : MachineSpeed, optional
        The machine's speed.
    """

    memory: int = 4 << 30
    speed: MachineSpeed = field(default_factory=MachineSpeed)
