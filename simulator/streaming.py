"""Frames of a picture that doesn't change: only the sensor's noise differs between them."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Sensor
from optics.sensor import Stages
from optics.sensor.frame_sampling import electrons_from_normal
from optics.sensor.stages import FEW_ELECTRONS, collect_electrons
from optics.threads import single_threaded
from simulator.recipe import Recipe

# Pixels that are drawn together, with a seed of their own. Chosen so that they stay in a core's
# memory, and torch doesn't divide them among threads.
_BLOCK_PIXELS = 1 << 15

# Electrons of read noise from which on the whole numbers of electrons can't be seen: e^(-π²/2) of
# a step is left.
_MIN_READ_NOISE = 0.5

# Standard deviations from the full well at which a pixel surely is, or isn't, full. Chosen.
_CLIPPING_SIGMAS = 7.0

# Mean electrons from which on a normal distribution with the right third moment stands for shot
# and read noise together: their distributions differ by 6e-5.
_MIN_MERGED_ELECTRONS = 100.0

# Mean electrons from which on a skewed normal distribution replaces Poisson's: they differ by
# 1e-8, and by 1e-6 together with read noise.
_MIN_SKEWED_ELECTRONS = 1e4

# Share of a block's pixels up to which those that must be drawn stage by stage are drawn once
# more with such pixels of other blocks. Above, all of the block are drawn stage by stage, which
# takes three times as long (measured).
_MAX_SCATTERED_SHARE = 0.5


class FrameSimulator:
    """Draw frames of one picture for one exposure and set of sensor stages.

    electrons: mean electrons that light frees on each pixel, (rows, columns). Numbers are always
    rounded and kept in the converter's range. threads: that draw at the same time; frames don't
    depend on their number. Raises ValueError for electrons that aren't finite, an exposure that
    isn't positive, or no thread.
    """

    @single_threaded
    def __init__(
        self,
        electrons: torch.Tensor,
        exposure: float,
        sensor: Sensor,
        recipe: Recipe,
        threads: int = 2,
    ) -> None:
        if threads < 1:
            raise ValueError(f"threads is {threads}; one at least has to draw")
        held = collect_electrons(electrons, exposure, sensor, recipe.stages)
        self._shape = tuple(electrons.shape)
        mean = held.electrons.flatten()
        offset = None if isinstance(held.offset, float) else held.offset.flatten()

        def some(part: slice | torch.Tensor) -> tuple[torch.Tensor, torch.Tensor | None]:
            return mean[part], None if offset is None else offset[part]

        self._blocks: list[_Block] = []
        left = []
        for part in _parts(mean.numel()):
            way, places = _choose_way(*some(part), sensor, recipe.stages)
            self._blocks.append(_Block(part, way))
            left.append(places + part.start)
        scattered = torch.cat(left)
        self._scattered = [
            _Block(places.numpy(), _Stepwise(*some(places), sensor, recipe.stages))
            for places in (scattered[part] for part in _parts(len(scattered)))
        ]
        self._top = sensor.top_number
        self._threads = threads
        several = max(len(self._blocks), len(self._scattered)) > 1
        self._pool = ThreadPoolExecutor(threads, "stream") if threads > 1 and several else None

    @property
    def bytes(self) -> int:
        """Return the bytes of memory that are kept."""
        return sum(block.bytes for block in self._blocks + self._scattered)

    def frame(self, generator: torch.Generator) -> NDArray[np.uint16]:
        """Draw one raw frame, (rows, columns) of digital numbers.

        The frame depends on the generator's state alone, and advances it.
        """
        image = np.empty(math.prod(self._shape), dtype=np.uint16)

        def draw(some: list[tuple[_Block, int]]) -> None:
            for block, seed in some:
                own = torch.Generator().manual_seed(seed)
                numbers = block.way.draw(own).round_().clamp_(0, self._top)
                image[block.where] = numbers.numpy().astype(np.uint16)

        for blocks in filter(None, (self._blocks, self._scattered)):
            seeds = torch.randint(2**62, (len(blocks),), generator=generator).tolist()
            seeded = list(zip(blocks, seeds, strict=True))
            # Handing a block to a thread takes longer than drawing a small one.
            if self._pool is None or len(seeded) < 2:
                draw(seeded)
            else:
                count = self._threads
                list(self._pool.map(draw, (seeded[n::count] for n in range(count))))
        return image.reshape(self._shape)


def _parts(count: int) -> list[slice]:
    """Return the slices of pixels whose noise is drawn together."""
    step = _BLOCK_PIXELS
    return [slice(start, start + step) for start in range(0, count, step)]


class _Still:
    """Draw pixels without noise."""

    def __init__(self, number: torch.Tensor) -> None:
        self._number = number.to(torch.float32)

    def draw(self, generator: torch.Generator) -> torch.Tensor:
        return self._number.clone()


class _Normal:
    """Draw pixels whose noises are merged into one noise, normal or skewed.

    number, spread: mean and standard deviation of each digital number. bend: factor of the normal
    number's square, which is added for the third moment.
    """

    def __init__(
        self, number: torch.Tensor, spread: torch.Tensor, bend: torch.Tensor | None
    ) -> None:
        self._bend = None if bend is None else bend.to(torch.float32)
        if bend is not None:
            # The square of a standard normal number has a mean of 1 and a variance of 2.
            number = number - bend
            spread = (spread.square() - 2 * bend.square()).clamp(min=0).sqrt()
        self._number, self._spread = number.to(torch.float32), spread.to(torch.float32)

    def draw(self, generator: torch.Generator) -> torch.Tensor:
        noise = torch.empty_like(self._number).normal_(generator=generator)
        if self._bend is None:
            return torch.addcmul(self._number, noise, self._spread, out=noise)
        slope = torch.addcmul(self._spread, noise, self._bend)
        return torch.addcmul(self._number, noise, slope, out=noise)


class _Stepwise:
    """Draw pixels stage by stage: electrons first, then the full well, then the read noise."""

    def __init__(
        self, mean: torch.Tensor, offset: torch.Tensor | None, sensor: Sensor, stages: Stages
    ) -> None:
        self._mean = mean.to(torch.float32)
        self._offset = None if offset is None else offset.to(torch.float32)
        self._shot: Literal["Gaussian", "skewed"] = _shot(stages)
        self._few = (mean < _poisson_limit(stages)).nonzero().flatten()
        self._well = sensor.full_well if stages.clipping else math.inf
        self._read = sensor.read_noise if stages.read_noise else 0.0
        self._gain, self._black = sensor.gain, sensor.black_level

    def draw(self, generator: torch.Generator) -> torch.Tensor:
        if len(self._few) == len(self._mean):
            held = torch.poisson(self._mean, generator=generator)
        else:
            noise = torch.empty_like(self._mean).normal_(generator=generator)
            held = electrons_from_normal(self._mean, noise, self._shot)
            if len(self._few):
                held[self._few] = torch.poisson(self._mean[self._few], generator=generator)
        held.clamp_(max=self._well)
        if self._offset is not None:
            held += self._offset
        if self._read:
            noise = torch.empty_like(held).normal_(generator=generator)
            held.add_(noise, alpha=self._read)
        return held.div_(self._gain).add_(self._black)


_Way = _Still | _Normal | _Stepwise


@dataclass(frozen=True)
class _Block:
    """Pixels that are drawn together, and the way they are drawn.

    where: their indices in the flat picture.
    """

    where: slice | NDArray[np.int64]
    way: _Way

    @property
    def bytes(self) -> int:
        kept = [self.where, *vars(self.way).values()]
        return sum(one.nbytes for one in kept if isinstance(one, torch.Tensor | np.ndarray))


def _poisson_limit(stages: Stages) -> float:
    """Return the mean electron number from which on Poisson noise isn't drawn as such."""
    return _MIN_SKEWED_ELECTRONS if stages.shot == "Poisson" else FEW_ELECTRONS


def _shot(stages: Stages) -> Literal["Gaussian", "skewed"]:
    """Return the distribution that is drawn for many electrons instead of Poisson's."""
    return "Gaussian" if stages.shot == "Gaussian" else "skewed"


def _choose_way(
    mean: torch.Tensor, offset: torch.Tensor | None, sensor: Sensor, stages: Stages
) -> tuple[_Way, torch.Tensor]:
    """Return the fastest way to draw pixels as accurately as stage by stage.

    With it come the places of those among them for which it isn't accurate: few, or none.
    """
    read = sensor.read_noise if stages.read_noise else 0.0
    chancy = stages.shot != "none"
    if stages.clipping:
        # More electrons than this fill the well in any case. The limit keeps the mean within what
        # a float32 and the Poisson generator can represent.
        mean = mean.clamp(max=4 * sensor.full_well + 1000)
    held = mean.clamp(max=sensor.full_well) if stages.clipping else mean
    reach = _CLIPPING_SIGMAS * (mean + 1).sqrt()
    full = mean - reach > sensor.full_well if stages.clipping else mean < 0
    apart = torch.zeros_like(full)
    if chancy:
        apart = (mean > 0) & ~full & ~_can_merge_noises(mean, reach, read, sensor, stages)
    places = apart.nonzero().flatten()
    if len(places) > _MAX_SCATTERED_SHARE * len(mean):
        return _Stepwise(mean, offset, sensor, stages), places[:0]
    shot = torch.where(full, 0.0, mean) if chancy else torch.zeros_like(mean)
    number = (held if offset is None else held + offset) / sensor.gain + sensor.black_level
    varied = shot + read**2
    if not bool(varied.any()):
        return _Still(number), places
    # Only the electrons have a third moment; read noise is symmetric.
    bend = shot / (6 * varied.clamp(min=1e-30)) / sensor.gain if _shot(stages) == "skewed" else None
    return _Normal(number, varied.sqrt() / sensor.gain, bend), places


def _can_merge_noises(
    mean: torch.Tensor, reach: torch.Tensor, read: float, sensor: Sensor, stages: Stages
) -> torch.Tensor:
    """Return for which pixels shot and read noise may be drawn as one noise.

    They have many electrons, read noise that hides whole numbers, and surely no full well.
    """
    many = mean >= max(_poisson_limit(stages), _MIN_MERGED_ELECTRONS)
    smooth = read >= _MIN_READ_NOISE
    clear = (mean + reach < sensor.full_well) if stages.clipping else torch.ones_like(many)
    return many & clear & smooth
