"""Check and set what a graphics card does to a picture between its memory and the panel.

The memory can be read back, but not what is sent: gamma ramp and the connector's properties decide
about that. They are read when a pattern is shown, and compared with that after each exposure.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.screen.display_checks import gamma_ramp_error
from drivers.screen.signal_rules import SignalRule, is_plain, rule_of
from drivers.x11 import XConnection
from drivers.x11.output_properties import OutputProperties, OutputProperty, Value
from drivers.x11.outputs import Output, read_gamma_ramp
from drivers.x11.power import is_switched_off, switch_on

_IGNORED = (
    r"edid|backlight|protection|hdcp|dpms|desktop|_mm$|tile|audio|_id$|guid|connector|location|"
    r"tearfree|prime|modes$|coherent|suggested|subconnector"
)
"""Names of properties, in lower case, whose changes don't matter to the picture."""


class SignalPath:
    """Keep the way from the graphics card's memory to the SLM free of what alters grey levels.

    model: the device's name in errors. allow_ramp: whether the gamma ramp may alter levels.
    allowed: names of properties that may, and are left as they are. `notes` holds what was set and
    hasn't been told yet, `settings` what was set by the property's name.
    """

    def __init__(
        self, model: str, x: XConnection, output: Output, allow_ramp: bool, allowed: Iterable[str]
    ) -> None:
        self._model, self._x, self._output = model, x, output
        self._allow_ramp = allow_ramp
        self._allowed = {name.casefold() for name in allowed}
        self._properties = OutputProperties(x, output.number)
        self._standing: dict[str, OutputProperty] = {}
        self._ramp: NDArray[np.uint16] = np.zeros((3, 0), np.uint16)
        self._at_first = self._properties.read()
        self.settings: dict[str, str] = {}
        self._fault = ""
        self.has_linear_ramp = True
        self.notes: list[str] = []

    def prepare(self, command: str) -> bool:
        """Set the connector's properties that alter grey levels; DeviceError if refused.

        Returns whether any was set, after which a panel may be dark for a moment.
        """
        self._require_plain_ramp(command)
        was_off = is_switched_off(self._x)
        if was_off:
            switch_on(self._x)
            self.notes.append("the screen was switched off to save power, and is switched on")
        altering = self._altering(self._properties.read(anew=True))
        for given, rule in altering:
            wanted = rule.plain_value(given)
            if wanted is None or given.is_immutable or not self._properties.change(given, wanted):
                raise self._property_error(command, given, rule)
            step = _step(given.value, wanted)
            note = f"{given.name} is set{step}: as it was, {rule.effect}"
            self.settings[given.name] = note
            self.notes.append(note)
        return was_off or bool(altering)

    def begin(self, command: str) -> None:
        """Note how the picture is sent from now on; DeviceError if its levels are altered."""
        self._fault = ""
        self._ramp = self._require_plain_ramp(command)
        self._standing = self._properties.read()
        for given, rule in self._altering(self._standing):
            raise self._property_error(command, given, rule)

    def note_changes(self, atoms: Iterable[int]) -> None:
        """Note properties that the X server reported as set by somebody."""
        for name in map(self._properties.name, atoms):
            if rule_of(name) is not None and not self._fault:
                self._fault = f"{name} was set by another program"

    def look_at_ramp(self) -> None:
        """Note whether the gamma ramp is as it was, which is soon read."""
        ramp = read_gamma_ramp(self._x, self._output.crtc)
        if not np.array_equal(ramp, self._ramp):
            self._fault = self._fault or _describe_ramp(ramp)

    def look(self) -> None:
        """Note whether the picture is still sent as it was when it was shown."""
        ramp, now = read_gamma_ramp(self._x, self._output.crtc), self._properties.read()
        found = [] if np.array_equal(ramp, self._ramp) else [_describe_ramp(ramp)]
        if is_switched_off(self._x):
            found.append("the screen was switched off to save power")
        for name in sorted(self._standing.keys() | now.keys()):
            if not re.search(_IGNORED, name.casefold()):
                found.append(_describe_change(self._standing.get(name), now.get(name)))
        self._fault = "; ".join(filter(None, found)) or self._fault

    def require_unchanged(self, command: str) -> None:
        """Raise DeviceError if anything has changed since the picture was shown."""
        self.look()
        if self._fault:
            reply = f"{self._fault}, while the pattern was shown on {self._output.name}"
            remedy = (
                "Show the pattern again, which sets right what may be set; switch off what changes "
                "the screen (night light, colour profiles, display settings)"
            )
            raise DeviceError(self._model, command, reply, remedy)

    def follow(self, output: Output) -> None:
        """Go on after the SLM moved, perhaps to another connector."""
        if output.number != self._output.number:
            self.restore()
            self._properties = OutputProperties(self._x, output.number)
            self._at_first, self.settings = self._properties.read(), {}
        self._output = output

    def restore(self) -> None:
        """Give the connector its old properties back, unless others have set them since."""
        now = self._properties.read()
        for name in self.settings.keys() & self._at_first.keys() & now.keys():
            seen, first, rule = now[name], self._at_first[name], rule_of(name)
            if rule is not None and is_plain(seen, rule) and seen.value != first.value:
                self._properties.change(seen, first.value)

    def describe(self) -> str:
        """Describe the known properties of the connector."""
        known = [p for p in self._standing.values() if rule_of(p.name) is not None]
        words = [f"{p.name} {_words(p.value)}" for p in known] or ["no known properties"]
        if self._x.has("NV-CONTROL"):
            words.append("colour range, dithering and vibrance: see nvidia-settings")
        return ", ".join(words)

    def _altering(
        self, found: dict[str, OutputProperty]
    ) -> list[tuple[OutputProperty, SignalRule]]:
        """Return the properties that alter grey levels and aren't allowed to."""
        pairs = ((given, rule_of(given.name)) for given in found.values())
        return [
            (given, rule)
            for given, rule in pairs
            if rule is not None
            and given.name.casefold() not in self._allowed
            and not is_plain(given, rule)
        ]

    def _require_plain_ramp(self, command: str) -> NDArray[np.uint16]:
        """Read the gamma ramp; DeviceError if it alters levels and may not."""
        found = read_gamma_ramp(self._x, self._output.crtc)
        # A virtual screen is sent to no monitor, so the X server leaves its ramp empty.
        is_virtual = not self._output.refresh and not found.any()
        changed = "" if is_virtual else gamma_ramp_error(found)
        if changed and not self._allow_ramp:
            remedy = (
                f"Switch night light and colour profiles off, then xrandr --output "
                f"{self._output.name} --gamma 1 --brightness 1; or write allow_ramp = true"
            )
            raise DeviceError(self._model, command, changed, remedy)
        self.has_linear_ramp = not changed
        return found

    def _property_error(self, command: str, given: OutputProperty, rule: SignalRule) -> DeviceError:
        name, output = given.name, self._output.name
        wanted = rule.plain_value(given)
        reply = f"{output} has {name} at {_words(given.value)}: {rule.effect}"
        if given.is_immutable or wanted is None:
            remedy = "It can't be set here: use another connector, or the driver's own settings"
        else:
            value = wanted if isinstance(wanted, str) else ",".join(map(str, wanted))
            remedy = f"xrandr --output {output} --set '{name}' '{value}'"
        remedy += f'; or write allow_properties = ["{name}"] to have it left as it is'
        return DeviceError(self._model, command, reply, remedy)


def _describe_ramp(ramp: NDArray[np.uint16]) -> str:
    return gamma_ramp_error(ramp) or "the screen's gamma ramp changed"


def _describe_change(before: OutputProperty | None, after: OutputProperty | None) -> str:
    """Describe how a property changed; empty if it didn't."""
    one = after or before
    if one is None or (before and after and before.value == after.value):
        return ""
    step = _step(before.value if before else "absent", after.value if after else "absent")
    rule = rule_of(one.name)
    if rule is None:
        effect = "what it does isn't known"
    else:
        effect = "" if is_plain(one, rule) else rule.effect
    return f"{one.name} changed{step}" + (f" ({effect})" if effect else "")


def _step(before: Value, after: Value) -> str:
    """Describe the step from one value to another; empty if both read the same."""
    was, now = _words(before), _words(after)
    return "" if was == now else f" from {was} to {now}"


def _words(value: Value) -> str:
    """Return a property's value in words; a matrix or table isn't written out."""
    if isinstance(value, str):
        return value
    return " ".join(map(str, value)) if len(value) <= 4 else f"{len(value)} numbers"
