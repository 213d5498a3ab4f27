"""The devices as the window lists them: who they are, whether they work, what they said last."""

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
"""What the devices are asked for: how they are set."""


class DeviceMonitor:
    """Nothing here fails because a device does: it is shown as failed, with its last value.

    What never changes is asked once, for a dead device answers no question. last_settings: what
    the devices said that they are set to, by their names, when they were asked last.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._identities = {name: device.identity for name, device in bench.devices.items()}
        self._failed: dict[str, str] = {}
        self.last_settings = {role: question(bench) for role, question in _SETTING_QUERIES.items()}

    def require_alive(self, *roles: str) -> None:
        """DeviceError if one of the devices, or of all if none is named, is dead."""
        for role in roles or tuple(self._identities):
            if why := self._dead_reason(role):
                model, remedy = self._identities[role].model, "Mend it, then click Reconnect"
                error = DeviceError(model, "dead", why, remedy)
                error.role = role
                raise error

    def mark_failed(self, error: DeviceError) -> str:
        """The bench's name of the device that failed, which is marked until it works again."""
        if error.role:
            self._failed[error.role] = f"{error.command}: {error.reply}"
        return error.role

    def mark_working(self, *roles: str) -> None:
        """The devices did as they were told; without roles, all of them."""
        for role in roles or tuple(self._identities):
            self._failed.pop(role, None)

    def reopen(self, role: str) -> None:
        """Open a device in place of one that has failed. DeviceError if that fails, too."""
        self._bench.supervised_devices[role].revive()
        self.mark_working(role)

    def device_infos(
        self, exposure: float, *, live: bool, running: bool, query_devices: bool = True
    ) -> tuple[DeviceInfo, ...]:
        """exposure: seconds, as the camera was set. query_devices: whether they are asked."""
        if query_devices:
            self.last_settings = {role: self._query_setting(role) for role in _SETTING_QUERIES}
        nm, ms = self.last_settings["filter"] * 1e9, exposure * 1e3
        values = self.last_settings | {"filter": f"{nm:.2f} nm", "camera": f"{ms:.3f} ms"}
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
        """What a device says now; of one that doesn't answer, what it said last."""
        if not (self._dead_reason(role) or self._unplugged_reason(role)):
            try:
                return _SETTING_QUERIES[role](self._bench)
            except DeviceError as error:
                self.mark_failed(error)
        return self.last_settings[role]

    def _unplugged_reason(self, role: str) -> str:
        """Why a device counts as unplugged; empty while it is there, or if nobody knows."""
        return self._bench.supervised_devices[role].unplugged_reason() or ""

    def _dead_reason(self, role: str) -> str:
        """Why a device is given up; empty while it isn't."""
        return self._bench.supervised_devices[role].failure_reason
