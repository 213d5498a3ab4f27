"""Panel for acquisition: brackets, the folder of records, and a run's progress."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from labapp.runs.state import State
from labapp.window.bracket_row import BracketRow
from labapp.window.duration_text import format_duration
from labapp.window.exposure_bracket import (
    DARK_FRAMES,
    STAR_FRAMES,
    ExposureBracket,
    ProposedBracket,
    SNRBracket,
)
from labapp.window.messages import JobProgress, RunInfo
from labapp.window.run_times import RunTimes
from labapp.window.widgets import (
    PANEL_MARGINS,
    WrappingPanel,
    fill_layout,
    make_label,
    make_tool_button,
    plain_tip,
)


def default_run_folder() -> Path:
    return Path.home() / "labapp-runs"


class RunPanel(WrappingPanel):
    """Describe the frames of a bracket before its run; then show progress and time left."""

    def __init__(self, actions: list[QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.star = BracketRow("Star", ExposureBracket(1, 8, 4), SNRBracket(30, 3), self)
        self.photograph = BracketRow("Photo", ExposureBracket(100, 4, 3), SNRBracket(30, 2), self)
        self.summary = make_label(self, look="faint", wrap=True)
        self.folder = QLineEdit(str(default_run_folder()), self)
        self.browse = QPushButton("Browse …", self)
        self.bar = QProgressBar(self, minimum=0, maximum=1000)
        self.message = make_label(self, look="faint", wrap=True)
        self.times = RunTimes(self)
        self.last_run = make_label(self, look="faint", wrap=True)
        self.last_run.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._frame_bytes = 0
        self._arrange(actions)
        for row in (self.star, self.photograph):
            row.changed.connect(self._sum_up)
        self.browse.clicked.connect(self._choose_folder)
        self._sum_up()

    def set_frame_shape(self, shape: tuple[int, int]) -> None:
        self._frame_bytes = 2 * shape[0] * shape[1]
        self._sum_up()

    @property
    def chosen_folder(self) -> Path:
        return Path(self.folder.text().strip() or ".").expanduser()

    def show_start(self, message: str) -> None:
        self.bar.setFormat("%p %")
        self.bar.setValue(0)
        self.message.setText(message)

    def show_run(self, run: RunInfo) -> None:
        """Show how the run under way proceeds, or how the last one ended."""
        under_way = run.state.is_under_way
        shown = under_way or run.state is State.COMPLETE
        # Frames on the disk are what counts; what is prepared before the first one is none.
        share = run.stored_frames / run.planned_frames if run.planned_frames else 0.0
        self.bar.setValue(round(1000 * share) if shown else 0)
        self.bar.setFormat(f"{run.stored_frames} of {run.planned_frames} frames")
        self.message.setText(_describe(run) if under_way else run.state.value.lower())
        self.times.show_run(run)

    def show_progress(self, progress: JobProgress) -> None:
        self.bar.setValue(round(1000 * progress.fraction))
        left = progress.seconds_left
        self.message.setText(
            progress.message + ("" if left is None else f"  –  {format_duration(left)} left")
        )

    def show_end(self, message: str, *, done: bool) -> None:
        self.bar.setValue(self.bar.maximum() if done else 0)
        self.message.setText(message)

    def show_last_run(self, path: Path) -> None:
        # One line, or the window outgrows a small screen; the tip has the whole path.
        self.last_run.setText(f"Last run: {path.name}")
        self.last_run.setToolTip(plain_tip(str(path)))

    def _arrange(self, actions: list[QAction]) -> None:
        grid = QGridLayout()
        grid.setVerticalSpacing(2)
        grid.setColumnStretch(1, 1)
        for column, title in enumerate(("shortest", "ratio", "count"), start=1):
            grid.addWidget(make_label(self, title, look="faint"), 0, column)
        self.star.add_to_grid(grid, 1)
        self.photograph.add_to_grid(grid, 3)
        folder = fill_layout(
            QHBoxLayout(), make_label(self, "Folder"), (self.folder, 1), self.browse
        )
        wide = ((make_tool_button(self, action, wide=True), 1) for action in actions)
        asked = grid, self.summary, folder, fill_layout(QHBoxLayout(), *wide)
        told = self.bar, self.message, self.times, self.last_run, 1
        fill_layout(QVBoxLayout(self), *asked, *told, margins=PANEL_MARGINS, spacing=5)

    def _sum_up(self) -> None:
        """Say how many frames the requested brackets have, and their size."""
        star, photograph = self.star.bracket, self.photograph.bracket
        if isinstance(star, SNRBracket) or isinstance(photograph, SNRBracket):
            self.summary.setText(
                "As many exposures as the metered light needs, each with "
                f"{DARK_FRAMES} dark frames, with the neutral and the chosen pattern."
            )
            return
        darks = len({*star.exposures_ms, *photograph.exposures_ms}) * DARK_FRAMES
        # Star and photograph are taken with two patterns, the neutral and the chosen one.
        repeats = 1 if isinstance(star, ProposedBracket) else STAR_FRAMES
        stars = star.count * repeats * 2
        photographs = photograph.count * 2
        total = darks + stars + photographs
        size = f", {total * self._frame_bytes / 1e6:.0f} MB" if self._frame_bytes else ""
        self.summary.setText(
            f"{total} frames{size}: {darks} dark, {stars} star and {photographs} photograph, "
            "with the neutral and the chosen pattern."
        )

    def _choose_folder(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, "Folder for runs", self.folder.text())
        if folder:
            self.folder.setText(folder)


def _describe(run: RunInfo) -> str:
    """Describe what a run of the queue is doing now."""
    if run.state is State.PAUSED:
        return "paused"
    return f"pausing after this frame: {run.message}" if run.pause_requested else run.message
