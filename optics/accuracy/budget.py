"""What a computation may use, and how fast the machine is that computes it."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class MachineSpeed:
    """The seconds that basic operations take on the machine at hand, one thread, float32.

    The defaults were measured on a 2-core server. Pass your own where you know them.

    Parameters
    ----------
    call : float, optional
        Any function call, whatever its size.
    multiply_add : float, optional
        One multiplication and addition in a product of matrices.
    fft : float, optional
        A floating-point operation of an FFT.
    touch : float, optional
        Passing over a complex number once.
    fresh : float, optional
        A byte of memory beyond what caches and allocators retain.
    gridding : float, optional
        Spreading a sample to one point of a regular grid, row by row.
    spread : float, optional
        Spreading a scattered sample to one point of a regular grid.
    point : float, optional
        What a scattered sample costs besides.
    stream : float, optional
        Using an element of a matrix once.
    gather : float, optional
        Fetching a value from a place of its own.
    tap : float, optional
        Adding a fine sample's part to a whole pixel.
    double : float, optional
        How many times longer double precision takes.
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
    """What a computation may use: memory, on a machine of a given speed.

    Parameters
    ----------
    memory : int, optional
        Bytes; 4 GiB by default.
    speed : MachineSpeed, optional
        The machine's speed.
    """

    memory: int = 4 << 30
    speed: MachineSpeed = field(default_factory=MachineSpeed)
