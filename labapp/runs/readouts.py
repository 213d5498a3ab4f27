"""Ways of reading the sensor: gain, region, binning, and frames whose mean is stored."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Region

if TYPE_CHECKING:
    from labapp.files.plan_file import Acquisition
    from labapp.runs.capabilities import BenchCapabilities
    from optics.camera import Camera, Sensor

_LARGEST = np.iinfo(np.uint16).max


class Readout(NamedTuple):
    """How a shot's frame is read; by default as the bench opens the camera.

    gain_db: decibels.
    amplification_db: what that is beyond the gain with which the bench opens the camera.
    region: x, y, width and height in pixels of the opened camera's frames.
    binning: such pixels each way whose mean is one.
    averaged: frames whose mean is stored.
    steps_per_dn: the stored number of 1 DN, so that the mean of whole numbers keeps its fraction.
    """

    gain_db: float | None = None
    amplification_db: float = 0.0
    region: Region | None = None
    binning: int | None = None
    averaged: int = 1
    steps_per_dn: int = 1

    def shape(self, whole: tuple[int, int]) -> tuple[int, int]:
        """Return a frame's (rows, columns) if the camera's frames have `whole` pixels."""
        _, _, width, height = self.region or (0, 0, whole[1], whole[0])
        each = self.binning or 1
        return height // each, width // each

    def describe(self) -> str:
        """Describe the readout in short; "" as the bench opens the camera.

        A region is WIDTHxHEIGHT+X+Y, as X11 has it.
        """
        words = []
        if self.gain_db is not None:
            words.append(f"{self.gain_db:g} dB")
        if self.region is not None:
            x, y, width, height = self.region
            words.append(f"{width}x{height}+{x}+{y}")
        if self.binning is not None:
            words.append(f"bin {self.binning}")
        if self.averaged > 1:
            unit = f" in 1/{self.steps_per_dn} DN" if self.steps_per_dn > 1 else ""
            words.append(f"mean of {self.averaged}{unit}")
        return ", ".join(words)

    def read_camera(self, camera: Camera) -> Camera:
        """Return the description of a camera whose frames are read so."""
        if self == AS_OPENED:
            return camera
        return replace(camera, sensor=self.read_sensor(camera.sensor))

    def read_sensor(self, sensor: Sensor) -> Sensor:
        """Return the description of a sensor whose frames are read so."""
        if self == AS_OPENED:
            return sensor
        # Most runs need no description of another sensor.
        from optics.sensor import sensor_as_read

        return sensor_as_read(
            sensor,
            amplification_db=self.amplification_db,
            region=self.region,
            binning=self.binning or 1,
            averaged=self.averaged,
        )

    def whole_numbers(self, image: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Convert a stored image to whole DN."""
        steps = self.steps_per_dn
        return image if steps == 1 else ((image + np.uint32(steps // 2)) // steps).astype(np.uint16)

    def numbers(self, image: NDArray[np.uint16]) -> NDArray[Any]:
        """Convert a stored image to DN: whole ones, or the mean's with fractions."""
        return image if self.steps_per_dn == 1 else image / np.float32(self.steps_per_dn)

    def read_mask(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which pixels of the frame have any of the marked pixels of a whole frame."""
        x, y, width, height = self.region or (0, 0, mask.shape[1], mask.shape[0])
        each = self.binning or 1
        rows, columns = height // each, width // each
        part = mask[y : y + rows * each, x : x + columns * each]
        return np.any(part.reshape(rows, each, columns, each), axis=(1, 3))

    def as_data(self) -> dict[str, Any]:
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in self._asdict().items()
        }

    @staticmethod
    def of_data(data: Mapping[str, Any]) -> Readout:
        """Rebuild what as_data() has told."""
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in data.items()
        }
        return Readout(**values)


AS_OPENED = Readout()
"""Frames are read as the bench opens the camera."""


def block_readouts(block: Acquisition, capabilities: BenchCapabilities) -> Iterator[Readout]:
    """Yield the readouts of a block of the plan: by region, then binning, then gain.

    Where the plan doesn't choose, the camera's own stand.
    """
    steps = steps_per_dn(block.average, capabilities.full_scale)
    for region, binning, gain in product(
        block.regions_px or (None,), block.binnings or (None,), block.gains_db or (None,)
    ):
        more = 0.0 if gain is None else gain - capabilities.gain_db
        yield Readout(gain, more, region, binning, block.average, steps)


def largest_shape(readouts: Iterable[Readout], whole: tuple[int, int]) -> tuple[int, int]:
    """Return the (rows, columns) that the frames of all readouts fit into."""
    shapes = [one.shape(whole) for one in readouts]
    return max(rows for rows, _ in shapes), max(columns for _, columns in shapes)


def steps_per_dn(averaged: int, full_scale: int) -> int:
    """Return the stored number of 1 DN in a frame that is the mean of several.

    It is the largest power of two with which the full scale is still a number of 16 bits, and no
    more than the mean has steps.
    """
    steps = 1
    while steps < averaged and 2 * steps * full_scale <= _LARGEST:
        steps *= 2
    return steps


class MeanImage:
    """The mean of the frames that were added so far.

    A pixel that is clipped in any of them is clipped: its mean would be too low.
    """

    def __init__(self, first: NDArray[np.uint16], full_scale: int) -> None:
        self._full_scale, self._count = full_scale, 0
        self._total = np.zeros(first.shape, np.uint32)
        self._clipped = np.zeros(first.shape, bool)
        self.add(first)

    def add(self, image: NDArray[np.uint16]) -> None:
        """Add a frame to the mean; ValueError if it has another size."""
        if image.shape != self._total.shape:
            raise ValueError(f"a frame of {image.shape} pixels follows one of {self._total.shape}")
        self._total += image
        self._clipped |= image >= self._full_scale
        self._count += 1

    def stored(self, steps: int) -> NDArray[np.uint16]:
        """Return the mean in steps of 1 DN / `steps`, as it is stored."""
        mean = np.rint(self._total * (steps / self._count))
        mean[self._clipped] = self._full_scale * steps
        return np.minimum(mean, _LARGEST).astype(np.uint16)
