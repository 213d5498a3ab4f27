"""The main window of the lab application: panels for devices, patterns and runs, and live view."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from pathlib import Path

from PySide6.QtCore import QByteArray, QSize, Qt, QTimer
from PySide6.QtGui import QCloseEvent, QKeyEvent, QMouseEvent, QMoveEvent, QResizeEvent, QShortcut
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDockWidget,
    QLineEdit,
    QMainWindow,
    QMessageBox,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from labapp.window.accuracy_view import AccuracyView
from labapp.window.action_bar import ActionBar
from labapp.window.actions import make_actions
from labapp.window.alignment_panel import AlignmentPanel
from labapp.window.device_list import DeviceList
from labapp.window.dock_scroll import DockScroll
from labapp.window.effects_panel import EffectsPanel
from labapp.window.engine_connection import EngineConnection
from labapp.window.help_window import HelpWindow
from labapp.window.input_guard import InputGuard
from labapp.window.kept_queue import KeptQueue
from labapp.window.light_filter import LightFilter
from labapp.window.live_view import LiveView
from labapp.window.log_panel import LogPanel
from labapp.window.message_line import MessageLine
from labapp.window.number_fields import number_fields
from labapp.window.pattern_panel import PatternPanel
from labapp.window.prompt_bar import PromptBar
from labapp.window.question_bar import QuestionBar
from labapp.window.queue_panel import QueuePanel
from labapp.window.reconstruction_view import ReconstructionView
from labapp.window.remembered_settings import RememberedSettings, changes
from labapp.window.run_panel import RunPanel
from labapp.window.scrolled_tabs import ScrolledTabs
from labapp.window.session import Session
from labapp.window.settings_panel import SettingsPanel
from labapp.window.shortcut_list import ShortcutList
from labapp.window.side_by_side import SideBySide
from labapp.window.widgets import fill_layout, make_tool_button

_SIZE = QSize(1600, 900)
"""Size of the window on a screen that has room for more. Chosen."""

_LEFT_WIDTH, _RIGHT_WIDTH = 270, 370
"""Widths of the docks at the window's sides in pixels. Chosen: the picture has the rest."""

_SHORT_DOCKS = ("Devices", "Settings", "Bracket and run")
"""Docks without a list or a picture: they take the height that they need, and no more."""

_REMEMBERED_CHOICES = ("contrast", "marks", "dim", "red")
"""Names of the checkable actions whose state is kept."""

_KEEP_AFTER_MS = 200
"""Milliseconds from a change of the settings until they are kept, so that a crash loses none.
Chosen: who types or drags causes one writing."""

_LAYOUT_VERSION = 5
"""Version of the docks' layout. Qt ignores a saved layout of another version."""

_SETTING_ACTIONS = ("undo", "redo", "lock")

_INPUT_WIDGETS = (QAbstractSpinBox, QComboBox, QLineEdit)
"""Widgets in which Enter completes the input."""


class MainWindow(QMainWindow):
    """Arrange panels around a live view; `session` connects them with the engine."""

    def __init__(self, connection: EngineConnection, remembered: RememberedSettings) -> None:
        super().__init__()
        self.setWindowTitle("labapp")
        self.connection, self._remembered = connection, remembered
        self.kept_queue = KeptQueue(remembered.queue_file, connection.bench_name)
        self._keeping = QTimer(self, singleShot=True, interval=_KEEP_AFTER_MS)
        self.actions_ = make_actions(self)
        self.bar = ActionBar(self.actions_, self)
        self.setMenuWidget(self.bar)
        self.live_view = LiveView(self)
        self.reconstruction = ReconstructionView(self.actions_["reconstruct"], self)
        self.side_by_side = SideBySide(self)
        self.accuracy = AccuracyView(self)
        self.tabs = ScrolledTabs(self)
        self.tabs.addTab(self.live_view, "Live")
        self.tabs.add_scrolled_tab(self.reconstruction, "Reconstruction")
        self.tabs.add_scrolled_tab(self.side_by_side, "Side by side")
        self.tabs.add_scrolled_tab(self.accuracy, "Accuracy")
        self.prompt_bar = PromptBar(self.actions_["pause"], self)
        self.question = QuestionBar(self.actions_["yes"], self)
        central = QWidget(self)
        bars = self.question, self.prompt_bar
        fill_layout(QVBoxLayout(central), *bars, (self.tabs, 1), spacing=4)
        self.setCentralWidget(central)
        self.devices = DeviceList(self)
        self.settings = SettingsPanel([self.actions_[name] for name in _SETTING_ACTIONS], self)
        self.pattern = PatternPanel(self)
        self.run = RunPanel([self.actions_[name] for name in ("acquire", "reconstruct")], self)
        files = [self.actions_[name] for name in ("plan", "resume", "open")]
        self.queue = QueuePanel(files, self)
        self.effects = EffectsPanel(self)
        self.log = LogPanel(self)
        self.alignment = AlignmentPanel(self)
        self.docks: dict[str, QDockWidget] = {}
        left, right = Qt.DockWidgetArea.LeftDockWidgetArea, Qt.DockWidgetArea.RightDockWidgetArea
        self._dock("Devices", self.devices, left)
        self._dock("Pattern", self.pattern, left)
        self._dock("Settings", self.settings, right)
        self._dock("Bracket and run", self.run, right)
        self._queue_dock = self._dock("Queue", self.queue, right)
        self._alignment_dock = self._dock("Find and align", self.alignment, right)
        self._why_dock = self._dock("Why", self.effects, right)
        self._log_dock = self._dock("Log", self.log, right)
        self._list_docks()
        self.message = MessageLine(self)
        self.message.said.connect(self.log.add_message)
        self.message.log_requested.connect(lambda: _bring_to_front(self._log_dock))
        self.statusBar().setSizeGripEnabled(False)
        self.statusBar().addWidget(self.message, 1)
        # Help stands beside the message, since the bar at the top already fills a small screen.
        self.help_button = make_tool_button(self, self.actions_["help"])
        self.statusBar().addPermanentWidget(self.help_button)
        self._fit_to_screen()
        self._tab_docks()
        self._arrange_docks()
        self._first_layout = self.saveState(_LAYOUT_VERSION)
        self.actions_["reset"].performed.connect(self._reset_layout)
        self.help: HelpWindow | None = None
        self.actions_["help"].performed.connect(self._show_help)
        self.keys: ShortcutList | None = None
        self.actions_["keys"].performed.connect(self._show_keys)
        self.actions_["accept"].performed.connect(self.message.acknowledge)
        self.actions_["quit"].performed.connect(self.close)
        self._light = LightFilter(_application(), self)
        for name in ("dim", "red"):
            self.actions_[name].toggled.connect(self._set_light)
        self.session = Session(self, connection)
        self._restore()
        self._watch_changes()
        self._keeping.timeout.connect(self._save_settings)
        self._guard = InputGuard(self)
        for field in number_fields(self):
            field.refused.connect(self.message.show_error)
        self.settings.range_told.connect(self.message.show_message)
        self.devices.row_added.connect(self._guard.watch)
        self.setFocus()

    def closeEvent(self, event: QCloseEvent) -> None:
        """Ask before a run is given up, then save the settings and end the engine."""
        if (question := self._question()) and not self._confirm(question):
            event.ignore()
            return
        self._keeping.stop()
        self._save_settings()
        self.kept_queue.close()
        # Hide the window first, since leaving the bench safe may take a moment.
        self.hide()
        self.connection.close()
        event.accept()

    def show_reconstruction(self) -> None:
        """Show the tab "Reconstruction", unless the person views "Side by side"."""
        if self.tabs.currentWidget() is not self.side_by_side:
            self.tabs.setCurrentWidget(self.reconstruction)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Let Enter confirm a run's prompt unless an input field has the focus, and Esc say no."""
        if event.key() == Qt.Key.Key_Escape:
            self.question.decline()
        if (
            event.key() not in (Qt.Key.Key_Return, Qt.Key.Key_Enter)
            or not self.prompt_bar.is_asking
        ):
            super().keyPressEvent(event)
            return
        field = self.focusWidget()
        if isinstance(field, _INPUT_WIDGETS):
            field.clearFocus()
        elif not event.isAutoRepeat():
            self.prompt_bar.done_button.click()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Leave the field that has the keyboard, for a click on nothing.

        Buttons and menus take their clicks, and act on what is typed in the field.
        """
        self.setFocus(Qt.FocusReason.MouseFocusReason)
        super().mousePressEvent(event)

    def show_queue(self) -> None:
        """Show the tab of the run queue, which shares its place with "Why"."""
        _bring_to_front(self._queue_dock)

    def _show_help(self) -> None:
        """Show the guide, which is created once and then keeps its page and its place."""
        if self.help is None:
            self.help = HelpWindow(self)
        self.help.show()
        self.help.raise_()
        self.help.activateWindow()

    def _show_keys(self) -> None:
        """Show the list of keys, which stays open beside the window."""
        if self.keys is None:
            self.keys = ShortcutList(self.actions_.values(), self)
        self.keys.show()
        self.keys.raise_()

    def _set_light(self) -> None:
        dim, red = (self.actions_[name].isChecked() for name in ("dim", "red"))
        self._light.set_light(dim=dim, red=red)

    def _dock(self, title: str, panel: QWidget, area: Qt.DockWidgetArea) -> QDockWidget:
        self.docks[title] = dock = QDockWidget(title, self)
        dock.setObjectName(title)
        dock.setWidget(DockScroll(panel, dock, whole=title in _SHORT_DOCKS))
        self.addDockWidget(area, dock)
        return dock

    def _list_docks(self) -> None:
        """List the docks in a menu, so that a closed one can be opened again."""
        for number, dock in enumerate(self.docks.values(), 1):
            self.bar.menus.menus["Panels"].addAction(dock.toggleViewAction())
            QShortcut(f"Ctrl+{number}", self, partial(_go_to, dock))

    def _tab_docks(self) -> None:
        """Put the docks "Queue", "Find and align", "Why" and "Log" into one place as tabs.

        All are tall, and a person reads only one of them at a time.
        """
        right = Qt.DockWidgetArea.RightDockWidgetArea
        self.setTabPosition(right, QTabWidget.TabPosition.North)
        tabs = (self._queue_dock, self._alignment_dock, self._why_dock, self._log_dock)
        for one, next_ in pairwise(tabs):
            self.tabifyDockWidget(one, next_)
        self._queue_dock.raise_()
        self.actions_["why"].performed.connect(self._turn_tab)
        self.actions_["align"].performed.connect(self._alignment_dock.raise_)
        # The connection is queued, because the dock's visible region is known only later.
        later = Qt.ConnectionType.QueuedConnection
        for moved in (self._why_dock.visibilityChanged, self._why_dock.topLevelChanged):
            moved.connect(self._mark_why, later)

    def _turn_tab(self, on: bool) -> None:
        _bring_to_front(self._why_dock if on else self._queue_dock)
        self._mark_why()

    def _mark_why(self) -> None:
        """Check the action "Why" as long as its dock is visible, in a tab or alone."""
        self.actions_["why"].setChecked(not self._why_dock.visibleRegion().isEmpty())

    def _fit_to_screen(self) -> None:
        """Give the window its first size, and the whole of a screen that isn't larger than that."""
        room = self.screen().availableGeometry()
        self.resize(_SIZE.boundedTo(room.size()))
        if room.width() <= _SIZE.width() or room.height() <= _SIZE.height():
            self.setWindowState(self.windowState() | Qt.WindowState.WindowMaximized)

    def _arrange_docks(self) -> None:
        docks = list(self.docks.values())
        left = Qt.DockWidgetArea.LeftDockWidgetArea
        widths = [
            _LEFT_WIDTH if self.dockWidgetArea(dock) == left else _RIGHT_WIDTH for dock in docks
        ]
        self.resizeDocks(docks, widths, Qt.Orientation.Horizontal)
        # Lists and pictures share the height that the others leave.
        short = [self.docks[title] for title in _SHORT_DOCKS]
        self.resizeDocks(short, [1] * len(short), Qt.Orientation.Vertical)

    def _reset_layout(self) -> None:
        self.restoreState(self._first_layout, _LAYOUT_VERSION)
        self._fit_to_screen()
        self._arrange_docks()

    def _question(self) -> str:
        """Return the question to ask before closing; empty if no run would be lost."""
        queue = self.session.queue
        if queue.current_run is not None:
            return (
                "A run is under way. Cancel it and close? Frames taken so far are kept, and the "
                "queue comes back, held, when the window opens again."
            )
        waiting = queue.waiting_count
        return (
            f"Runs in line: {waiting}. Close? They come back, held, when the window opens again."
            if waiting
            else ""
        )

    def _confirm(self, question: str) -> bool:
        button = QMessageBox.StandardButton
        answer = QMessageBox.question(self, "labapp", question, button.Yes | button.No, button.No)
        return answer == button.Yes

    def _remembered_fields(self) -> dict[str, QWidget]:
        form = self.pattern.form
        fields: dict[str, QWidget] = {
            "wavelength_nm": self.settings.wavelength,
            "exposure_ms": self.settings.exposure,
            "folder": self.run.folder,
            "restore_method": self.reconstruction.method,
            "restore_s": self.reconstruction.budget,
            "restore_light": self.reconstruction.spectra.light,
            "pattern": form.kind,
            "pattern_file": form.file,
        }
        for (kind, key), box in [*form.numbers.items(), *form.texts.items()]:
            if box is not form.file:
                fields[f"{kind}_{key}"] = box
        for name in ("star", "photograph"):
            row = getattr(self.run, name)
            fields[f"{name}_shortest_ms"] = row.shortest
            fields[f"{name}_ratio"] = row.ratio
            fields[f"{name}_count"] = row.count
            fields[f"{name}_chosen"] = row.chosen
            fields[f"{name}_snr_db"] = row.snr
            fields[f"{name}_decades"] = row.decades
        return fields

    def _restore(self) -> None:
        """Restore layout, fields, views and last run as the person left them."""
        remembered = self._remembered
        remembered.restore_fields(self._remembered_fields())
        self.session.first_target = remembered.text("target")
        if run := remembered.text("last_run"):
            self.session.restore_last_run(Path(run))
        geometry: QByteArray = remembered.layout("geometry")
        if not geometry.isEmpty():
            self.restoreGeometry(geometry)
            if not self.isMaximized():
                self.resize(self.size().boundedTo(self.screen().availableSize()))
        layout = remembered.layout("layout")
        if not layout.isEmpty():
            self.restoreState(layout, _LAYOUT_VERSION)
        for name in _REMEMBERED_CHOICES:
            kept = remembered.text(name)
            if kept and (kept == "on") != self.actions_[name].isChecked():
                self.actions_[name].trigger()
        for index in range(self.tabs.count()):
            if self.tabs.tabText(index) == remembered.text("tab"):
                self.tabs.setCurrentIndex(index)

    def _watch_changes(self) -> None:
        """Keep the settings soon after each change, not only on closing."""
        for field in [*self._remembered_fields().values(), self.settings.target]:
            if (changed := changes(field)) is not None:
                changed.connect(self.keep_settings)
        for name in _REMEMBERED_CHOICES:
            self.actions_[name].toggled.connect(self.keep_settings)
        self.tabs.currentChanged.connect(self.keep_settings)
        for dock in self.docks.values():
            for moved in (dock.visibilityChanged, dock.topLevelChanged, dock.dockLocationChanged):
                moved.connect(self.keep_settings)

    def keep_settings(self) -> None:
        """Keep the settings in a moment, once nothing changes any more."""
        self._keeping.start()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.keep_settings()

    def moveEvent(self, event: QMoveEvent) -> None:
        super().moveEvent(event)
        self.keep_settings()

    def _save_settings(self) -> None:
        remembered = self._remembered
        remembered.store_fields(self._remembered_fields())
        if self.settings.target.set_text:
            remembered.put("target", self.settings.target.set_text)
        if self.session.last_run is not None:
            remembered.put("last_run", str(self.session.last_run))
        remembered.put("tab", self.tabs.tabText(self.tabs.currentIndex()))
        for name in _REMEMBERED_CHOICES:
            remembered.put(name, "on" if self.actions_[name].isChecked() else "off")
        remembered.put("geometry", self.saveGeometry())
        remembered.put("layout", self.saveState(_LAYOUT_VERSION))
        remembered.save()


def _bring_to_front(dock: QDockWidget) -> None:
    """Show a dock also where it was closed or is behind another tab."""
    dock.show()
    dock.raise_()


def _go_to(dock: QDockWidget) -> None:
    """Bring a dock to the front, and give its first field the keyboard."""
    _bring_to_front(dock)
    for widget in dock.widget().findChildren(QWidget):
        if widget.focusPolicy() & Qt.FocusPolicy.TabFocus and widget.isVisibleTo(dock):
            widget.setFocus(Qt.FocusReason.ShortcutFocusReason)
            return


def _application() -> QApplication:
    application = QApplication.instance()
    assert isinstance(application, QApplication)
    return application
