"""The panel "Why": what the simulator does for the picture on the screen, and why."""

from __future__ import annotations

from PySide6.QtWidgets import QVBoxLayout, QWidget

from labapp.window.effects_model import format_share
from labapp.window.effects_table import EffectsTable
from labapp.window.messages import DeviceInfo, EffectsReport
from labapp.window.widgets import PANEL_MARGINS, WrappingPanel, fill_layout, make_label

_EMPTY = "What the simulator does, and why, appears here with the first picture."
_REAL = "Real devices: nothing is simulated."
_REAL_CAMERA = "The camera is real: nothing is simulated in its pictures."


class EffectsPanel(WrappingPanel):
    """Show each simulated effect with its level, error and reason, and a summary of all.

    The label `setting` names target, pattern, wavelength and exposure of the picture that the
    effects belong to.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setting = make_label(self, look="faint", wrap=True)
        self.summary = make_label(self, _EMPTY, wrap=True)
        self.table = EffectsTable(self)
        parts = self.setting, self.summary, (self.table, 1)
        fill_layout(QVBoxLayout(self), *parts, margins=PANEL_MARGINS, spacing=5)
        self.clear(_EMPTY)

    def clear(self, text: str) -> None:
        """Remove all effects, and show the reason instead."""
        self.setting.hide()
        self.summary.setText(text)
        self.table.show_effects((), 0.0)

    def show_bench(self, devices: tuple[DeviceInfo, ...]) -> None:
        """Show what a newly opened bench simulates, until its first picture comes."""
        simulated = {device.name for device in devices if device.simulated}
        self.clear(_EMPTY if "camera" in simulated else _REAL_CAMERA if simulated else _REAL)

    def show_effects(self, report: EffectsReport) -> None:
        self.setting.setText(
            f"{report.target} · {report.pattern} · {report.wavelength * 1e9:.2f} nm · "
            f"{report.exposure * 1e3:.3f} ms"
        )
        self.setting.show()
        self.summary.setText(_summary(report))
        self.table.show_effects(report.effects, report.tol)


def _summary(report: EffectsReport) -> str:
    on = sum(effect.on for effect in report.effects)
    count = f"{on} of {len(report.effects)} effects take part."
    work = f"for {_percent(report.work)} of its work"
    if report.error is None:
        return f"How far the picture is from everything on isn't known, {work}. {count}"
    kept = f"tolerance {format_share(report.tol)}"
    if report.error > report.tol:
        kept += ", which forced effects exceed"
    known = ", as estimated" if report.is_estimated else ""
    within = f"The picture is within {format_share(report.error)} of everything on{known} ({kept})"
    return f"{within}, {work}. {count}"


def _percent(part: float) -> str:
    """Format a share of the simulator's work: two digits, "all" from 99.5 % on."""
    return f"{100 * part:.2g} %" if part < 0.995 else "all"
