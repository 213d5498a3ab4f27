"""Colours for a dark laboratory.

Nothing is brighter than the picture, and red is reserved for errors and saturated pixels.
"""

from __future__ import annotations

from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication

from labapp.runs.state import State

BACKGROUND = "#131416"
PANEL = "#1b1d20"
FIELD = "#101113"
ENTRY = "#2a2d32"
EDGE = "#34373c"
TEXT = "#c9c5bb"
FAINT = "#8b8880"
ACCENT = "#c08a3e"
SIMULATED = "#d0a02c"
REAL = "#5fa777"
ERROR = "#e0584f"
ALARM = "#5e211d"
ALARM_TEXT = "#ffd6cf"

PROMPT = "#4a3a14"
PROMPT_TEXT = "#f4dca6"
"""Colours of a bar that waits for the person."""

RUN_STATES = {
    State.WAITING: FAINT,
    State.RUNNING: "#7fa3c7",
    State.PAUSED: SIMULATED,
    State.COMPLETE: REAL,
    State.CANCELLED: "#b58863",
    State.FAILED: ERROR,
}

RUN_SIGNS = {
    State.WAITING: "○",
    State.RUNNING: "▶",
    State.PAUSED: "◫",
    State.COMPLETE: "✔",
    State.CANCELLED: "■",
    State.FAILED: "✖",
}
"""Shapes that stand before a run's state, for people who can't tell the colours apart."""

DEVICE_SIGNS = {"failed": "✖", "unplugged": "▲"}
"""Shapes of devices that don't work; all others have READY_SIGN."""

READY_SIGN = "●"

DIFFERS_SIGN = "≠"
"""Stands before a value read back that isn't the one that was set."""

_SHEET = f"""
QMainWindow, QDialog, QMessageBox {{ background: {BACKGROUND}; }}
QToolButton {{ color: {TEXT}; background: {PANEL}; border: 1px solid {EDGE};
  border-radius: 3px; padding: 4px 7px; }}
QToolButton#flat {{ padding: 0px 5px; }}
QToolButton:hover, QPushButton:hover {{ border-color: {ACCENT}; }}
QToolButton:checked {{ background: #3a2f1c; border-color: {ACCENT}; color: #f0d9ae; }}
QToolButton:disabled, QPushButton:disabled {{ color: #5a5852; border-color: #26282c; }}
QPushButton {{ background: #25282c; border: 1px solid {EDGE}; border-radius: 3px;
  padding: 4px 10px; }}
QPushButton:pressed {{ background: {FIELD}; }}
QDockWidget {{ color: {FAINT}; font-weight: bold; }}
QDockWidget::title {{ background: {BACKGROUND}; padding: 3px 6px; }}
QDockWidget > QWidget {{ background: {PANEL}; }}
QMainWindow::separator {{ background: {BACKGROUND}; width: 4px; height: 4px; }}
QTabWidget::pane {{ border: 0; }}
QScrollArea {{ background: transparent; }}
QTabBar::tab {{ background: {BACKGROUND}; color: {FAINT}; padding: 5px 14px;
  border-bottom: 2px solid {BACKGROUND}; }}
QTabBar::tab:selected {{ color: {TEXT}; border-bottom-color: {ACCENT}; }}
QTabBar {{ qproperty-drawBase: 0; }}
QScrollBar:vertical {{ background: {FIELD}; width: 11px; margin: 0; }}
QScrollBar::handle:vertical {{ background: {EDGE}; border-radius: 3px; margin: 2px;
  min-height: 24px; }}
QScrollBar::handle:vertical:hover {{ background: {ACCENT}; }}
QScrollBar::add-line:vertical, QScrollBar::sub-line:vertical {{ height: 0; }}
QScrollBar::add-page:vertical, QScrollBar::sub-page:vertical {{ background: {FIELD}; }}
QProgressBar {{ background: {FIELD}; border: 1px solid {EDGE}; border-radius: 3px;
  text-align: center; min-height: 17px; }}
QProgressBar::chunk {{ background: #6b5126; }}
QTableView {{ background: {FIELD}; border: 1px solid {EDGE}; border-radius: 3px;
  selection-background-color: #3a2f1c; selection-color: {TEXT}; }}
QHeaderView::section {{ background: {PANEL}; color: {FAINT}; border: 0; padding: 2px 4px; }}
QLabel#faint {{ color: {FAINT}; }}
QLabel#paused {{ color: {SIMULATED}; }}
QWidget#call {{ background: {PROMPT}; border-radius: 3px; }}
QWidget#call QLabel {{ color: {PROMPT_TEXT}; font-weight: bold; }}
QLabel#readBack {{ font-family: monospace; color: {REAL}; }}
QLabel#readBack[confirmed="true"] {{ color: {TEXT}; }}
QLabel[differs="true"] {{ color: {SIMULATED}; }}
QLabel#readBack[differs="true"] {{ color: {SIMULATED}; }}
QAbstractSpinBox[pending="true"], QComboBox[pending="true"] {{ color: {SIMULATED}; }}
QAbstractSpinBox[refused="true"] {{ color: {ERROR}; }}
QLabel#caption {{ background: rgba(0, 0, 0, 170); color: {TEXT}; font-family: monospace;
  padding: 4px 8px; border-radius: 3px; }}
QLabel#awaited {{ background: {SIMULATED}; color: {BACKGROUND}; font-family: monospace;
  font-weight: bold; padding: 4px 8px; border-radius: 3px; }}
QLabel#readings {{ font-family: monospace; color: {TEXT}; padding: 1px 4px; }}
QStatusBar {{ background: {PANEL}; }}
QStatusBar::item {{ border: 0; }}
QMenuBar, QMenu {{ background: {PANEL}; color: {TEXT}; }}
QMenuBar::item {{ padding: 3px 9px; }}
QMenu {{ border: 1px solid {EDGE}; }}
QMenu::separator {{ height: 1px; background: {EDGE}; margin: 3px 6px; }}
QMenuBar::item:selected, QMenu::item:selected {{ background: #3a2f1c; color: #f0d9ae; }}
QMenu::item:disabled {{ color: #5a5852; }}
QToolTip {{ background: {PANEL}; color: {TEXT}; border: 1px solid {EDGE}; }}
"""


def apply_theme(application: QApplication) -> None:
    """Give the application its palette, font and style sheet."""
    application.setStyle("Fusion")
    palette = QPalette()
    role = QPalette.ColorRole
    for name, colour in (
        (role.Window, PANEL),
        (role.WindowText, TEXT),
        (role.Base, ENTRY),
        (role.AlternateBase, PANEL),
        (role.Text, TEXT),
        (role.Button, ENTRY),
        (role.ButtonText, TEXT),
        (role.Highlight, ACCENT),
        (role.HighlightedText, FIELD),
        (role.PlaceholderText, FAINT),
        (role.Link, ACCENT),
        (role.ToolTipBase, PANEL),
        (role.ToolTipText, TEXT),
    ):
        palette.setColor(name, QColor(colour))
    for name in (role.WindowText, role.Text, role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, name, QColor("#5a5852"))
    application.setPalette(palette)
    application.setStyleSheet(_SHEET)
