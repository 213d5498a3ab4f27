"""Frames of a picture that doesn't change: only noise is drawn for each."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Sensor
from optics.sensor import Stages
from optics.sensor.frame_sampling import electrons_from_normal
from optics.sensor.stages import FEW_ELECTRONS, CollectedCharge, collect_electrons
from optics.threads import single_threaded
from simulator.recipe import Recipe

_BLOCK = 1 << 15
"""Pixels that are drawn together, with a seed of their own: they stay in a core's memory, and
torch gives no part of them to another thread."""

_SMOOTH = 0.5
"""Electrons of read noise that hide that electrons are whole: e^(-π²/2) of a step is left."""

_SURELY = 7.0
"""Standard deviations from the full well at which a pixel surely is, or isn't, full."""

_BENT_ALONE = 100.0
"""Electrons from which the third moment is enough of what noises together are beside a normal
one: 6e-5 of their distribution is left."""

_SURELY_SKEWED = 1e4
"""Electrons from which nobody could tell Poisson's distribution from the normal one that is bent
as it is: they are 1e-8 apart, and 1e-6 together with read noise."""


class FrameSimulator:
    """Draws frames of one picture, exposure and set of stages; keeps all that they share.

    electrons: expected from light on each pixel over the exposure, (rows, columns). recipe:
    which of the sensor's stages are done; numbers are rounded and kept in the converter's range
    whatever it says, as frames are whole numbers. threads: that draw at the same time; frames
    don't depend on them. Raises ValueError for electrons that aren't finite, an exposure that
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
        mean, offset = held.electrons.flatten(), _offsets(held)
        self._blocks = [
            _block(mean[part], None if offset is None else offset[part], sensor, recipe.stages)
            for part in _parts(mean.numel())
        ]
        self._top = 2**sensor.bits - 1
        self._pool = ThreadPoolExecutor(threads, "stream") if threads > 1 else None

    @property
    def bytes(self) -> int:
        """Of memory that is kept."""
        return sum(block.bytes for block in self._blocks)

    def frame(self, generator: torch.Generator) -> NDArray[np.uint16]:
        """One raw frame, (rows, columns) of digital numbers.

        The generator's state alone decides it, and is moved on by it.
        """
        count = len(self._blocks)
        seeds = torch.randint(2**62, (count,), generator=generator).tolist()
        image = np.empty(math.prod(self._shape), dtype=np.uint16)
        parts = _parts(image.size)

        def draw(number: int) -> None:
            own = torch.Generator().manual_seed(seeds[number])
            numbers = self._blocks[number].draw(own).round_().clamp_(0, self._top)
            np.copyto(image[parts[number]], numbers.numpy(), casting="unsafe")

        if self._pool is None:
            for number in range(count):
                draw(number)
        else:
            list(self._pool.map(draw, range(count)))
        return image.reshape(self._shape)


def _parts(count: int) -> list[slice]:
    return [slice(start, start + _BLOCK) for start in range(0, count, _BLOCK)]


def _offsets(held: CollectedCharge) -> torch.Tensor | None:
    return None if isinstance(held.offset, float) else held.offset.flatten()


class _Still:
    """Pixels that don't vary."""

    def __init__(self, number: torch.Tensor) -> None:
        self._number = number.to(torch.float32)

    @property
    def bytes(self) -> int:
        return self._number.nbytes

    def draw(self, generator: torch.Generator) -> torch.Tensor:
        return self._number.clone()


class _Normal:
    """Pixels whose noises are one normal noise together, bent as much as its third moment asks
    for: by mean and spread of their number, and by what the noise's square adds to it."""

    def __init__(
        self, number: torch.Tensor, spread: torch.Tensor, bend: torch.Tensor | None
    ) -> None:
        self._number, self._spread = number.to(torch.float32), spread.to(torch.float32)
        self._bend = None
        if bend is not None:
            self._bend = bend.to(torch.float32)
            # A square has a mean of 1 and a variance of 2.
            self._number = (number - bend).to(torch.float32)
            self._spread = (spread.square() - 2 * bend.square()).sqrt().to(torch.float32)

    @property
    def bytes(self) -> int:
        kept = (self._number, self._spread, self._bend)
        return sum(one.nbytes for one in kept if one is not None)

    def draw(self, generator: torch.Generator) -> torch.Tensor:
        noise = torch.empty_like(self._number).normal_(generator=generator)
        if self._bend is None:
            return torch.addcmul(self._number, noise, self._spread, out=noise)
        slope = torch.addcmul(self._spread, noise, self._bend)
        return torch.addcmul(self._number, noise, slope, out=noise)


class _Stepwise:
    """Pixels whose electrons are drawn and held before they are read."""

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

    @property
    def bytes(self) -> int:
        kept = (self._mean, self._few, self._offset)
        return sum(one.nbytes for one in kept if one is not None)

    def draw(self, generator: torch.Generator) -> torch.Tensor:
        held = self._electrons(generator).clamp_(max=self._well)
        if self._offset is not None:
            held += self._offset
        if self._read:
            noise = torch.empty_like(held).normal_(generator=generator)
            held.add_(noise, alpha=self._read)
        return held.div_(self._gain).add_(self._black)

    def _electrons(self, generator: torch.Generator) -> torch.Tensor:
        if len(self._few) == len(self._mean):
            return torch.poisson(self._mean, generator=generator)
        noise = torch.empty_like(self._mean).normal_(generator=generator)
        held = electrons_from_normal(self._mean, noise, self._shot)
        if len(self._few):
            held[self._few] = torch.poisson(self._mean[self._few], generator=generator)
        return held


_Block = _Still | _Normal | _Stepwise


def _poisson_limit(stages: Stages) -> float:
    return _SURELY_SKEWED if stages.shot == "Poisson" else FEW_ELECTRONS


def _shot(stages: Stages) -> Literal["Gaussian", "skewed"]:
    """What stands for Poisson's distribution where it does."""
    return "Gaussian" if stages.shot == "Gaussian" else "skewed"


def _block(
    mean: torch.Tensor, offset: torch.Tensor | None, sensor: Sensor, stages: Stages
) -> _Block:
    """The cheapest way to draw some pixels that is as good as the full one."""
    read = sensor.read_noise if stages.read_noise else 0.0
    chancy = stages.shot != "none"
    if stages.clipping:
        # Beyond, it makes no difference; a float32 holds it, and Poisson's generator counts it.
        mean = mean.clamp(max=4 * sensor.full_well + 1000)
    held = mean.clamp(max=sensor.full_well) if stages.clipping else mean
    reach = _SURELY * (mean + 1).sqrt()
    full = mean - reach > sensor.full_well if stages.clipping else mean < 0
    if chancy and bool(
        ((mean > 0) & ~full & ~_can_merge_noises(mean, reach, read, sensor, stages)).any()
    ):
        return _Stepwise(mean, offset, sensor, stages)
    shot = torch.where(full, 0.0, mean) if chancy else torch.zeros_like(mean)
    number = (held if offset is None else held + offset) / sensor.gain + sensor.black_level
    varied = shot + read**2
    if not bool(varied.any()):
        return _Still(number)
    # The third moment is that of the electrons alone.
    bend = shot / (6 * varied.clamp(min=1e-30)) / sensor.gain if _shot(stages) == "skewed" else None
    return _Normal(number, varied.sqrt() / sensor.gain, bend)


def _can_merge_noises(
    mean: torch.Tensor, reach: torch.Tensor, read: float, sensor: Sensor, stages: Stages
) -> torch.Tensor:
    """Where shot and read noise may be drawn as one: many electrons, of which nobody sees that
    they are whole, and surely no full well."""
    many = mean >= max(_poisson_limit(stages), _BENT_ALONE)
    smooth = read >= _SMOOTH
    clear = (mean + reach < sensor.full_well) if stages.clipping else torch.ones_like(many)
    return many & clear & smooth
