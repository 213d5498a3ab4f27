"""A camera's noise as labapp calibrate --camera measures it, against what was put in.

The virtual bench is photographed by the ready plan. Other cameras are drawn by numpy's generator:
with fixed patterns and defects, of eight bits, and before lamps that drift, flicker and are uneven.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from judges.camera_frames import Lamp, TrueCamera, take_frames

from figures import Figure
from labapp.bench.opening import BenchFiles, open_bench
from labapp.calibration.camera.recorded_frames import read_pairs
from labapp.files.plan_file import read_plan
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from optics.measuring import CameraNoise, Measured, characterise_camera
from optics.threads import single_threaded

_SEEDS = 20
_GOALS = {"gain": 0.01, "read noise": 0.02, "saturation": 0.01}
_CHI2 = (0.7, 1.4)
_PULLS = (0.8, 1.2)
"""Root mean square error over stated uncertainty. Quantities of a run share most of their errors:
of 140 runs, chance makes .88 to 1.12 (2 σ)."""

_SHAPE = (320, 320)
_PLAIN = TrueCamera(shape=_SHAPE)
_SPOTS = replace(
    _PLAIN,
    prnu=0.012,
    dsnu=2.0,
    hot=tuple((7 * n % 320, 31 * n % 320) for n in range(1, 60)),
    dead=tuple((11 * n % 320, 5 + 17 * n % 300) for n in range(1, 12)),
)
_COARSE = replace(_PLAIN, bits=8, gain=45.0, black=4.0, prnu=0.005)
_CASES = {
    "PRNU 1.2 %, DSNU 2 e-, 70 defects": (_SPOTS, Lamp()),
    "8 bits, noise a nineteenth of a step": (_COARSE, Lamp()),
    "8 bits, noise a third of a step": (replace(_COARSE, read_noise=15.0, dsnu=10.0), Lamp()),
    "a full well below the converter's end": (replace(_SPOTS, well=8000.0), Lamp()),
    "a lamp that drifts by 5 %": (_SPOTS, Lamp(drift=0.05)),
    "a lamp that flickers by 2 %, half of the light in the corners": (
        _SPOTS, Lamp(flicker=0.02, shade=0.5),
    ),
}  # fmt: skip


@dataclass
class Tally:
    """Relative errors by quantity, errors over stated uncertainties, and reduced chi-squares."""

    errors: dict[str, list[float]] = field(default_factory=dict)
    pulls: list[float] = field(default_factory=list)
    chi2: list[float] = field(default_factory=list)

    def add(self, found: CameraNoise, gain: float, read_noise: float, full: float) -> None:
        """A read noise that is a limit only, is no measurement of it."""
        pairs: list[tuple[str, Measured | None, float]] = [
            ("gain", found.gain, gain),
            ("saturation", found.full_well, full),
        ]
        if not found.read_noise_is_limit:
            pairs.insert(1, ("read noise", found.read_noise, read_noise))
        for name, one, true in pairs:
            assert one is not None
            self.errors.setdefault(name, []).append(one.value / true - 1)
            self.pulls.append((one.value - true) / one.sigma)
        self.chi2.append(found.transfer.chi2)

    @property
    def words(self) -> str:
        worst = ", ".join(f"{name} {max(map(abs, seen)):.2%}" for name, seen in self.errors.items())
        return f"worst {worst}; χ² {min(self.chi2):.2f} to {max(self.chi2):.2f}"

    @property
    def met(self) -> bool:
        return (
            all(max(map(abs, seen)) <= _GOALS[name] for name, seen in self.errors.items())
            and _CHI2[0] <= min(self.chi2)
            and max(self.chi2) <= _CHI2[1]
        )


_GOAL_WORDS = "gain 1 %, read noise 2 %, saturation 1 %; reduced χ² .7 to 1.4"


@single_threaded
def camera_noise_figures(folder: Path) -> list[Figure]:
    """Twenty seeds each."""
    bench = _bench_tally(folder)
    rows = [
        Figure(
            f"photon transfer on the virtual bench, {_SEEDS} seeds", _GOAL_WORDS, bench.words,
            bench.met,
        )
    ]  # fmt: skip
    pulls = list(bench.pulls)
    listed = []
    for name, (camera, lamp) in _CASES.items():
        tally = Tally()
        for found in _measured(camera, lamp):
            tally.add(found, camera.gain, camera.read_noise, camera.full)
            if camera.hot:
                listed.append(_are_listed(found, camera))
        rows.append(
            Figure(f"photon transfer, {name}, {_SEEDS} seeds", _GOAL_WORDS, tally.words, tally.met)
        )
        pulls += tally.pulls
    spread = float(np.sqrt(np.mean(np.square(pulls))))
    return [
        *rows,
        Figure(
            "photon transfer, error over stated uncertainty, rms",
            f"{_PULLS[0]:g} to {_PULLS[1]:g}",
            f"{spread:.2f} of {len(pulls)}",
            _PULLS[0] <= spread <= _PULLS[1],
        ),
        Figure(
            "hot and dead pixels, listed exactly",
            "all runs",
            f"{sum(listed)} of {len(listed)} runs",
            all(listed),
        ),
    ]


def _bench_tally(folder: Path) -> Tally:
    """The bundled bench by the ready plan; pixels are full at the converter's end."""
    tally = Tally()
    plan = read_plan(Path("photon-transfer")).plan
    for seed in range(1, _SEEDS + 1):
        path = folder / f"{seed}.h5"
        with open_bench(BenchFiles.with_defaults()) as bench:
            sensor = bench.description.sensor
            run_plan(bench, plan.model_copy(update={"seed": seed}), path)
        with Record(path) as record:
            found = characterise_camera(read_pairs(record).frames)
        path.unlink()
        top = (2**sensor.bits - 1 - sensor.black_level) * sensor.gain
        tally.add(found, sensor.gain, sensor.read_noise, min(top, sensor.full_well))
    return tally


def _measured(camera: TrueCamera, lamp: Lamp) -> Iterator[CameraNoise]:
    for seed in range(_SEEDS):
        yield characterise_camera(take_frames(camera, 1000 + seed, lamp=lamp))


def _are_listed(found: CameraNoise, camera: TrueCamera) -> bool:
    """Whether each hot or dead pixel is listed as what it is, and no other."""
    lists = (found.defects.hot, set(camera.hot)), (found.defects.dead, set(camera.dead))
    exact = all({tuple(one) for one in seen.tolist()} == true for seen, true in lists)
    return exact and len(found.defects.every) == len(set(camera.hot) | set(camera.dead))


MEASUREMENTS = {"camera-noise": camera_noise_figures}
