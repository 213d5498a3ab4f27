"""A sensor as data: its pixels, their characteristics, and the mosaic of their filters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import torch

from optics.plane import Plane
from optics.validation import require_amount, require_choice, require_positive, require_share

if TYPE_CHECKING:
    from optics.light.spectrum import Spectrum


@dataclass(frozen=True, eq=False)
class Mosaic:
    """Pattern of colour filters that repeats over the pixels, from the first one on.

    Parameters
    ----------
    pattern : tuple of str
        Rows of one letter per pixel, as ``("RG", "GB")`` for Bayer's pattern.
    efficiencies : mapping of str to Spectrum
        For each letter, electrons per photon at each wavelength, filter and pixel together.

    Raises
    ------
    ValueError
        If rows differ in length, or a letter has no curve.
    """

    pattern: tuple[str, ...]
    efficiencies: Mapping[str, Spectrum] = field(repr=False)

    def __post_init__(self) -> None:
        pattern = tuple(self.pattern)
        if not pattern or not pattern[0] or len({len(row) for row in pattern}) > 1:
            raise ValueError(
                f"pattern is {pattern}; give rows of one letter a pixel, all as long, as in "
                "('RG', 'GB')"
            )
        missing = {letter for row in pattern for letter in row} - set(self.efficiencies)
        if missing:
            raise ValueError(
                f"pattern has {', '.join(sorted(missing))}, which efficiencies don't say; give a "
                "curve for each letter"
            )
        object.__setattr__(self, "pattern", pattern)
        object.__setattr__(self, "efficiencies", dict(self.efficiencies))

    def _content(self) -> tuple[object, ...]:
        return (self.pattern, *((name, self.efficiencies[name]) for name in self.channels))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mosaic):
            return NotImplemented
        return self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    @property
    def channels(self) -> tuple[str, ...]:
        """Letters of the colour filters, each once, in their order of appearance."""
        return tuple(dict.fromkeys("".join(self.pattern)))

    def channel_map(self, shape: tuple[int, int]) -> torch.Tensor:
        """Return each pixel's colour filter as an index into `channels`, (rows, columns) int64."""
        index = {name: i for i, name in enumerate(self.channels)}
        cell = torch.tensor([[index[letter] for letter in row] for row in self.pattern])
        rows = torch.arange(shape[0])[:, None] % cell.shape[0]
        columns = torch.arange(shape[1])[None, :] % cell.shape[1]
        return cell[rows, columns]

    def sample_channels(self, channels: torch.Tensor) -> torch.Tensor:
        """Sample pictures of all channels as pixels with these colour filters do.

        channels: (channel, rows, columns). Returns (rows, columns). Raises ValueError if there
        isn't one picture for each of `channels`.
        """
        if channels.ndim != 3 or len(channels) != len(self.channels):
            raise ValueError(
                f"channels is {tuple(channels.shape)}; it must be {len(self.channels)} pictures, "
                f"of {', '.join(self.channels)}"
            )
        which = self.channel_map((channels.shape[1], channels.shape[2]))
        return channels.gather(0, which[None])[0]


_MAX_PRNU = 0.2  # with more, a pixel's response to light might be negative
_MAX_CROSSTALK = 0.25  # with more, a pixel would collect less than its neighbours


@dataclass(frozen=True)
class Sensor:
    """Describes a sensor in the quantities of EMVA 1288.

    The defaults are those of a 3.45 µm machine-vision sensor.

    shape: (rows, columns). pitch: metres. bits: of the digital number. full_well: electrons. gain:
    electrons per digital number. read_noise: electrons, standard deviation. dark_current: electrons
    per second. black_level: digital number of no light. quantum_efficiency: electrons per photon.
    exposure_range: seconds. spectral_efficiency: electrons per photon by wavelength; None for
    quantum_efficiency at all wavelengths. colour: mosaic of colour filters, whose curves replace
    spectral_efficiency; None for a monochrome sensor. prnu: standard deviation of the pixels'
    response, relative. dsnu: standard deviation of the pixels' offsets in darkness, electrons.
    dead: share of pixels that don't respond to light. hot: share of pixels whose dark current is
    higher by hot_current electrons per second. fixed_seed: seed of the maps of these four, one for
    each camera. shutter: "global", or "rolling" with line_time seconds from row to row. model: name
    of the sensor. clip_level: digital number at which the converter ends, if that isn't the largest
    number of so many bits: 65520 for a converter of 12 bits whose numbers are sent as 16.

    Only the simulator uses the rest. crosstalk: share of a pixel's electrons that each of its
    neighbours in the row and in the column collects. dust: specks on the cover glass, (y, x,
    diameter) in metres from the sensor's middle; dust_distance: metres of air, or of glass over its
    index, from the specks to the pixels.
    """

    shape: tuple[int, int] = (512, 768)
    pitch: float = 3.45e-6
    bits: int = 12
    full_well: float = 10500.0
    gain: float = 2.6
    read_noise: float = 2.4
    dark_current: float = 1.0
    black_level: float = 64.0
    quantum_efficiency: float = 0.62
    exposure_range: tuple[float, float] = (20e-6, 30.0)
    spectral_efficiency: Spectrum | None = None
    colour: Mosaic | None = None
    prnu: float = 0.0
    dsnu: float = 0.0
    dead: float = 0.0
    hot: float = 0.0
    hot_current: float = 0.0
    fixed_seed: int = 0
    shutter: Literal["global", "rolling"] = "global"
    line_time: float = 0.0
    model: str = ""
    clip_level: int | None = None
    crosstalk: float = 0.0
    dust: tuple[tuple[float, float, float], ...] = ()
    dust_distance: float = 0.0

    def __post_init__(self) -> None:
        for name in ("pitch", "full_well", "gain", "quantum_efficiency"):
            require_positive(name, getattr(self, name), "")
        for name in (
            "read_noise", "dark_current", "black_level", "prnu", "dsnu", "hot_current", "line_time"
        ):  # fmt: skip
            require_amount(name, getattr(self, name), "")
        self._require_sound_pixels()
        if not 1 <= self.bits <= 16:
            raise ValueError(f"bits is {self.bits}; a sensor has 1 to 16")
        if self.clip_level is not None and not 1 <= self.clip_level < 2**self.bits:
            raise ValueError(
                f"clip_level is {self.clip_level}; numbers of {self.bits} bits lie between 0 and "
                f"{2**self.bits - 1}"
            )
        if self.black_level >= self.full_scale:
            raise ValueError(
                f"black_level is {self.black_level:g}; it must lie below the full scale, "
                f"{self.full_scale}"
            )
        low, high = self.exposure_range
        if not 0 < low <= high < math.inf:
            raise ValueError(f"exposure_range is {low:g} to {high:g} s; give the shorter first")
        Plane(self.shape, (self.pitch, self.pitch))
        require_amount("dust_distance", self.dust_distance, "m")
        if self.dust and not self.dust_distance:
            raise ValueError("dust needs its dust_distance to the pixels, more than 0 m")
        for y, x, diameter in self.dust:
            if not (math.isfinite(y) and math.isfinite(x) and 0 < diameter < math.inf):
                raise ValueError(
                    f"dust has the speck ({y:g}, {x:g}, {diameter:g}) m; give y, x and a diameter "
                    "of more than 0"
                )

    def _require_sound_pixels(self) -> None:
        if self.prnu > _MAX_PRNU:
            raise ValueError(
                f"prnu is {self.prnu:g}; it is a share of the response, {_MAX_PRNU:g} at most"
            )
        for name in ("dead", "hot"):
            require_share(name, getattr(self, name))
        if not 0 <= self.crosstalk <= _MAX_CROSSTALK:
            raise ValueError(
                f"crosstalk is {self.crosstalk:g}; each neighbour collects a share of 0 to "
                f"{_MAX_CROSSTALK:g}"
            )
        if self.dead + self.hot > 1:
            raise ValueError(
                f"dead is {self.dead:g} and hot {self.hot:g}; no more than all pixels can be either"
            )
        require_choice("shutter", self.shutter, ("global", "rolling"))
        if self.shutter == "rolling" and not self.line_time:
            raise ValueError("a rolling shutter needs its line_time, more than 0 s")

    @property
    def plane(self) -> Plane:
        return self.window_plane(self.shape)

    def window_plane(
        self, shape: tuple[int, int], centre: tuple[float, float] = (0.0, 0.0)
    ) -> Plane:
        """Return the plane of a window of pixels: (rows, columns) around (y, x) in metres."""
        return Plane(shape, (self.pitch, self.pitch), centre)

    @property
    def top_number(self) -> int:
        """Largest digital number of the converter, at which it ends."""
        return 2**self.bits - 1 if self.clip_level is None else self.clip_level

    @property
    def full_scale(self) -> int:
        """Digital number from which a pixel counts as clipped.

        If the well is full before the converter's range ends, read noise may lower the number of a
        full pixel. So the limit lies five standard deviations of read noise below the full well.
        """
        well = self.full_well - 5.0 * self.read_noise
        return math.floor(min(self.top_number, self.black_level + well / self.gain))
