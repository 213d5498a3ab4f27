"""Identities, failures and last known settings of the bench's devices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from drivers.errors import DeviceError
from labapp.bench.opening import Bench
from labapp.window.messages import DeviceInfo

_SETTING_QUERIES: dict[str, Callable[[Bench], Any]] = {
    "slm": lambda bench: bench.slm.displayed_pattern,
    "filter": lambda bench: bench.filter.wavelength,
    "targets": lambda bench: bench.targets.current_target,
}
"""Functions that ask a device of the bench for its present setting, by role."""


class DeviceMonitor:
    """Follow the devices for the list that a person sees.

    A device that fails raises no error here: it is listed as failed, with its last value.
    Identities are read once, because a dead device doesn't answer.
    last_settings: what the devices returned when they were asked last, by role.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._identities = {name: device.identity for name, device in bench.devices.items()}
        self._failed: dict[str, str] = {}
        self.last_settings = {role: question(bench) for role, question in _SETTING_QUERIES.items()}

    def require_alive(self, *roles: str) -> None:
        """Raise DeviceError if one of these devices is known to be dead; without roles, any."""
        for role in roles or tuple(self._identities):
            if why := self._dead_reason(role):
                model, remedy = self._identities[role].model, "Mend it, then click Reconnect"
                error = DeviceError(model, "dead", why, remedy)
                error.role = role
                raise error

    def mark_failed(self, error: DeviceError) -> str:
        """Mark a device as failed until it works again; return its name on the bench."""
        if error.role:
            self._failed[error.role] = f"{error.command}: {error.reply}"
        return error.role

    def mark_working(self, *roles: str) -> None:
        """Note that devices work again; without roles, all of them."""
        for role in roles or tuple(self._identities):
            self._failed.pop(role, None)

    def reopen(self, role: str) -> None:
        """Open a failed device again; raises DeviceError if that fails, too."""
        self._bench.supervised_devices[role].revive()
        self.mark_working(role)

    def device_infos(
        self, exposure: float, *, live: bool, running: bool, query_devices: bool = True
    ) -> tuple[DeviceInfo, ...]:
        """Describe every device.

        exposure: the camera's, s.
        query_devices: whether the devices are asked for their settings; otherwise, the last known
            ones are used.
        """
        if query_devices:
            self.last_settings = {role: self._query_setting(role) for role in _SETTING_QUERIES}
        nm, ms = self.last_settings["filter"] * 1e9, exposure * 1e3
        target = self.last_settings["targets"]
        if self._bench.targets.by_hand:
            target = f"{target}, as confirmed" if target else "none confirmed"
        values = self.last_settings | {
            "filter": f"{nm:.2f} nm",
            "camera": f"{ms:.3f} ms",
            "targets": target,
        }
        busy = "in a run" if running else "ready"
        states = {"camera": "in a run" if running else "live" if live else "stopped"}

        def info(name: str) -> DeviceInfo:
            gone, error = (
                self._unplugged_reason(name),
                self._dead_reason(name) or self._failed.get(name, ""),
            )
            state = "unplugged" if gone else "failed" if error else states.get(name, busy)
            who = self._identities[name]
            return DeviceInfo(name, who.model, who.simulated, state, values[name], gone or error)

        return tuple(info(name) for name in self._identities)

    def _query_setting(self, role: str) -> Any:
        """Return a device's present setting; without an answer, the last known."""
        if not (self._dead_reason(role) or self._unplugged_reason(role)):
            try:
                return _SETTING_QUERIES[role](self._bench)
            except DeviceError as error:
                self.mark_failed(error)
        return self.last_settings[role]

    def _unplugged_reason(self, role: str) -> str:
        """Return why a device is listed as unplugged; empty if it isn't, or can't tell."""
        return self._bench.supervised_devices[role].unplugged_reason() or ""

    def _dead_reason(self, role: str) -> str:
        """Return why a device is listed as given up after a failure; else empty."""
        return self._bench.supervised_devices[role].failure_reason
