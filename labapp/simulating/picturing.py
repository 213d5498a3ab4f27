"""`labapp simulate`: pictures of a scene, as files."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import cv2
import h5py
import numpy as np
import tifffile
from numpy.typing import NDArray

from labapp.console import out, say, watched
from labapp.errors import UserError
from labapp.files.writing import require_writable, write_whole
from labapp.simulating.asked import AskedPicture, stage
from labapp.simulating.explaining import told
from optics.progress import Progress
from simulator.imaging import Picture
from simulator.planning import EffectPlan
from simulator.situation import Situation
from simulator.world import World

Frames = NDArray[np.uint16]


def simulate(asked: AskedPicture, path: Path, *, frames: int, seed: int, force: bool) -> None:
    """Write frames of a scene: raw digital numbers, 16 bits.

    UserError for an ending that isn't .h5, .tiff or .png, or more than one frame in a .png.
    """
    write = _writer(path, frames)
    if seed < 0:
        raise UserError(f"--seed {seed}: give 0 or more.")
    require_writable(path, force=force)
    with watched() as progress, stage(asked, progress.part(0.0, 0.3)) as staged:
        world, situation = staged.world, staged.situation
        progress.report(0.3, "deciding")
        plan = world.imaging.plan(situation)
        progress.report(0.35, "forming the picture")
        picture = world.imaging.picture(situation, plan.recipe, progress.check)
        drawn = _drawn(world, situation, plan, frames, seed, progress.part(0.8, 1.0))
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


def _writer(path: Path, frames: int) -> Callable[[Path, Frames, Picture, dict[str, str]], None]:
    if frames < 1:
        raise UserError(f"--frames {frames}: ask for one at least.")
    ending = path.suffix.lower()
    if ending == ".png":
        if frames > 1:
            raise UserError(f"--out {path}: a .png holds one frame; take .h5 or .tiff for more.")
        return _write_png
    if ending in (".tif", ".tiff"):
        return _write_tiff
    if ending in (".h5", ".hdf5"):
        return _write_hdf5
    raise UserError(f"--out {path}: the ending says the kind; choose .h5, .tiff or .png.")


def _write_png(path: Path, frames: Frames, picture: Picture, said: dict[str, str]) -> None:
    done, data = cv2.imencode(".png", frames[0])
    assert done
    write_whole(path, data.tobytes())


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
