"""Keep what a camera does to its pictures as it was when the camera was opened.

The names are those of GenICam's "Standard Features Naming Convention" 2.7 (SFNC), and those under
which makers have the same functions.
"""

from __future__ import annotations

import contextlib
import time
from typing import Any

from .camera_control import CameraControl
from .selectors import Selectors

NEUTRAL: dict[str, float | None] = {
    "ExposureAuto": None,
    "GainAuto": None,
    "BlackLevelAuto": None,
    "BalanceWhiteAuto": None,
    "GammaEnable": None,
    "Gamma": 1.0,
    "LUTEnable": None,
    "TestPattern": None,
    "TestImageSelector": None,
    "VideoTestPattern": None,
    "ReverseX": None,
    "ReverseY": None,
    "ImageFlipX": None,
    "ImageFlipY": None,
    "DecimationHorizontal": 1.0,
    "DecimationVertical": 1.0,
    "DigitalShift": 0.0,
    "BlackLevelClampingEnable": None,
    "BlackLevelClampEnable": None,
    "BlackLevelClamp": None,
    "SharpeningEnable": None,
    "SharpnessEnable": None,
    "SharpnessEnhancement": 0.0,
    "SharpnessAuto": None,
    "ColorTransformationEnable": None,
    "ColorEnhancementEnable": None,
    "SaturationEnable": None,
    "HueEnable": None,
    "NoiseReduction": 0.0,
    "NoiseReductionEnable": None,
    "NoiseReductionMode": None,
    "DenoiseEnable": None,
    "DefectCorrectionEnable": None,
    "DefectCorrection": None,
    "DefectCorrectStaticEnable": None,
    "DefectivePixelCorrection": None,
    "DefectPixelCorrectionMode": None,
    "ShadingCorrectionMode": None,
    "ShadingCorrectionEnable": None,
    "FlatFieldCorrectionEnable": None,
    "ContrastEnhancement": 0.0,
    "BslContrastMode": None,
    "BslContrast": 0.0,
    "BslBrightness": 0.0,
    "PgiMode": None,
    "ImageCompressionMode": None,
    "MultiExposureEnable": None,
    "MultiSlopeMode": None,
    "WDREnable": None,
}
"""Features that change pixels, with the number that leaves them as they are; None for "off"."""

WATCHED = (
    *("Gain", "GainRaw", "OffsetX", "OffsetY", "BinningHorizontal", "BinningVertical"),
    *("BinningHorizontalMode", "BinningVerticalMode"),
    *("TriggerMode", "TriggerSource", "BlackLevel", "BlackLevelRaw", "DigitalGain", "AnalogGain"),
    *("BalanceRatio", "AdcBitDepth", "SensorShutterMode", "ConversionGainMode", "HDRMode"),
)
"""Features that must stay as they are, besides those of NEUTRAL and what each frame tells: its size
and its pixel format."""

_CHECK_SECONDS = 0.05
"""Seconds after which a check leaves the rest to the next frame's check. Chosen: a camera answers
within some 0.1 to 0.5 ms, so that a check usually reads all in a few milliseconds."""

_FIRST = 4
"""Features that are read for every frame, however slow the camera is: gain and offsets."""

State = str | float


class CameraState:
    """Set neutral what changes pixels, and compare the features with those at opening."""

    def __init__(self, owner: CameraControl) -> None:
        self._owner = owner
        self._known: dict[str, State] = {}
        self._nodes: dict[str, Any] = {}
        self._next = 0
        self._selectors = Selectors(owner)

    def missing_features(self, names: list[str]) -> list[str]:
        """Return which of these features the camera doesn't have."""
        return [name for name in names if not self._owner.device.get_feature(name)]

    def neutralise(self, kept: list[str]) -> tuple[list[list[str]], list[list[str]]]:
        """Set features so that pixels stay as the sensor gave them.

        kept: features that are left as they are. Returns the features that were changed, and those
        that can't be, each with its old value.
        """
        changed: list[list[str]] = []
        stubborn: list[list[str]] = []
        for name in self._selectors.with_entries(NEUTRAL):
            bare = name.partition("[")[0]
            number = NEUTRAL[bare]
            if {name, bare} & set(kept) or not self._find(name):
                continue
            before = self._read_or_none(name)
            if before is None or _is_neutral(before, number):
                continue
            with contextlib.suppress(Exception):
                self._write(name, number)
            after = self._read_or_none(name)
            done = changed if after is None or _is_neutral(after, number) else stubborn
            done.append([name, _in_words(before)])
        # A gamma or a shift counts only while it is switched on.
        off = self._read_or_none("GammaEnable") == "off" if self._find("GammaEnable") else False
        return changed, [one for one in stubborn if not (off and one[0] == "Gamma")]

    def note_state(self) -> dict[str, str]:
        """Note how the features stand; `changes` compares with them."""
        self._known.clear()
        for name in self._selectors.with_entries((*WATCHED, *NEUTRAL)):
            if self._find(name):
                value = self._read_or_none(name)
                if value is not None:
                    self._known[name] = value
        return {name: _in_words(value) for name, value in self._known.items()}

    def note_features(self, *names: str) -> None:
        """Note features that this program has just changed."""
        for name in names:
            if name in self._known and (value := self._read_or_none(name)) is not None:
                self._known[name] = value

    def changes(self) -> list[list[str]]:
        """Return the features that changed by themselves: name, then and now."""
        late, names = time.monotonic() + _CHECK_SECONDS, list(self._known)
        first = names[:_FIRST]
        rest = names[_FIRST:]
        rest = rest[self._next :] + rest[: self._next]
        found = []
        for number, name in enumerate((*first, *rest)):
            if number >= len(first):
                if time.monotonic() > late:
                    break
                self._next = (self._next + 1) % len(rest)
            known, now = self._known[name], self._read(name)
            if now != known:
                found.append([name, _in_words(known), _in_words(now)])
        return found

    def _find(self, name: str) -> bool:
        device = self._owner.device
        there = False
        with contextlib.suppress(Exception), self._selectors.at_entry(name) as bare:
            node = device.get_feature(bare)
            there = bool(node) and device.is_feature_available(bare)
            if there:
                self._nodes[name] = node
        return there

    def _read_or_none(self, name: str) -> State | None:
        try:
            return self._read(name)
        except Exception:
            return None

    def _read(self, name: str) -> State:
        with self._selectors.at_entry(name) as bare:
            return self._read_shown(bare)

    def _read_shown(self, name: str) -> State:
        aravis, device, node = self._owner.aravis, self._owner.device, self._nodes[name]
        if isinstance(node, aravis.GcBoolean):
            return "on" if device.get_boolean_feature_value(name) else "off"
        if isinstance(node, aravis.GcEnumeration):
            return str(device.get_string_feature_value(name))
        if isinstance(node, aravis.GcFloat):
            return float(f"{device.get_float_feature_value(name):.6g}")
        return float(device.get_integer_feature_value(name))

    def _write(self, name: str, number: float | None) -> None:
        with self._selectors.at_entry(name) as bare:
            self._write_shown(bare, number)

    def _write_shown(self, name: str, number: float | None) -> None:
        aravis, device, node = self._owner.aravis, self._owner.device, self._nodes[name]
        if isinstance(node, aravis.GcBoolean):
            device.set_boolean_feature_value(name, False)
        elif isinstance(node, aravis.GcEnumeration):
            device.set_string_feature_value(name, "Off")
        elif isinstance(node, aravis.GcFloat):
            device.set_float_feature_value(name, number or 0.0)
        else:
            device.set_integer_feature_value(name, int(number or 0))


def _is_neutral(value: State, number: float | None) -> bool:
    if isinstance(value, str):
        return value.lower() in ("off", "none", "false")
    return value == (number or 0.0)


def _in_words(value: State) -> str:
    return value if isinstance(value, str) else f"{value:g}"
