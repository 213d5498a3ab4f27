"""What a computation may use, and how fast the machine is that computes it."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class MachineSpeed:
    """Seconds per operation on the machine at hand, one thread, float32.

    call: of any function called, whatever its size. multiply_add: in a product of matrices.
    fft: a floating-point operation of one. touch: a complex number passed once; fresh: a byte
    taken beyond what caches and allocators keep. gridding: a sample spread to one point of a
    regular grid, row by row; spread: a scattered one, and point: what it costs besides.
    stream: a matrix' element used once. gather: a value fetched from a place of its own. tap:
    a fine sample's part in a whole pixel. double: how much longer double precision takes.

    The defaults come from a 2-core server; who knows better passes its own.
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
    """What a computation may use: memory in bytes, and the machine's speed."""

    memory: int = 4 << 30
    speed: MachineSpeed = field(default_factory=MachineSpeed)
