"""What decoding a photograph behind the packaged pattern costs, and that tiles have no seams."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import partial
from pathlib import Path

import torch

from figures import Figure
from figures.own_memory import own_memory
from figures.stopwatch import processor_seconds
from figures.where import ENVIRONMENT, ROOT
from labapp.edof.decoding import PhotographDecoder, build_decoder
from labapp.edof.trained_pattern import bundled_trained_pattern, read_trained_pattern
from optics.threads import single_threaded

_NOISE = 0.008

_SMALL, _LARGE = (512, 512), (3000, 4096)
"""Rows and columns of what is decoded: a part of a photograph, and one of 12 megapixels."""

_TIME_GOALS = {_SMALL: 0.15, _LARGE: 8.0}
"""Processor seconds, the filter before the network included."""

_REPEATS = {_SMALL: 9, _LARGE: 3}

_MEMORY_GOAL = 2e9
"""Bytes beside what libraries hold: photograph, filter and decoder are in it."""

_CROP, _TILE = (1228, 1630), 512
"""Pixels of a crop of 2 megapixels, and of the tiles that it is decoded in."""

_SEAM_GOAL = 1e-4


@single_threaded
def edof_decoder_cost_figures(folder: Path) -> list[Figure]:
    """The packaged decoder with its filter, on one thread."""
    decoder = build_decoder(bundled_trained_pattern())
    times = [_time_figure(decoder, shape) for shape in _TIME_GOALS]
    return [*times, _memory_figure(bundled_trained_pattern().path), _seam_figure(decoder)]


def _time_figure(decoder: PhotographDecoder, shape: tuple[int, int]) -> Figure:
    """Median processor time of a photograph, after one that isn't timed."""
    job = partial(decoder.decode, _photograph(shape), _NOISE)
    job()
    spent = processor_seconds({"decoder": job}, _REPEATS[shape])["decoder"]
    return Figure(
        f"decoding {shape[1]} x {shape[0]} pixels, filter and network, one thread",
        f"≤ {_TIME_GOALS[shape]:g} s of processor time",
        f"{spent:.3f} s, median of {_REPEATS[shape]}",
        spent <= _TIME_GOALS[shape],
    )


def _memory_figure(path: Path) -> Figure:
    """Measured in a process of its own, whose libraries are loaded before."""
    answer = subprocess.run(
        [sys.executable, "-m", "figures.edof_decoder_cost", str(path)],
        cwd=ROOT,
        env=ENVIRONMENT | {"OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    peak: float | None = json.loads(answer.stdout)
    name = f"memory for decoding {_LARGE[1]} x {_LARGE[0]} pixels, beside that of libraries"
    goal = f"≤ {_MEMORY_GOAL / 1e9:g} GB"
    if peak is None:
        return Figure(name, goal, "not measured: this system doesn't tell peaks", None)
    return Figure(name, goal, f"{peak / 1e9:.2f} GB", peak <= _MEMORY_GOAL)


def _seam_figure(decoder: PhotographDecoder) -> Figure:
    """A crop in tiles against one run of the network."""
    network, capture = decoder.pattern.network, _photograph(_CROP)
    filtered = capture.flip(1).contiguous()
    whole, tiles = (
        network.restore(capture, _NOISE, filtered, tile=side) for side in (max(_CROP), _TILE)
    )
    apart = float((tiles - whole).abs().max())
    return Figure(
        f"decoding {_CROP[1]} x {_CROP[0]} pixels in tiles of {_TILE} against in one run",
        f"≤ {_SEAM_GOAL:g} apart",
        f"{apart:.1e}, where white is 1",
        apart <= _SEAM_GOAL,
    )


def _photograph(shape: tuple[int, int]) -> torch.Tensor:
    """Smooth noise of many scales, from 0 to 1: costs don't depend on what a photograph shows."""
    chance, picture = torch.Generator().manual_seed(0), torch.zeros(1, 1, *shape)
    for cells in (4, 32, 256):
        coarse = torch.rand(1, 1, cells, cells, generator=chance)
        picture += torch.nn.functional.interpolate(coarse, shape, mode="bilinear") / 3
    return picture[0, 0]


@single_threaded
def _main(path: Path) -> None:
    """Print how many bytes decoding a photograph takes at most; null if that isn't known."""
    try:
        libraries = own_memory("VmRSS")
        decoder, photograph = build_decoder(read_trained_pattern(path)), _photograph(_LARGE)
        decoder.decode(photograph[:64, :64], _NOISE)
        # The peak begins anew, so that the filter's PSFs aren't in it.
        Path("/proc/self/clear_refs").write_text("5")
        decoder.decode(photograph, _NOISE)
        print(own_memory("VmHWM") - libraries)
    except OSError:
        print("null")


MEASUREMENTS = {"edof-decoder-cost": edof_decoder_cost_figures}


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
