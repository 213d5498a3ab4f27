"""Check the options before the camera is opened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from drivers.aravis.pixel_formats import FORMATS, ByteOrder, Justification
from drivers.option_checks import is_number

Trigger = Literal["software", "hardware", "free"]


@dataclass(frozen=True)
class AravisOptions:
    """The options of AravisCamera, which explains them; ValueError for an invalid one."""

    address: str
    pixel_format: str
    gain_db: float
    roi: Sequence[int]
    binning: Sequence[int]
    trigger: Trigger
    trigger_line: str
    frame_rate: float
    packet_size: int
    buffers: int
    latency_frames: int | None
    frame_timeout_ms: float
    trigger_wait_s: float
    electrons_per_number: float
    byte_order: ByteOrder | Literal[""] = ""
    justification: Justification | Literal[""] = ""
    keep_features: Sequence[str] = ()
    average_binned: bool = False
    """Whether binned pixels are averaged, as plans have them; no option of the bench file."""

    def __post_init__(self) -> None:
        _require(isinstance(self.address, str), "address", self.address, "a text")
        names = ", ".join(FORMATS)
        known = not self.pixel_format or self.pixel_format in FORMATS
        _require(known, "pixel_format", self.pixel_format, f"one of {names}, or empty")
        _require(is_number(self.gain_db), "gain_db", self.gain_db, "a number of decibels")
        whole = _are_integers_from(self.roi, 0) and len(self.roi) in (0, 4)
        if whole and len(self.roi) == 4:
            whole = self.roi[2] > 0 and self.roi[3] > 0
        _require(whole, "roi", self.roi, "[x, y, width, height] in pixels, or empty")
        fits = len(self.binning) == 2 and _are_integers_from(self.binning, 1)
        _require(fits, "binning", self.binning, "[across, down], 1 at least")
        kinds = get_args(Trigger)
        _require(self.trigger in kinds, "trigger", self.trigger, f"one of {', '.join(kinds)}")
        rate = is_number(self.frame_rate) and self.frame_rate >= 0
        _require(rate, "frame_rate", self.frame_rate, "frames a second, or 0 for the camera's own")
        packet = _are_integers_from([self.packet_size], 0) and (
            self.packet_size == 0 or 576 <= self.packet_size <= 65000
        )
        _require(packet, "packet_size", self.packet_size, "576 to 65000 bytes, or 0")
        _require(_are_integers_from([self.buffers], 2), "buffers", self.buffers, "2 at least")
        latency = self.latency_frames is None or _are_integers_from([self.latency_frames], 0)
        _require(latency, "latency_frames", self.latency_frames, "a number of frames")
        for name in ("frame_timeout_ms", "trigger_wait_s", "electrons_per_number"):
            value = getattr(self, name)
            _require(is_number(value) and value > 0, name, value, "positive and finite")
        for name, words in (
            ("byte_order", get_args(ByteOrder)),
            ("justification", get_args(Justification)),
        ):
            value = getattr(self, name)
            _require(value in ("", *words), name, value, f"{words[0]}, {words[1]}, or empty")
        kept = self.keep_features
        texts = not isinstance(kept, str) and all(isinstance(one, str) for one in kept)
        _require(texts, "keep_features", kept, "a list of the camera's features")


def _are_integers_from(values: Sequence[int], least: int) -> bool:
    return not isinstance(values, str) and all(
        isinstance(v, int) and not isinstance(v, bool) and v >= least for v in values
    )


def _require(good: bool, name: str, value: object, words: str) -> None:
    if not good:
        raise ValueError(f"{name} is {value!r}; it must be {words}")
