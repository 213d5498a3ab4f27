"""Requests from the panel of alignment to the engine, and what comes back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QObject

from labapp.window.commands import CancelJob
from labapp.window.engine_connection import EngineConnection
from labapp.window.exposure_bracket import ProposedBracket
from labapp.window.measuring_messages import (
    BracketProposal,
    ExposureFound,
    FindExposure,
    FindStar,
    KeepPicture,
    MeasurePictures,
    PictureMeasured,
    ProposeBracket,
    StarFound,
)
from labapp.window.messages import BenchOpened, JobEnded, JobProgress
from labapp.window.picture_marks import PictureMarks
from labapp.window.setting_requests import SettingRequests

if TYPE_CHECKING:
    from labapp.window.main_window import MainWindow

_TRIAL_JOBS = ("exposure", "bracket proposal")
"""Names of the engine's jobs that try exposures."""


class AlignmentRequests(QObject):
    """Turn the panel's buttons and the marks on the picture into commands to the engine."""

    def __init__(
        self, window: MainWindow, connection: EngineConnection, settings: SettingRequests
    ) -> None:
        super().__init__(window)
        self._window, self._send, self._settings = window, connection.send, settings
        self._panel = panel = window.alignment
        self.marks = PictureMarks(window.live_view.picture)
        self._asked = MeasurePictures(None, None)
        self.marks.changed.connect(self._measure)
        panel.region.toggled.connect(self.marks.show_region)
        panel.line.toggled.connect(self.marks.show_line)
        panel.cross.toggled.connect(self.marks.show_cross)
        panel.true_size_requested.connect(window.live_view.picture.show_true_size)
        panel.star_requested.connect(lambda: self._send(FindStar()))
        panel.level_requested.connect(
            lambda level: self._send(FindExposure(level, self.marks.region))
        )
        panel.bracket_requested.connect(self._propose)
        panel.proposal_accepted.connect(self._use_proposal)
        panel.picture_kept.connect(self._keep)
        panel.cancel_requested.connect(self._cancel)

    def open_bench(self, bench: BenchOpened) -> None:
        """Begin with the pictures of a newly opened bench."""
        self.marks.adopt_shape(bench.camera_shape)
        self._panel.forget_course()
        self._asked = MeasurePictures(None, None)
        self._measure()

    def show_measured(self, measured: PictureMeasured) -> None:
        """Show what was measured, and a ring around the star."""
        cross = self.marks.cross if self._panel.cross.isChecked() else None
        self._panel.show_measured(measured, cross)
        self.marks.show_star(measured.region.star if measured.region else None)

    def show_star(self, found: StarFound) -> None:
        """Put the region around the star that was found, or say why there is none."""
        if found.place is None:
            self._panel.show_said(f"No star: {found.why_not}.")
            return
        y, x = found.place
        self.marks.place_region((y + 0.5, x + 0.5))
        self._panel.region.setChecked(True)
        self._panel.show_said(f"A star at x {x:.1f}, y {y:.1f}. Its width is measured below.")

    def show_exposure(self, found: ExposureFound) -> None:
        """Show the exposure that was found, and take it over into its field."""
        self._panel.show_exposure(found)
        self._settings.note_exposure(found.exposure)

    def show_progress(self, progress: JobProgress) -> None:
        """Show which exposure is tried, if it is a job of this panel."""
        if progress.job in _TRIAL_JOBS:
            self._panel.show_busy(progress.message)

    def show_job_end(self, ended: JobEnded) -> None:
        """Note that no more exposures are tried."""
        if ended.job in _TRIAL_JOBS:
            self._panel.show_job_end()

    def _measure(self) -> None:
        """Ask for measurements where the marks are now, if they have moved."""
        asked = MeasurePictures(self.marks.region, self.marks.line)
        if asked != self._asked:
            self._asked = asked
            self._send(asked)

    def _propose(self, row: str) -> None:
        fields = getattr(self._window.run, row)
        self._send(ProposeBracket(row, fields.snr.value(), fields.decades.value()))

    def _use_proposal(self, proposal: BracketProposal) -> None:
        """Take a proposed bracket over into its row of fields."""
        why = f"proposed on {proposal.target} with {proposal.pattern}"
        getattr(self._window.run, proposal.row).propose(ProposedBracket(proposal.exposures_ms, why))
        self._panel.show_said("Taken over. F6 puts the bracket in line.")

    def _keep(self) -> None:
        number = self._window.live_view.shown_number
        if number is None:
            self._panel.show_said("There is no picture yet. Start live view with F5.")
        else:
            self._send(KeepPicture(number, self._window.run.chosen_folder))

    def _cancel(self) -> None:
        for job in _TRIAL_JOBS:
            self._send(CancelJob(job))
