"""The capabilities of a bench on which a plan depends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from labapp.common.frame_delays import FrameDelays
from labapp.runs.bench_interface import Bench


@dataclass(frozen=True)
class BenchCapabilities:
    """The capabilities of a bench, read once from its devices.

    Lengths are in metres, times in seconds, and shapes (rows, columns).

    Attributes
    ----------
    by_hand : bool
        Whether a person places the targets.
    slots : tuple of float
        Wavelengths of a filter wheel's slots; empty for a tunable filter.
    video_frame : float
        Time for which the SLM shows a frame of a video.
    readout : float
        Time from the end of an exposure to the picture.
    target_settling, slm_settling, filter_settling : float
        Settling time of each device.
    flicker_period : float, optional
        Period of the lamp's flicker, if the bench file tells it.
    delays : FrameDelays
        What frames take beyond these times; nothing unless it was measured.
    full_scale : int
        Digital number at which a pixel counts as clipped; 0 if it isn't known.
    gain_db : float
        Gain in decibels with which the bench opens the camera.
    gain_range : tuple of float, optional
        Gains in decibels that a plan may set; None if it may set none.
    has_regions : bool
        Whether a plan may choose regions and binnings.
    mosaic : tuple of int
        Rows and columns after which the sensor's colour filters repeat; (1, 1) without any.
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
        """Return what was written as plain data, whose tuples may have become lists."""
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in data.items()
        }
        delays = FrameDelays(**values.pop("delays", {}))
        return BenchCapabilities(**values, delays=delays)

    def wavelength_in_metres(self, nm: float) -> float:
        """Convert a wavelength in a run's plan from nanometres to metres, rounded to picometres.

        A value at an end of the filter's range becomes exactly that end. 400e3 * 1e-12 and
        400 * 1e-9 differ in the last bit, and a filter from 400 nm on refuses the smaller one.
        """
        asked = round(nm * 1e3) * 1e-12
        ends = (end for end in self.wavelength_range if abs(end - asked) < 0.5e-12)
        return next(ends, asked)


def _gain(camera: Any) -> dict[str, Any]:
    """Return the gain of a bench's camera that a plan may set, as capabilities."""
    limits = getattr(camera, "gain_range", None) if hasattr(camera, "set_gain") else None
    return {} if limits is None else {"gain_db": float(camera.gain_db), "gain_range": tuple(limits)}
