"""The panel "Why": what the simulator does for the picture on the screen, and why."""

from __future__ import annotations

from PySide6.QtWidgets import QVBoxLayout, QWidget

from labapp.window.effects_model import share
from labapp.window.effects_table import EffectsTable
from labapp.window.messages import DeviceInfo, EffectsTold
from labapp.window.parts import OF_A_PANEL, Panel, fill, label

_EMPTY = "What the simulator does, and why, appears here with the first picture."
_REAL = "Real devices: nothing is simulated."
_REAL_CAMERA = "The camera is real: nothing is simulated in its pictures."


class EffectsPanel(Panel):
    """Each effect with its level, what that changes at most, and why; and all of them summed up.

    setting: what the picture was taken with that all this is said of.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setting = label(self, look="faint", wrap=True)
        self.summary = label(self, _EMPTY, wrap=True)
        self.table = EffectsTable(self)
        parts = self.setting, self.summary, (self.table, 1)
        fill(QVBoxLayout(self), *parts, margins=OF_A_PANEL, spacing=5)
        self.clear(_EMPTY)

    def clear(self, text: str) -> None:
        """Nothing is known; say why."""
        self.setting.hide()
        self.summary.setText(text)
        self.table.show_effects((), 0.0)

    def show_bench(self, devices: tuple[DeviceInfo, ...]) -> None:
        """A bench has opened, and no picture of it has come yet."""
        simulated = {device.name for device in devices if device.simulated}
        self.clear(_EMPTY if "camera" in simulated else _REAL_CAMERA if simulated else _REAL)

    def show_effects(self, told: EffectsTold) -> None:
        self.setting.setText(
            f"{told.target} · {told.pattern} · {told.wavelength * 1e9:.2f} nm · "
            f"{told.exposure * 1e3:.3f} ms"
        )
        self.setting.show()
        self.summary.setText(_summary(told))
        self.table.show_effects(told.effects, told.tol)


def _summary(told: EffectsTold) -> str:
    on = sum(effect.on for effect in told.effects)
    count = f"{on} of {len(told.effects)} effects take part."
    work = f"for {_percent(told.work)} of its work"
    if told.error is None:
        return f"How far the picture is from everything on isn't known, {work}. {count}"
    kept = f"tolerance {share(told.tol)}"
    if told.error > told.tol:
        kept += ", which forced effects exceed"
    return f"The picture is within {share(told.error)} of everything on ({kept}), {work}. {count}"


def _percent(part: float) -> str:
    """With two digits; none of a hundred is lost."""
    return f"{100 * part:.2g} %" if part < 0.995 else "all"
