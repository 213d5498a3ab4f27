"""Features that exist several times, behind a selector, as the gain of each tap.

One behind another entry than the selector shows is named with that entry, as
"TestPattern[ImageProcessor]". The selector is put back after each use.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator

from .camera_control import CameraControl

SELECTORS: dict[str, tuple[str, ...]] = {
    "TestPatternGeneratorSelector": ("TestPattern",),
    "GainSelector": ("Gain", "GainRaw", "GainAuto"),
    "BlackLevelSelector": ("BlackLevel", "BlackLevelRaw", "BlackLevelAuto"),
    "LUTSelector": ("LUTEnable",),
    "ColorTransformationSelector": ("ColorTransformationEnable",),
    "BalanceRatioSelector": ("BalanceRatio",),
}
"""Selectors and what lies behind them, by GenICam's SFNC 2.7."""

_SELECTOR_OF = {name: one for one, names in SELECTORS.items() for name in names}


class Selectors:
    """Go through the entries of a camera's selectors."""

    def __init__(self, owner: CameraControl) -> None:
        self._owner = owner

    def with_entries(self, names: Iterable[str]) -> Iterator[str]:
        """Yield features, each with those behind its selector's entries."""
        for name in names:
            yield name
            if selector := _SELECTOR_OF.get(name):
                yield from (f"{name}[{entry}]" for entry in self._other_entries(selector))

    @contextlib.contextmanager
    def at_entry(self, name: str) -> Iterator[str]:
        """Have the camera show a feature's entry, if it names one, and give the bare name."""
        bare, _, entry = name.removesuffix("]").partition("[")
        if not entry:
            yield name
            return
        device, selector = self._owner.device, _SELECTOR_OF[bare]
        before = device.get_string_feature_value(selector)
        device.set_string_feature_value(selector, entry)
        try:
            if device.get_string_feature_value(selector) != entry:
                raise ValueError(f"{selector} can't be set to {entry}")
            yield bare
        finally:
            device.set_string_feature_value(selector, before)

    def _other_entries(self, selector: str) -> list[str]:
        device = self._owner.device
        with contextlib.suppress(Exception):
            if device.get_feature(selector) and device.is_feature_available(selector):
                now = device.get_string_feature_value(selector)
                every = device.dup_available_enumeration_feature_values_as_strings(selector)
                return [one for one in every if one != now]
        return []
