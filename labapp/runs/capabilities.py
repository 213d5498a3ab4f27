"""What a bench can do, as far as a plan depends on it."""

from __future__ import annotations

from dataclasses import dataclass

from labapp.runs.bench_interface import Bench


@dataclass(frozen=True)
class BenchCapabilities:
    """Read from the devices once. Metres and seconds; shapes are (rows, columns).

    slots: wavelengths of a filter wheel's slots, empty for a tunable filter. by_hand:
    whether a person places the targets. video_frame: seconds that a frame of a video stands.
    readout: from the end of an exposure to a picture. *_settling: until a new setting stands.
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

    @staticmethod
    def of(bench: Bench) -> BenchCapabilities:
        wheel = bench.wheel
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
        )

    def wavelength_in_metres(self, nm: float) -> float:
        """A wavelength as a plan writes it: whole picometres, or exactly an end of the range.

        400e3 * 1e-12 and 400 * 1e-9 differ in the last bit, and a filter from 400 nm on
        refuses the smaller one.
        """
        asked = round(nm * 1e3) * 1e-12
        ends = (end for end in self.wavelength_range if abs(end - asked) < 0.5e-12)
        return next(ends, asked)
