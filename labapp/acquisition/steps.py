"""What a plan asks for, frame by frame, and whether a bench can do it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from labapp.bench import Bench
from labapp.errors import UserError
from labapp.files.plan_file import Acquisition, PlanFile


@dataclass(frozen=True)
class Shot:
    """One planned frame. index: in the record. step: of the plan. repeat: within the step.

    wavelength: metres. exposure: seconds.
    """

    index: int
    step: int
    repeat: int
    target: str
    pattern: str
    wavelength: float
    exposure: float


def shots(plan: PlanFile) -> list[Shot]:
    """Every frame of a plan, in the order in which they are taken."""
    listed: list[Shot] = []
    step = 0
    for block in plan.acquire:
        for target, pattern, nm, ms in _settings(block):
            for repeat in range(block.repeats):
                wavelength, exposure = round(nm * 1e3) * 1e-12, round(ms * 1e6) * 1e-9
                shot = Shot(len(listed), step, repeat, target, pattern, wavelength, exposure)
                listed.append(shot)
            step += 1
    return listed


def _settings(block: Acquisition) -> list[tuple[str, str, float, float]]:
    """The slowest to change first: target, pattern, wavelength, exposure."""
    return list(product(block.targets, block.patterns, block.wavelengths_nm, block.exposures_ms))


def check(plan: PlanFile, bench: Bench, source: str) -> None:
    """UserError if the plan asks for what the bench can't do; names key, value and range."""
    low, high = bench.camera.exposure_range
    shortest, longest = bench.filter.wavelength_range
    for number, block in enumerate(plan.acquire):
        where = f"{source}: key 'acquire.{number}"
        for name in block.targets:
            if name not in bench.targets.names:
                raise UserError(
                    f"{where}.targets' names {name!r}, which this bench doesn't have. "
                    f"Choose among {', '.join(bench.targets.names)}."
                )
        for ms in block.exposures_ms:
            if not low <= ms * 1e-3 <= high:
                raise UserError(
                    f"{where}.exposures_ms' has {ms:g}, out of the camera's range. "
                    f"Choose {low * 1e3:g} to {high * 1e3:g} ms."
                )
        for nm in block.wavelengths_nm:
            if not shortest <= nm * 1e-9 <= longest:
                raise UserError(
                    f"{where}.wavelengths_nm' has {nm:g}, out of the filter's range. "
                    f"Choose {shortest * 1e9:.0f} to {longest * 1e9:.0f} nm."
                )


def expected_seconds(plan: PlanFile, bench: Bench) -> float:
    """Exposures and read-outs of a plan, in the bench's own time; settling comes on top."""
    return sum(shot.exposure + bench.camera.frame_time for shot in shots(plan))
