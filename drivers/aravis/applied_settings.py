"""Apply the options to an open camera, and read each setting back."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

from drivers.aravis.acquisition import REPLY_TIMEOUT
from drivers.aravis.camera_options import AravisOptions
from drivers.aravis.library_process import AravisProcess
from drivers.aravis.pixel_formats import FORMATS, PixelFormat
from drivers.errors import DeviceError
from drivers.interfaces import Identity

log = logging.getLogger(__name__)

SETTING_TOLERANCE = 0.1
"""Share by which a camera may miss a requested exposure or frame rate.

Cameras count exposures in sensor lines or microseconds.
"""


class AppliedSettings:
    """Apply the options to a camera that has just been opened, and keep what it reads back.

    DeviceError if the camera can't be set so.

    previous: the settings from before the camera was lost, if it was; it must be the same camera.
    gain, packet_size: as the camera reads them back, in decibels and bytes. reports_exposure:
    whether the camera reports the exposure of each frame. turned_off: the features that changed
    pixels until they were set neutral, with their old values.
    """

    def __init__(
        self, link: AravisProcess, options: AravisOptions, previous: AppliedSettings | None
    ) -> None:
        self.link, self._options = link, options
        self.facts: dict[str, Any] = self._ask("facts")
        if previous is not None and previous.identity.serial != self.identity.serial:
            told, known = self.identity.serial, previous.identity.serial
            reply = f"it has serial number {told}, not {known}"
            raise self._error("open", reply, "Plug the right one in, or open the bench again")
        link.model = self.identity.model
        self.turned_off = self._neutralise()
        self.pixel_format = self._set_format()
        self._set_binning()
        self.region = self._set_region()
        self.gain = 0.0
        self.set_gain(options.gain_db)
        self._set_trigger()
        self.packet_size: int = self._ask("set_packet_size", options.packet_size)
        self.reports_exposure = bool(self.facts["chunks"] and self._ask("set_chunks"))
        self._ask("note_state")

    @property
    def identity(self) -> Identity:
        model = f"{self.facts['vendor']} {self.facts['model']}".strip()
        return Identity(model or self.link.model, self.facts["serial"], simulated=False)

    @property
    def exposure_range(self) -> tuple[float, float]:
        low, high = self.facts["exposure_us"]
        return low * 1e-6, high * 1e-6

    @property
    def gain_range(self) -> tuple[float, float] | None:
        """Range of gain in decibels; None if the camera has no gain."""
        gain = self.facts["gain_db"]
        return None if gain is None else (gain[0], gain[1])

    def _neutralise(self) -> str:
        """Turn off what changes pixels; return what was on, in words."""
        kept = list(self._options.keep_features)
        if missing := self._ask("missing_features", kept):
            reply = f"the camera has no feature {', '.join(missing)}"
            raise self._error(
                f"keep_features {kept}", reply, "Leave it out, or look at its spelling"
            )
        changed, stubborn = self._ask("neutralise", kept)
        if stubborn:
            reply = f"it changes its pictures: {_listed(stubborn)}, and it can't be turned off"
            remedy = "Turn it off in the camera's own settings, or name it in keep_features"
            raise self._error("open", reply, remedy)
        if changed:
            words = "%s: turned off, because it changes pictures: %s"
            log.warning(words, self.identity.model, _listed(changed))
        return _listed(changed)

    def _set_format(self) -> PixelFormat:
        wanted, there = self._options.pixel_format, self.facts["pixel_formats"]
        known = [name for name in there if name in FORMATS]
        if wanted and wanted not in known:
            raise self._error(f"pixel format {wanted}", "it has none", f"Give {', '.join(known)}")
        actual = self._ask("set_pixel_format", wanted)
        if actual not in FORMATS or (wanted and actual != wanted):
            reply = f"it sends {actual}"
            raise self._error("pixel format", reply, f"Give one of {', '.join(known)}")
        o, form = self._options, FORMATS[actual]
        if (o.byte_order or o.justification) and form.layout != "words":
            reply = f"{actual} has no 16-bit words, so that it has neither order nor justification"
            raise self._error("pixel format", reply, "Leave byte_order and justification out")
        return replace(form, byte_order=o.byte_order, justification=o.justification)

    def _set_binning(self) -> None:
        wanted = list(self._options.binning)
        if self.facts["binning"] is None:
            if wanted != [1, 1]:
                raise self._error(f"binning {wanted}", "it has none", "Leave it out")
            return
        if (actual := self._ask("set_binning", *wanted)) != wanted:
            raise self._error(f"binning {wanted}", f"it has set {actual}", "Give another one")
        if self._options.average_binned and (mode := self._ask("average_binned_pixels")):
            reply = f"it has only {mode}, and not the mean of binned pixels"
            raise self._error(f"binning {wanted}", reply, "Leave binning out of the plan")

    def _set_region(self) -> list[int]:
        wanted = list(self._options.roi)
        region: list[int] = self._ask("set_region", *(wanted or (0, 0, 0, 0)))
        if wanted and region != wanted:
            raise self._error(f"roi {wanted}", f"it has set {region}", "Give one it can set")
        return region

    def set_gain(self, gain_db: float) -> float:
        """Set the gain in decibels; return the gain that is reported."""
        bounds = self.gain_range
        if bounds is None:
            if gain_db:
                raise self._error(f"gain {gain_db:g} dB", "it has none", "Leave it out")
            return self.gain
        if not bounds[0] <= gain_db <= bounds[1]:
            reply = f"out of range, {bounds[0]:g} to {bounds[1]:g} dB"
            raise self._error(f"gain {gain_db:g} dB", reply, "Choose one in the range")
        self.gain = float(self._ask("set_gain", gain_db))
        self._ask("note_features", "Gain", "GainRaw", "DigitalGain", "AnalogGain")
        return self.gain

    def _set_trigger(self) -> None:
        o = self._options
        wanted = {"software": "Software", "hardware": o.trigger_line, "free": ""}[o.trigger]
        there = self.facts["trigger_sources"]
        if wanted and wanted not in there:
            reply = f"it has no trigger {wanted}"
            raise self._error("trigger", reply, f"Choose of {', '.join(there) or 'none'}")
        if (actual := self._ask("set_trigger", wanted)) != wanted:
            raise self._error("trigger", f"it has set {actual}", "Choose another one")
        if o.frame_rate and not wanted:
            rate = float(self._ask("set_frame_rate", o.frame_rate))
            if abs(rate - o.frame_rate) > SETTING_TOLERANCE * o.frame_rate:
                reply = f"it has set {rate:g}"
                raise self._error(f"frame rate {o.frame_rate:g}", reply, "Ask for less")

    def _ask(self, name: str, *given: Any) -> Any:
        return self.link.ask(name, *given, timeout=REPLY_TIMEOUT)

    def _error(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self.link.model, command, reply, remedy)


def _listed(features: list[list[str]]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in features)
