"""What is simulated and what is real: always on the screen."""

from __future__ import annotations

from PySide6.QtWidgets import QLabel, QWidget

from labapp.window.messages import DeviceInfo
from labapp.window.theme import EDGE, FAINT, FIELD, REAL, SIMULATED


class Badge(QLabel):
    """Names the simulated devices and the real ones; until it knows, it says so."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.forget()

    def forget(self) -> None:
        self._paint("BENCH NOT OPEN", FIELD, FAINT)

    def show_devices(self, devices: tuple[DeviceInfo, ...]) -> None:
        simulated = [device.name for device in devices if device.simulated]
        real = [device.name for device in devices if not device.simulated]
        if not real:
            self._paint(f"SIMULATED: {', '.join(simulated)}", SIMULATED, FIELD)
        elif not simulated:
            self._paint(f"REAL: {', '.join(real)}", REAL, FIELD)
        else:
            text = f"SIMULATED: {', '.join(simulated)}  |  REAL: {', '.join(real)}"
            self._paint(text, SIMULATED, FIELD)

    def _paint(self, text: str, background: str, colour: str) -> None:
        self.setText(text)
        self.setStyleSheet(
            f"background: {background}; color: {colour}; border: 1px solid {EDGE};"
            "border-radius: 3px; padding: 4px 10px; font-weight: bold;"
        )
