"""The command `labapp simulate`: write simulated frames of a scene to a file."""

from __future__ import annotations

import io
import json
from pathlib import Path

import h5py
import numpy as np
import tifffile
from numpy.typing import NDArray

from labapp.common.console import out, print_message, terminal_progress
from labapp.common.errors import UserError
from labapp.files.picture.photograph_writing import encode_png
from labapp.files.writing import write_atomically
from labapp.prediction.simulating.effect_explanation import describe_plan
from labapp.prediction.simulating.picture_request import PictureRequest, prepare_scene
from optics.progress import Progress
from simulator.imaging import PictureMoments
from simulator.planning import EffectPlan
from simulator.situation import Situation
from simulator.world import World

Frames = NDArray[np.uint16]


def simulate_frames(
    request: PictureRequest, path: Path, kind: str, *, frames: int, seed: int
) -> None:
    """Draw frames of a scene, and write their raw 16-bit digital numbers to a file.

    kind: of the file: png, tiff or h5.
    """
    if seed < 0:
        raise UserError(f"--seed {seed}: give 0 or more.")
    with terminal_progress() as progress, prepare_scene(request, progress.part(0.0, 0.3)) as staged:
        world, situation = staged.world, staged.situation
        progress.report(0.3, "deciding")
        plan = world.imaging.plan(situation)
        progress.report(0.35, "forming the picture")
        picture = world.imaging.picture_moments(situation, plan.recipe, progress.raise_if_cancelled)
        drawn = _sample_frames(world, situation, plan, frames, seed, progress.part(0.8, 1.0))
    decisions = describe_plan(situation, plan)
    if kind == "png":
        data = encode_png(path, drawn[0], in_srgb=False)
    elif kind == "tiff":
        page = io.BytesIO()
        metadata = {"effect_plan": decisions}
        tifffile.imwrite(page, drawn, photometric="minisblack", metadata=metadata)
        data = page.getvalue()
    else:
        data = _as_hdf5(drawn, picture, {"effect_plan": json.dumps(decisions), **staged.files})
    write_atomically(path, data)
    brightest = int(drawn.max())
    estimated = ", as estimated" if plan.decided_by == "estimate" else ""
    out.print(
        f"{frames} frame{'s' if frames > 1 else ''} of {drawn.shape[2]} x {drawn.shape[1]} pixels, "
        f"{situation.exposure * 1e3:.3g} ms, brightest number {brightest}; within "
        f"{plan.relative_error:.1e} of everything on{estimated}"
    )
    print_message(f"wrote {path}")


def _sample_frames(
    world: World, s: Situation, plan: EffectPlan, frames: int, seed: int, progress: Progress
) -> Frames:
    stream = world.imaging.stream(s, plan, progress.raise_if_cancelled)
    drawn = np.empty((frames, *s.camera.sensor.shape), dtype=np.uint16)
    for number in range(frames):
        progress.report(number / frames, f"frame {number + 1} of {frames}")
        world.begin_frame(seed, 0, number)
        drawn[number] = stream.frame(world.random_generator())
    return drawn


def _as_hdf5(frames: Frames, picture: PictureMoments, texts: dict[str, str]) -> bytes:
    """Return an HDF5 file of frames, with the distribution from which they were drawn.

    The distribution is the mean in electrons and the variance in electrons². The texts are effect
    plan, bench and scene as JSON.
    """
    held = io.BytesIO()
    with h5py.File(held, "w", locking=False) as file:
        file["frames"] = frames
        for name in ("electrons", "mean", "variance"):
            file[name] = getattr(picture, name).numpy()
        for name, text in texts.items():
            file[name] = text
    return held.getvalue()
