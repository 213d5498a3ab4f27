"""State how patterns are evaluated, and on which pictures."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import torch

from optics.edof.dioptres import (
    DEPTH_RANGE,
    PUBLISHED_DIOPTRES,
    midpoint_dioptres,
    require_depth_range,
    require_dioptres,
    stratified_dioptres,
)
from optics.validation import (
    accepts_numpy,
    require_count,
    require_finite,
    require_positive,
    require_share,
    require_wavelength,
)

LightScale = Literal["linear", "srgb"]
"""Whether a picture's values are proportional to light, or encoded by the curve of sRGB."""

LINEAR_BELOW = 0.0031308
"""Light up to which the sRGB encoding is linear (IEC 61966-2-1)."""

# Weights of red, green and blue in the luminance of linear sRGB (IEC 61966-2-1).
_LUMINANCE = (0.2126, 0.7152, 0.0722)


@accepts_numpy
def decode_srgb(picture: torch.Tensor) -> torch.Tensor:
    """Convert sRGB values, 0 to 1, to linear light, 0 to 1 (IEC 61966-2-1)."""
    power = ((picture.clamp(min=0.04045) + 0.055) / 1.055) ** 2.4
    return torch.where(picture <= 0.04045, picture / 12.92, power)


@accepts_numpy
def encode_srgb(picture: torch.Tensor) -> torch.Tensor:
    """Convert linear light to sRGB values, 0 to 1; light is clipped to 0 to 1, as by a display."""
    return encode_unclipped(picture.clamp(0, 1))


def encode_unclipped(light: torch.Tensor) -> torch.Tensor:
    """Encode linear light by the curve of sRGB, which goes on below 0 and above 1."""
    power = 1.055 * light.clamp(min=LINEAR_BELOW) ** (1 / 2.4) - 0.055
    return torch.where(light <= LINEAR_BELOW, 12.92 * light, power)


@accepts_numpy
def prepare_scene(
    picture: torch.Tensor, side: int, light: LightScale = "srgb", shortest_edge: int | None = None
) -> torch.Tensor:
    """Turn a photograph into a square grey scene: resize, crop the middle, decode, make grey.

    The scene is (side, side), float32, 0 to 1. Raises ValueError if the picture has another shape,
    is too small for the scene, or holds values outside 0 to 1, or if an argument is out of range.

    picture: values encoded by the curve of sRGB, (rows, columns) or (rows, columns, 3) in red,
        green, blue; float from 0 to 1, or uint8 from 0 to 255.
    light: "linear" decodes the values to light; "srgb" takes the encoded values as if they were
        light.
    shortest_edge: pixels of the photograph's shortest edge after it is resized (bicubic, with
        antialiasing). It isn't resized by default.
    """
    require_count("side", side)
    if light not in ("linear", "srgb"):
        raise ValueError(f"light is {light!r}; choose linear or srgb")
    values = _encoded_channels(picture)
    if shortest_edge is not None:
        require_count("shortest_edge", shortest_edge)
        scale = shortest_edge / min(values.shape[-2:])
        size = [round(n * scale) for n in values.shape[-2:]]
        # Bicubic interpolation overshoots at edges.
        values = torch.nn.functional.interpolate(
            values[None], size=size, mode="bicubic", antialias=True, align_corners=False
        )[0].clamp(0, 1)
    rows, columns = values.shape[-2:]
    if min(rows, columns) < side:
        raise ValueError(
            f"picture is {columns} x {rows} pixels; the scene needs {side} x {side}: give a larger "
            "picture, or a protocol with a smaller crop, or with a periodic border"
        )
    top, left = rows // 2 - side // 2, columns // 2 - side // 2
    values = values[:, top : top + side, left : left + side]
    return convert_to_luminance(decode_srgb(values) if light == "linear" else values)


def _encoded_channels(picture: torch.Tensor) -> torch.Tensor:
    """Return a photograph's sRGB values as float32, (1 or 3, rows, columns), after checking it."""
    if picture.ndim not in (2, 3) or (picture.ndim == 3 and picture.shape[2] != 3):
        raise ValueError(
            f"picture is {tuple(picture.shape)}; give (rows, columns) or (rows, columns, 3)"
        )
    values = picture[None] if picture.ndim == 2 else picture.movedim(2, 0)
    values = values / 255.0 if values.dtype == torch.uint8 else values.to(torch.float32)
    require_finite("picture", values)
    if not (values.min() >= 0 and values.max() <= 1):
        raise ValueError(
            f"picture goes from {float(values.min()):g} to {float(values.max()):g}; give sRGB "
            "values from 0 to 1, or uint8"
        )
    return values


def convert_to_luminance(channels: torch.Tensor) -> torch.Tensor:
    """Convert red, green and blue, (3, rows, columns), to their luminance, (rows, columns).

    One channel, (1, rows, columns), is taken as it is.
    """
    if channels.shape[0] == 1:
        return channels[0].contiguous()
    weights = torch.tensor(_LUMINANCE, dtype=channels.dtype)
    # A matrix product would run in half precision under autocast.
    return (weights[:, None, None] * channels).sum(0)


Border = Literal["periodic", "true"]
"""What lies beyond a capture: the same picture again, or the rest of a larger scene."""


@dataclass(frozen=True)
class NoiseRange:
    """The noise of captures with the full aperture: a standard deviation, or several over a range.

    low, high: smallest and largest standard deviation of a pixel, relative to white. Positive;
        equal for one noise level.
    levels: number of noise levels: the midpoints of so many equal parts of the range.
    shot_share: share, 0 to 1, of a white pixel's variance that is photon noise, in proportion to
        the light. The rest, read noise, doesn't depend on it.
    """

    low: float
    high: float
    levels: int = 3
    shot_share: float = 0.0

    def __post_init__(self) -> None:
        require_positive("low", self.low, "")
        require_positive("high", self.high, "")
        if self.low > self.high:
            raise ValueError(f"low is {self.low:g} and high {self.high:g}; give the smaller first")
        require_count("levels", self.levels)
        require_share("shot_share", self.shot_share)

    @property
    def deviations(self) -> tuple[float, ...]:
        """Standard deviation of each noise level."""
        if self.low == self.high:
            return (self.low,)
        width = (self.high - self.low) / self.levels
        return tuple(self.low + width * (level + 0.5) for level in range(self.levels))


LOW_NOISE = NoiseRange(0.001, 0.015)
"""The low noise of thesis Table 5.2."""

HIGH_NOISE = NoiseRange(0.02, 0.05)
"""The high noise of thesis Table 5.2."""


@dataclass(frozen=True)
class EdofProtocol:
    """Everything that decides which score a pattern gets.

    A capture of full resolution has pixels of `pixel_pitch`. With a `binning` of b, a detector
    pixel is b x b of these: the scene is constant over a detector pixel, its image is computed at
    full resolution, and its mean over a detector pixel is captured, before noise is added.

    Parameters
    ----------
    name : str
        Name of the protocol in tables.
    wavelength, pixel_pitch : float, optional
        Metres; the pitch is that of pixels of full resolution.
    pixel_response : {"point", "area"}, optional
        Whether a pixel of full resolution takes the light density at its centre times its area, or
        the light on its area.
    psf_window, binning : int, optional
        Pixels of full resolution along a side of the window in which PSFs are computed, and of a
        detector pixel. Light beyond the window is lost, and reported.
    shortest_edge : int, optional
        Detector pixels to which a photograph's shortest edge is resized; None leaves its size.
    crop, centre : int, optional
        Detector pixels along a side of the capture, which is the middle of the photograph, and of
        its central part, which is scored apart.
    light : {"srgb", "linear"}, optional
        Whether a photograph's sRGB values are taken as light, or decoded to light.
    scored_in : tuple of {"srgb", "linear"}, optional
        Scales in which pictures are compared. Encoded values that are taken as light are compared
        as they are, "srgb".
    peak : float, optional
        Peak of the PSNR, and data range of the SSIM (see `optics.metrics.ssim`).
    border : {"periodic", "true"}, optional
        "periodic": the image wraps around the crop. "true": the scene is larger than the capture
        by the whole PSF, and the decoder gets the capture alone.
    noise : NoiseRange, optional
        The noise levels. Pictures take turns: all captures of a picture have one level. One decoder
        is built for each level, so that it is known.
    depth_range : tuple of (float, float), optional
        Farthest and nearest depth in dioptres, for depths off the grid and for blind decoders.
    on_grid : tuple of float, optional
        Depths in dioptres on the grid: those that are published.
    off_grid_count, design_count : int, optional
        Number of depths off the grid, one at random from each of so many equal parts of the range;
        and of those for which blind decoders are built, the midpoints of equal parts.
    seed : int, optional
        Seed of the depths off the grid and of the noise, which is the same for every pattern.

    Raises
    ------
    ValueError
        If a value is out of range, or values contradict each other.

    References
    ----------
    Thesis section 5.7, Eq. 5.11 and Table 5.2.
    """

    name: str
    wavelength: float = 520e-9
    pixel_pitch: float = 3.45e-6
    pixel_response: Literal["point", "area"] = "point"
    psf_window: int = 941
    binning: int = 1
    shortest_edge: int | None = None
    crop: int = 512
    light: LightScale = "srgb"
    scored_in: tuple[LightScale, ...] = ("srgb",)
    peak: float = 1.0
    border: Border = "periodic"
    centre: int = 256
    noise: NoiseRange = field(default=LOW_NOISE)
    depth_range: tuple[float, float] = DEPTH_RANGE
    on_grid: tuple[float, ...] = PUBLISHED_DIOPTRES
    off_grid_count: int = 40
    design_count: int = 32
    seed: int = 1

    def __post_init__(self) -> None:
        require_wavelength("wavelength", self.wavelength)
        for name, unit in (("pixel_pitch", "m"), ("peak", "")):
            require_positive(name, getattr(self, name), unit)
        for name in ("psf_window", "binning", "crop", "centre", "off_grid_count", "design_count"):
            require_count(name, getattr(self, name))
        if self.shortest_edge is not None:
            require_count("shortest_edge", self.shortest_edge)
        for name, words in (
            ("pixel_response", ("point", "area")),
            ("light", ("srgb", "linear")),
            ("border", ("periodic", "true")),
        ):
            if getattr(self, name) not in words:
                raise ValueError(f"{name} is {getattr(self, name)!r}; choose {' or '.join(words)}")
        if not self.scored_in or not set(self.scored_in) <= {"srgb", "linear"}:
            raise ValueError(f"scored_in is {self.scored_in}; give srgb, linear or both")
        if self.light == "srgb" and self.scored_in != ("srgb",):
            raise ValueError(
                f"scored_in is {self.scored_in}; sRGB values that are taken as light have no "
                "linear scale: score in srgb, or simulate in linear light"
            )
        if self.centre > self.crop:
            raise ValueError(f"centre is {self.centre}; it can't exceed the crop, {self.crop}")
        require_depth_range(self.depth_range)
        require_dioptres("on_grid", self.on_grid)

    @property
    def detector_pitch(self) -> float:
        """Metres between detector pixels, after binning."""
        return self.pixel_pitch * self.binning

    @property
    def kernel_reach(self) -> int:
        """Detector pixels from the centre of a PSF to its farthest edge."""
        return (self.psf_window // 2 + self.binning - 1) // self.binning

    @property
    def scene_side(self) -> int:
        """Detector pixels along a side of the scene that a capture needs."""
        return self.crop + (2 * self.kernel_reach if self.border == "true" else 0)

    @property
    def off_grid(self) -> tuple[float, ...]:
        """Random depths in dioptres, which no pattern is tuned for."""
        generator = torch.Generator().manual_seed(self.seed)
        return stratified_dioptres(self.off_grid_count, generator, self.depth_range)

    @property
    def test_dioptres(self) -> tuple[float, ...]:
        """Depths in dioptres at which captures are made: those on the grid, then off it."""
        return self.on_grid + self.off_grid

    @property
    def design_dioptres(self) -> tuple[float, ...]:
        """Depths in dioptres for which blind decoders are built."""
        return midpoint_dioptres(self.design_count, self.depth_range)

    def with_border(self, border: Border) -> EdofProtocol:
        """Return the protocol with another border."""
        return replace(self, border=border)

    def with_noise(self, noise: NoiseRange) -> EdofProtocol:
        """Return the protocol with other noise levels."""
        return replace(self, noise=noise)


STRICT = EdofProtocol("strict")
"""Full resolution: 3.45 um pixels, crops of 512 x 512, sRGB values taken as light."""

AUTHORS = EdofProtocol(
    "authors",
    binning=5,
    shortest_edge=2048,
    light="linear",
    scored_in=("linear", "srgb"),
)
"""The published simulation's: binning 5 x 5, pictures resized to 2048 pixels, linear light.

Read in the authors' code, github.com/cgtuebingen/learning_joint_design_optics_processing_edof at
commit 1a6574c, whose fine pitch is 3.07 um, crop 920 pixels, and padding symmetric.
"""
