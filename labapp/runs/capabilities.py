"""The capabilities of a bench on which a plan depends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from labapp.common.frame_delays import FrameDelays
from labapp.runs.bench_interface import Bench


@dataclass(frozen=True)
class BenchCapabilities:
    """What a bench can do, read once from its devices.

    Lengths are in metres, times in seconds, and shapes (rows, columns).

    by_hand: whether a person places the targets.
    slots: wavelengths of a filter wheel's slots; empty for a tunable filter.
    video_frame: time for which the SLM shows a frame of a video.
    readout: time from the end of an exposure to the picture.
    target_settling, slm_settling, filter_settling: settling time of each device.
    flicker_period: period of the lamp's flicker; None if the bench file doesn't tell it.
    delays: what frames take beyond these times; nothing unless it was measured.
    full_scale: digital number at which a pixel counts as clipped; 0 if it isn't known.
    gain_db: gain with which the bench opens the camera, decibels.
    gain_range: gains that a plan may set, decibels; None if it may set none.
    has_regions: whether a plan may choose regions and binnings.
    mosaic: rows and columns after which the sensor's colour filters repeat; (1, 1) without any.
    """

    targets: tuple[str, ...]
    by_hand: bool
    wavelength_range: tuple[float, float]
    slots: tuple[float, ...]
    exposure_range: tuple[float, float]
    frame_shape: tuple[int, int]
    panel_shape: tuple[int, int]
    video_frame: float
    readout: float
    target_settling: float
    slm_settling: float
    filter_settling: float
    flicker_period: float | None = None
    delays: FrameDelays = field(default_factory=FrameDelays)
    full_scale: int = 0
    gain_db: float = 0.0
    gain_range: tuple[float, float] | None = None
    has_regions: bool = False
    mosaic: tuple[int, int] = (1, 1)

    @staticmethod
    def of(bench: Bench) -> BenchCapabilities:
        wheel, colour = bench.wheel, bench.description.sensor.colour
        return BenchCapabilities(
            targets=bench.targets.names,
            by_hand=bench.targets.by_hand,
            wavelength_range=bench.filter.wavelength_range,
            slots=tuple(slot.wavelength for slot in wheel.slots) if wheel else (),
            exposure_range=bench.camera.exposure_range,
            frame_shape=bench.camera.shape,
            panel_shape=bench.slm.shape,
            video_frame=bench.slm.frame_time,
            readout=bench.camera.frame_time,
            target_settling=bench.targets.settling,
            slm_settling=bench.slm.settling,
            filter_settling=bench.filter.settling,
            flicker_period=1 / bench.file.flicker_hz if bench.file.flicker_hz else None,
            delays=bench.frame_delays or FrameDelays(),
            full_scale=bench.camera.full_scale,
            has_regions=hasattr(bench.camera, "set_region"),
            mosaic=(len(colour.pattern), len(colour.pattern[0])) if colour else (1, 1),
            **_gain(bench.camera),
        )

    @staticmethod
    def of_data(data: Mapping[str, Any]) -> BenchCapabilities:
        """Rebuild capabilities from plain data, whose tuples may have become lists."""
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in data.items()
        }
        delays = FrameDelays(**values.pop("delays", {}))
        return BenchCapabilities(**values, delays=delays)

    def wavelength_in_metres(self, nm: float) -> float:
        """Convert a wavelength from nanometres to metres, rounded to picometres.

        A value at an end of the filter's range becomes exactly that end. 400e3 * 1e-12 and
        400 * 1e-9 differ in the last bit, and a filter from 400 nm on refuses the smaller one.
        """
        asked = round(nm * 1e3) * 1e-12
        ends = (end for end in self.wavelength_range if abs(end - asked) < 0.5e-12)
        return next(ends, asked)


def _gain(camera: Any) -> dict[str, Any]:
    """Return gain_db and gain_range of a camera whose gain a plan may set; else nothing."""
    limits = getattr(camera, "gain_range", None) if hasattr(camera, "set_gain") else None
    return {} if limits is None else {"gain_db": float(camera.gain_db), "gain_range": tuple(limits)}
