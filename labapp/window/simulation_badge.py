"""A badge, always visible, that tells simulated devices from real ones."""

from __future__ import annotations

from PySide6.QtWidgets import QLabel, QWidget

from labapp.window.messages import DeviceInfo
from labapp.window.theme import EDGE, FAINT, FIELD, REAL, SIMULATED


class SimulationBadge(QLabel):
    """Name the simulated and the real devices of the bench, or say that no bench is open."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.show_bench_closed()

    def show_bench_closed(self) -> None:
        self._paint("BENCH NOT OPEN", FIELD, FAINT)

    def show_devices(self, devices: tuple[DeviceInfo, ...]) -> None:
        simulated = [device.name for device in devices if device.simulated]
        real = [device.name for device in devices if not device.simulated]
        named = {"SIMULATED": simulated, "REAL": real}
        text = "  |  ".join(f"{kind}: {', '.join(names)}" for kind, names in named.items() if names)
        self._paint(text, SIMULATED if simulated else REAL, FIELD)

    def _paint(self, text: str, background: str, colour: str) -> None:
        self.setText(text)
        self.setStyleSheet(
            f"background: {background}; color: {colour}; border: 1px solid {EDGE};"
            "border-radius: 3px; padding: 2px 10px; font-weight: bold;"
        )
