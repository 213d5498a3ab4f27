"""`labapp simulate`: pictures of a scene, as files."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import tifffile
from numpy.typing import NDArray

from labapp.common.console import out, say, watched
from labapp.common.errors import UserError
from labapp.files.writing import encoded, write_whole
from labapp.light.simulating.asked import AskedPicture, stage
from labapp.light.simulating.explaining import told
from optics.progress import Progress
from simulator.imaging import Picture
from simulator.planning import EffectPlan
from simulator.situation import Situation
from simulator.world import World

Frames = NDArray[np.uint16]


def simulate(asked: AskedPicture, path: Path, kind: str, *, frames: int, seed: int) -> None:
    """Write frames of a scene: raw digital numbers, 16 bits. kind: of the file, as in _WRITERS."""
    if seed < 0:
        raise UserError(f"--seed {seed}: give 0 or more.")
    with watched() as progress, stage(asked, progress.part(0.0, 0.3)) as staged:
        world, situation = staged.world, staged.situation
        progress.report(0.3, "deciding")
        plan = world.imaging.plan(situation)
        progress.report(0.35, "forming the picture")
        picture = world.imaging.picture(situation, plan.recipe, progress.check)
        drawn = _drawn(world, situation, plan, frames, seed, progress.part(0.8, 1.0))
    write = _WRITERS[kind]
    write(path, drawn, picture, {"effect_plan": json.dumps(told(situation, plan)), **staged.files})
    brightest = int(drawn.max())
    out.print(
        f"{frames} frame{'s' if frames > 1 else ''} of {drawn.shape[2]} x {drawn.shape[1]} pixels, "
        f"{situation.exposure * 1e3:.3g} ms, brightest number {brightest}; within "
        f"{plan.error:.1e} of everything on"
    )
    say(f"wrote {path}")


def _drawn(
    world: World, s: Situation, plan: EffectPlan, frames: int, seed: int, progress: Progress
) -> Frames:
    stream = world.imaging.stream(s, plan, progress.check)
    drawn = np.empty((frames, *s.camera.sensor.shape), dtype=np.uint16)
    for number in range(frames):
        progress.report(number / frames, f"frame {number + 1} of {frames}")
        world.begin(seed, 0, number)
        drawn[number] = stream.frame(world.chance())
    return drawn


def _write_png(path: Path, frames: Frames, picture: Picture, said: dict[str, str]) -> None:
    write_whole(path, encoded(path, frames[0]))


def _write_tiff(path: Path, frames: Frames, picture: Picture, said: dict[str, str]) -> None:
    page = io.BytesIO()
    plan = {"effect_plan": json.loads(said["effect_plan"])}
    tifffile.imwrite(page, frames, photometric="minisblack", metadata=plan)
    write_whole(path, page.getvalue())


def _write_hdf5(path: Path, frames: Frames, picture: Picture, said: dict[str, str]) -> None:
    """With the mean picture and the variance that the frames are drawn from, in electrons and
    electrons², and JSON of what was decided, of the bench and of the scene."""
    held = io.BytesIO()
    with h5py.File(held, "w") as file:
        file["frames"] = frames
        for name in ("electrons", "mean", "variance"):
            file[name] = getattr(picture, name).numpy()
        for name, text in said.items():
            file[name] = text
    write_whole(path, held.getvalue())


_WRITERS: dict[str, Callable[[Path, Frames, Picture, dict[str, str]], None]] = {
    "png": _write_png,
    "tiff": _write_tiff,
    "h5": _write_hdf5,
}
