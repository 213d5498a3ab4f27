"""What the known properties of connectors do to grey levels, and which values do nothing.

The names and values are those that the kernel's drivers expose to X11, which keeps the names:
Linux, drivers/gpu/drm/drm_connector.c (scaling mode, max bpc, Colorspace, content type, TV's
margins, contrast and so on), i915 (Broadcast RGB), amdgpu and radeon (dither, underscan,
output_csc, abm level, freesync), nouveau (dithering mode and depth, vibrant hue, color vibrance)
and rockchip (hdmi_quant_range, color_format); CTM and the lookup tables of the X drivers
modesetting and amdgpu; and CscMatrix in the README of NVIDIA's driver. The names are matched by
patterns, because drivers spell them differently.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.screen.display_checks import gamma_ramp_error
from drivers.x11.output_properties import OutputProperty, Value

PlainValue = Callable[[OutputProperty], Value | None]
"""Returns the value at which a property leaves grey levels unaltered: its own value if it does so
already, and None if none is known or allowed."""


@dataclass(frozen=True)
class SignalRule:
    """What a kind of property does to a picture, and at which value it does nothing.

    names: regular expression that finds the property's name, in lower case.
    """

    names: str
    effect: str
    plain_value: PlainValue


def _choice(*plain: str) -> PlainValue:
    """Return the rule of a property that does nothing at some words or integers, the best first."""

    def plain_value(given: OutputProperty) -> Value | None:
        if _simplify(given.value) in plain:
            return given.value
        for word in plain:
            for allowed in given.valid:
                if isinstance(allowed, str) and _simplify(allowed) == word:
                    return allowed
            if not isinstance(given.value, str) and word.isdigit() and given.allows(int(word)):
                return (int(word),) * len(given.value)
        return None

    return plain_value


def _at_least(least: int) -> PlainValue:
    """Return the rule of a property that does nothing from some integer on."""

    def plain_value(given: OutputProperty) -> Value | None:
        words = given.value if isinstance(given.value, str) else str(*given.value[:1])
        number = re.search(r"\d+", words)
        if number is None or int(number[0]) >= least:
            # A word without a number, such as "auto", leaves the choice to the driver.
            return given.value
        for allowed in given.valid:
            found = re.search(r"\d+", str(allowed))
            if isinstance(allowed, str) and found is not None and int(found[0]) >= least:
                return allowed
        return (least,) if not isinstance(given.value, str) and given.allows(least) else None

    return plain_value


def _middle(given: OutputProperty) -> Value | None:
    """Return the middle of what a property takes, where drivers put "unchanged" by convention.

    Without such a range, only 0 counts as unchanged.
    """
    if isinstance(given.value, str):
        return None
    numbers = [one for one in given.valid if isinstance(one, int)]
    if len(numbers) < 2:
        return None if any(given.value) else given.value
    ends = min(numbers) + max(numbers)
    # The middle of -1024 to 1023 is 0.
    return given.value if abs(2 * given.value[0] - ends) <= 1 else (int(ends / 2),)


def _matrix(given: OutputProperty) -> Value | None:
    """Return the identity in the layout of a property that is a matrix of colours.

    CTM has nine numbers of sign and magnitude with 32 binary places, as 18 words from the lowest
    on; CscMatrix has three rows of four numbers with 16 binary places. Of other fixed points, only
    identities are known: a power of two in the diagonal.
    """
    value = given.value
    if isinstance(value, str) or not any(value):
        return value
    if len(value) == 18:
        # Minus zero is zero, too.
        low, high = value[::2], (0 if word == -(1 << 31) else word for word in value[1::2])
        plain: tuple[int, ...] = (0, 1, 0, 0, 0, 0, 0, 0) * 2 + (0, 1)
        return value if (*low, *high) == (*plain[::2], *plain[1::2]) else plain
    columns = len(value) // 3
    one = value[0]
    plain = ((one, *(0,) * columns) * 3)[: len(value)]
    if len(value) in (9, 12) and value == plain and one > 0 and one & one - 1 == 0:
        return value
    return ((1 << 16, 0, 0, 0, 0) * 3)[:12] if len(value) == 12 else None


def _table(given: OutputProperty) -> Value | None:
    """Return the value of a lookup table if it is a straight line; else None.

    The colours are interleaved: red, green and blue, and perhaps a reserved word.
    """
    value = given.value
    if isinstance(value, str) or len(value) < 2 or not any(value):
        return value
    words = np.array(value, np.int64) & 0xFFFF
    for columns in (3, 4):
        if words.size % columns == 0:
            ramp = words.reshape(-1, columns)[:, :3].T.astype(np.uint16)
            if not gamma_ramp_error(ramp):
                return value
    return None


_SQUEEZED = "levels are squeezed into 16 to 235, always or in television modes such as 1920x1080"

_RULES = (
    SignalRule(r"broadcast.?rgb|quant.*range|(rgb|colou?r).?range", _SQUEEZED, _choice("full")),
    SignalRule(
        r"output.?csc|colou?r.?(format|encoding)|pixel.?encoding|output.?format",
        "colours are converted by a matrix and rounded again",
        _choice("bypass", "rgb", "rgb444", "outputrgb", "none"),
    ),
    SignalRule(
        r"colou?r.?space|hdr.?(output|metadata)",
        "the monitor is told to map colours from another colour space",
        _choice("default", "rgb", "srgb", "0"),
    ),
    SignalRule(r"\bctm\b|csc.?matrix|colou?r.?matrix", "colours are mixed by a matrix", _matrix),
    SignalRule(
        r"lut.?size|capable", "it says what the connector can do", lambda given: given.value
    ),
    SignalRule(r"gamma|\blut\b", "levels pass through another lookup table", _table),
    SignalRule(
        r"\bbpc\b|dither.*depth|colou?r.?depth", "a colour has fewer than 8 bits", _at_least(8)
    ),
    SignalRule(
        r"dither", "levels are dithered, so that pixels flicker", _choice("off", "none", "0")
    ),
    SignalRule(
        r"(under|over).?scan|margin|\bborder\b",
        "the picture is shrunk or cut by scaling, or set into a border",
        _choice("off", "none", "0"),
    ),
    SignalRule(
        r"scaling|scaler",
        "a picture of another size than the panel's is scaled",
        _choice("none", "center", "noscale", "nongpu", "off", "0"),
    ),
    SignalRule(
        r"vrr|free.?sync|variable.?refresh|adaptive.?sync|g-?sync",
        "refreshes come whenever something is drawn, so that levels sag and videos lose their rate",
        _choice("off", "disabled", "0"),
    ),
    SignalRule(
        r"\babm\b|power.?sav|content.?adaptive|dynamic.?contrast",
        "levels are changed with the picture to save power",
        _choice("requirecoloraccuracy", "forbidden", "off", "0"),
    ),
    SignalRule(
        r"content.?type",
        "the monitor is told to process the picture",
        _choice("graphics", "nodata", "game"),
    ),
    SignalRule(r"colou?r.?vibrance", "colours are made paler or more vivid", _choice("150")),
    SignalRule(
        r"vibran|saturation|\bhue\b|\btint\b|contrast|brightness",
        "colours and levels are adjusted as on a television set",
        _middle,
    ),
    SignalRule(
        r"sharp|flicker.?reduction|(luma|chroma).?filter|noise.?reduction|3d.?lut|denoise",
        "pixels are mixed with their neighbours",
        _choice("off", "none", "0"),
    ),
    SignalRule(r"link.?status", "the link to the monitor failed", _choice("good")),
)
"""The first rule that fits a property's name holds, so that "dithering depth" is a depth. nouveau's
"color vibrance" v does nothing at 150 of 0 to 200, where its gain (v - 100) / 50 is 1."""


def rule_of(name: str) -> SignalRule | None:
    """Return what is known of a property by its name; None if nothing is."""
    lowered = name.casefold().replace("_", " ")
    return next((rule for rule in _RULES if re.search(rule.names, lowered)), None)


def is_plain(given: OutputProperty, rule: SignalRule) -> bool:
    """Return whether a property's value leaves grey levels unaltered."""
    return given.value == () or rule.plain_value(given) == given.value


def _simplify(value: Value) -> str:
    """Return a value without case, spaces and signs between words."""
    if isinstance(value, str):
        return re.sub(r"[^a-z0-9]", "", value.casefold())
    return " ".join(map(str, value)) if any(value) else "0"
