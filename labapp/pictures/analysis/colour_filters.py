"""Colour filters of a sensor: how bands are told apart behind them, and shown on a screen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.picture.photograph import Light
from labapp.pictures.analysis.brackets import Bracket
from labapp.pictures.colour_matrix import linear_srgb, linear_srgb_matrix, white_balance
from labapp.runs.record.reader import Record
from optics.inverse import build_mosaic_observation, demosaic
from optics.inverse.blur import Border
from optics.inverse.mosaics import MosaicObservation
from optics.sensor.sensor import Mosaic

_TUNABLE_BANDWIDTH = 10e-9
"""Bandwidth in metres of a tunable filter whose options don't state it."""

_LEAST_GAIN = 0.01
"""Light of a channel, over that of the brightest one, from which it can be restored."""


_GREY_REMEDY = (
    "Restore it as one grey band: --grey, or grey = true in the plan's [reconstruct] table."
)


@dataclass(frozen=True, eq=False)
class ColourFilters:
    """The mosaic of colour filters in front of a sensor.

    pattern: rows of a letter for each pixel, which repeat from the first pixel on.
    channels: the letters, each once, in the order of the bands.
    gains: (channels,), light of a white surface in each channel, over that of the brightest one.
    matrix: (3, channels), from the bands, in which white is equal, to linear sRGB; None for grey.
    passband: wavelengths in metres between which light was let through; None for all visible light.
    is_grey: whether the scene is taken for one band, which all filters see alike but for their
        gains. Otherwise each channel is a band.
    """

    pattern: tuple[str, ...]
    channels: str
    gains: NDArray[np.float64]
    matrix: NDArray[np.float64] | None = None
    passband: tuple[float, float] | None = None
    is_grey: bool = False

    def __post_init__(self) -> None:
        faint = [
            f"{name} {gain:.1%}".replace("%", " %")
            for name, gain in zip(self.channels, self.gains, strict=True)
            if gain < _LEAST_GAIN
        ]
        if faint and not self.is_grey:
            raise UserError(
                f"the light is of one colour: of the brightest channel's, {' and '.join(faint)} "
                f"see hardly any. {_GREY_REMEDY}"
            )

    @property
    def period(self) -> tuple[int, int]:
        """Return the (rows, columns) after which the filters repeat."""
        return len(self.pattern), len(self.pattern[0])

    @property
    def response(self) -> NDArray[np.float64]:
        """Return the share of each band that each channel sees, (channels, bands)."""
        return self.gains[:, None] if self.is_grey else np.diag(self.gains)

    def channel_map(self, shape: tuple[int, int]) -> NDArray[np.intp]:
        """Return the index in `channels` of each pixel's filter, (rows, columns)."""
        cell = np.array([[self.channels.index(letter) for letter in row] for row in self.pattern])
        down, along = (-(-n // m) for n, m in zip(shape, cell.shape, strict=True))
        return np.tile(cell, (down, along))[: shape[0], : shape[1]]

    def to_screen(self, light: Light) -> Light:
        """Convert bands to linear sRGB, (3, rows, columns); grey stays grey."""
        return light if self.matrix is None else linear_srgb(light, self.matrix)

    def separate(
        self, rate: NDArray[np.floating], noise: float | None, clipped: NDArray[np.bool_]
    ) -> Light:
        """Estimate the bands of each pixel, without undoing any blur.

        `rate` is (rows, columns), NaN where a pixel is dead.
        """
        point = np.ones((1, 1), dtype=np.float32)
        bands: Light = demosaic(self.observation(rate, point, noise, "unknown", clipped))
        return bands

    def observation(
        self,
        rate: NDArray[np.floating],
        psf: Light,
        noise: float | None,
        border: Border,
        clipped: NDArray[np.bool_],
    ) -> MosaicObservation:
        """Build the observation from which all bands are restored together.

        `rate` is (rows, columns), NaN where a pixel is dead.
        """
        sound = np.isfinite(rate)
        return build_mosaic_observation(
            np.where(sound, rate, 0).astype(np.float32),
            self.pattern,
            psf,
            channels=self.channels,
            response=self.response,
            noise=noise,
            border=border,
            weights=None if sound.all() else sound.astype(np.float32),
            clipped=clipped if clipped.any() else None,
        )


def _build_filters(
    mosaic: Mosaic,
    gains: NDArray[np.float64],
    passband: tuple[float, float] | None,
    is_grey: bool,
) -> ColourFilters:
    """Build colour filters, with their matrix, from a sensor's spectral curves.

    Raises UserError for light in which colours can't be told apart.
    """
    channels = "".join(mosaic.channels)
    filters = ColourFilters(mosaic.pattern, channels, gains, None, passband, is_grey)
    if is_grey:
        return filters
    try:
        return replace(filters, matrix=linear_srgb_matrix(mosaic, None, passband))
    except ValueError as error:
        raise UserError(f"{str(error).rstrip('.')}. {_GREY_REMEDY}") from error


def star_filters(record: Record, star: Bracket, is_grey: bool) -> ColourFilters | None:
    """Return a record's colour filters with gains that its star, taken for white, shows.

    None for a sensor without filters.
    """
    mosaic = record.camera.sensor.colour
    if mosaic is None:
        return None
    which = mosaic.channel_map(star.rate.shape).numpy()
    means = np.array([star.rate[which == k].mean() for k in range(len(mosaic.channels))])
    if not means.max() > 0:
        raise UserError(f"{record.path}: the star's frames are dark. Expose them longer.")
    gains = np.clip(means / means.max(), 1e-6, None)
    return _build_filters(mosaic, gains, passband_at(record, star.wavelength), is_grey)


def described_filters(record: Record, picture: Bracket, is_grey: bool) -> ColourFilters | None:
    """Return a record's colour filters with gains as described; None for a sensor without any."""
    mosaic = record.camera.sensor.colour
    if mosaic is None:
        return None
    band = passband_at(record, picture.wavelength)
    return _build_filters(mosaic, white_balance(mosaic, None, band), band, is_grey)


def passband_at(record: Record, wavelength: float) -> tuple[float, float] | None:
    """Return the wavelengths between which the bench's filter, set to one, lets light through.

    They are in metres; None for a wheel without a slot of known bandwidth there. A filter that the
    bench doesn't describe is taken to be tunable.
    """
    table = record.bench.devices.tables.get("filter")
    options = {} if table is None else dict(table.options)
    if "slots_nm" in options:
        centre = wavelength * 1e9
        widths = [width for slot, width in options["slots_nm"] if abs(slot - centre) < 1e-2]
        # Two slots may share their centre; the widest is the one for colours.
        half = max(widths, default=0.0) * 1e-9 / 2
    else:
        half = options.get("bandwidth_nm", _TUNABLE_BANDWIDTH * 1e9) * 1e-9 / 2
    return (wavelength - half, wavelength + half) if half else None
