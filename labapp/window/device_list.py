"""List of the bench's devices, with their models, states and last values."""

from __future__ import annotations

from html import escape

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QGridLayout, QPushButton, QVBoxLayout, QWidget

from labapp.window.messages import DeviceInfo
from labapp.window.theme import DEVICE_SIGNS, ERROR, FAINT, READY_SIGN, REAL, SIMULATED
from labapp.window.widgets import PANEL_MARGINS, WrappingPanel, fill_layout, make_label

DEVICE_TITLES = {"slm": "SLM", "filter": "Filter", "camera": "Camera", "targets": "Targets"}


class DeviceRow(QWidget):
    """Show a device in two lines; a failed device also has its error and a Reconnect button."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._title, self._value = (
            make_label(self, rich=True),
            make_label(self, wrap=True, rich=True),
        )
        self.reconnect = QPushButton("Reconnect", self)
        self.reconnect.setToolTip("Open the device again")
        layout = QGridLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setVerticalSpacing(0)
        layout.setColumnStretch(0, 1)
        layout.addWidget(self._title, 0, 0)
        layout.addWidget(self.reconnect, 0, 1)
        layout.addWidget(self._value, 1, 0, 1, 2)
        self.reconnect.hide()

    @property
    def text(self) -> str:
        return f"{self._title.text()}<br>{self._value.text()}"

    def show_device(self, device: DeviceInfo) -> None:
        self._title.setText(_heading_html(device))
        self._value.setText(_value_html(device))
        self.reconnect.setVisible(device.state == "failed")
        self.reconnect.setText("Reconnect")


class DeviceList(WrappingPanel):
    """List the bench's devices, one row each; a failed device is red until it works again.

    `reconnect_requested` is emitted with the bench's name of a device to be opened again, and
    `row_added` with each new row.
    """

    reconnect_requested = Signal(str)
    row_added = Signal(QWidget)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.rows: dict[str, DeviceRow] = {}
        self._locked = False
        self._layout = QVBoxLayout(self)
        self._empty = make_label(self, "opening the bench …", look="faint")
        fill_layout(self._layout, self._empty, 1, margins=PANEL_MARGINS, spacing=4)

    def clear(self, text: str) -> None:
        """Remove all devices, and show the reason instead."""
        for row in self.rows.values():
            self._layout.removeWidget(row)
            row.deleteLater()
        self.rows.clear()
        self._empty.setText(text)
        self._empty.show()

    def show_devices(self, devices: tuple[DeviceInfo, ...]) -> None:
        self._empty.hide()
        for device in devices:
            if device.name not in self.rows:
                self._add(device.name)
            self.rows[device.name].show_device(device)
        self.set_locked(self._locked)

    def set_locked(self, on: bool) -> None:
        """Disable the Reconnect buttons, as in a run or while the settings are locked."""
        self._locked = on
        for row in self.rows.values():
            row.reconnect.setEnabled(not on)

    def text(self, name: str) -> str:
        return self.rows[name].text

    def _add(self, name: str) -> None:
        row = DeviceRow(self)
        row.reconnect.clicked.connect(lambda: self._request_reconnect(name))
        self.rows[name] = row
        self._layout.insertWidget(len(self.rows), row)
        self.row_added.emit(row)

    def _request_reconnect(self, name: str) -> None:
        button = self.rows[name].reconnect
        button.setEnabled(False)
        button.setText("opening …")
        self.reconnect_requested.emit(name)


def _heading_html(device: DeviceInfo) -> str:
    kind, kind_colour = ("simulated", SIMULATED) if device.simulated else ("real", REAL)
    state_colour = ERROR if device.error else REAL
    sign = DEVICE_SIGNS.get(device.state, READY_SIGN)
    title = DEVICE_TITLES.get(device.name, device.name)
    return (
        f"<span style='color:{state_colour}'>{sign}</span> <b>{escape(title)}</b> "
        f"<span style='color:{state_colour}'>{escape(device.state)}</span> "
        f"<span style='color:{kind_colour}'>{kind}</span>"
    )


def _value_html(device: DeviceInfo) -> str:
    model = f"<span style='color:{FAINT}'>{escape(device.model)}:</span>"
    if not device.error:
        return f"{model} {escape(device.value)}"
    error = f"<span style='color:{ERROR}'>{escape(device.error)}</span>"
    return f"{model} {escape(device.value)} ?<br>{error}"
