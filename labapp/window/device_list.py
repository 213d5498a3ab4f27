"""The devices of the bench: what each is, how it is, and its last value."""

from __future__ import annotations

from html import escape

from PySide6.QtWidgets import QLabel, QVBoxLayout, QWidget

from labapp.window.label import label
from labapp.window.messages import DeviceInfo
from labapp.window.theme import ERROR, FAINT, REAL, SIMULATED

_TITLES = {"slm": "SLM", "filter": "Filter", "camera": "Camera", "targets": "Targets"}


class DeviceList(QWidget):
    """Two lines a device; a failed one is red until it does as it is told."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._rows: dict[str, QLabel] = {}
        self._layout = QVBoxLayout(self)
        self._layout.setContentsMargins(8, 4, 8, 6)
        self._layout.setSpacing(4)
        self._empty = label(self, "opening the bench …", look="faint")
        self._layout.addWidget(self._empty)
        self._layout.addStretch(1)

    def clear(self, text: str) -> None:
        """No devices are known; say why."""
        for row in self._rows.values():
            self._layout.removeWidget(row)
            row.deleteLater()
        self._rows.clear()
        self._empty.setText(text)
        self._empty.show()

    def show_devices(self, devices: tuple[DeviceInfo, ...]) -> None:
        self._empty.hide()
        for device in devices:
            if device.name not in self._rows:
                row = label(self, wrap=True)
                self._rows[device.name] = row
                self._layout.insertWidget(len(self._rows), row)
            self._rows[device.name].setText(_describe(device))

    def text(self, name: str) -> str:
        return self._rows[name].text()


def _describe(device: DeviceInfo) -> str:
    kind, kind_colour = ("simulated", SIMULATED) if device.simulated else ("real", REAL)
    state_colour = ERROR if device.state == "failed" else REAL
    title = _TITLES.get(device.name, device.name)
    return (
        f"<span style='color:{state_colour}'>●</span> <b>{escape(title)}</b> "
        f"<span style='color:{state_colour}'>{escape(device.state)}</span> "
        f"<span style='color:{kind_colour}'>{kind}</span><br>"
        f"<span style='color:{FAINT}'>{escape(device.model)}:</span> {escape(device.value)}"
    )
