"""Panel for finding, focusing, exposing and keeping what the live picture shows."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QComboBox,
    QGridLayout,
    QHBoxLayout,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from labapp.window.exposure_bracket import list_exposures
from labapp.window.focus_history import FocusHistory
from labapp.window.measurement_plots import FocusPlots, ProfilePlot
from labapp.window.measuring_messages import (
    BracketProposal,
    ExposureFound,
    PictureMeasured,
    RegionReading,
    StarReading,
)
from labapp.window.number_fields import NumberBox
from labapp.window.widgets import BEGINS, PANEL_MARGINS, STOPS, fill_layout, make_label

_LEVEL = 60.0
"""Level of the brightest pixel in percent of full scale, to begin with. Chosen: far above the read
noise, and away from clipping by more than any lamp flickers."""

ROWS = {"Star": "star", "Photo": "photograph"}
"""Names of the brackets, as they are shown and as they are called."""


class AlignmentPanel(QScrollArea):
    """Show what is measured in the live picture, and let the person act on it.

    `level_requested` is emitted with a share of full scale, and `bracket_requested` with the name
    of the bracket that a proposal is for. `cancel_requested` ends what tries exposures.
    """

    star_requested = Signal()
    level_requested = Signal(float)
    bracket_requested = Signal(str)
    proposal_accepted = Signal(object)
    picture_kept = Signal()
    true_size_requested = Signal()
    cancel_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWidgetResizable(True)
        self.setFrameShape(QScrollArea.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        inside = QWidget(self)
        self.setWidget(inside)
        self.region = _switch("Region", "Measure within a rectangle: drag it, or its corners")
        self.line = _switch("Line", "Plot the numbers along a line: drag its ends")
        self.cross = _switch("Cross-hair", "Two lines through the picture, which can be dragged")
        self.true_size = QPushButton("1:1")
        self.true_size.setToolTip("A pixel of the camera on each pixel of the screen")
        self.find_star = QPushButton("Find star")
        self.find_star.setToolTip("Put the region around the star that stands out most")
        self.keep = QPushButton("Keep picture")
        self.keep.setToolTip("Write the picture that is shown to a file, with its settings")
        self.level = NumberBox(inside, suffix=" %", decimals=0, minimum=5, maximum=95, value=_LEVEL)
        self.level.setToolTip("Brightest pixel, hot ones aside, as a share of full scale")
        self.expose = QPushButton("Auto exposure")
        self.expose.setToolTip("Try exposures until the brightest pixel has this level")
        self.row = QComboBox(inside)
        self.row.addItems(list(ROWS))
        self.propose = QPushButton("Propose bracket")
        self.propose.setToolTip("Meter the light that is seen now, and choose exposures for it")
        self.accept = QPushButton("Use it")
        self.stop = QPushButton("Stop")
        for button, kind in ((self.expose, BEGINS), (self.propose, BEGINS), (self.stop, STOPS)):
            button.setProperty(kind, True)
        self.said = make_label(inside, look="faint", wrap=True)
        self.statistics = make_label(inside, look="readings", wrap=True)
        self.star = make_label(inside, look="readings", wrap=True)
        self.focus = make_label(inside, look="readings", wrap=True)
        self.plots = FocusPlots(inside)
        self.restart = QPushButton("Begin anew")
        self.restart.setToolTip("Forget the course of width and score, and the best values")
        self.profile = ProfilePlot(inside)
        self.history = FocusHistory()
        self._proposal: BracketProposal | None = None
        self._busy = self._exposes = self._proposes = False
        self._arrange(inside)
        self._connect()
        self.show_marks()
        self._allow()

    def set_allowed(self, *, exposes: bool, proposes: bool) -> None:
        """Set whether exposures may be tried now, and those of a proposal taken."""
        self._exposes, self._proposes = exposes, proposes
        self._allow()

    def show_busy(self, text: str) -> None:
        """Show which exposure is tried."""
        self._busy = True
        self.said.setText(text)
        self._allow()

    def show_job_end(self) -> None:
        """Show that no more exposures are tried."""
        if self._busy:
            self._busy = False
            if self.said.text().startswith("trial frame"):
                self.said.setText("")
        self._allow()

    def show_measured(
        self, measured: PictureMeasured, cross: tuple[float, float] | None = None
    ) -> None:
        """Show what was measured in a live picture, as numbers and as curves.

        cross: place of the cross-hair, (row, column), from which the star's is told.
        """
        region = measured.region
        if region is not None:
            self.history.add(measured)
            self.statistics.setText(_statistics_text(region))
            self.star.setText(_star_text(region.star, region.no_star, cross))
            self._show_course(region)
        self.profile.show_line(measured.line)

    def show_exposure(self, found: ExposureFound) -> None:
        """Show which exposure was set, and whether it reaches the level."""
        level, wanted = 100 * found.level, 100 * found.wanted
        text = (
            f"{found.exposure * 1e3:.6g} ms: the brightest pixel is at {level:.0f} % of full "
            f"scale, after {found.frames} trial frames."
        )
        if found.limit:
            remedy = "Brighten" if found.limit == "longest" else "Dim"
            text += f" {wanted:.0f} % need one beyond the {found.limit}. {remedy} the light."
        self.said.setText(text)

    def show_proposal(self, proposal: BracketProposal) -> None:
        """Show a proposed bracket until it is used or another one comes."""
        self._proposal = proposal
        self.row.setCurrentText(next(t for t, name in ROWS.items() if name == proposal.row))
        self.said.setText(_proposal_text(proposal))
        self._allow()

    def show_said(self, text: str) -> None:
        """Show how something ended that this panel was asked for."""
        self.said.setText(text)

    def forget_course(self) -> None:
        """Forget the course of width and score, as for another lens or target."""
        self.history.clear()
        self.plots.show_history(self.history)

    def show_marks(self) -> None:
        """Show only those readings whose mark is on the picture."""
        for part in (self.statistics, self.star, self.focus, self.plots, self.restart):
            part.setVisible(self.region.isChecked())
        self.profile.setVisible(self.line.isChecked())

    def _arrange(self, inside: QWidget) -> None:
        marks = QGridLayout()
        marks.setContentsMargins(0, 0, 0, 0)
        buttons = self.region, self.line, self.cross, self.true_size, self.find_star, self.keep
        for number, button in enumerate(buttons):
            marks.addWidget(button, number // 3, number % 3)
        exposing = fill_layout(QHBoxLayout(), self.level, (self.expose, 1), self.stop)
        proposing = fill_layout(QHBoxLayout(), self.row, (self.propose, 1), self.accept)
        restart = fill_layout(QHBoxLayout(), (self.focus, 1), self.restart)
        above = marks, exposing, proposing, self.said, self.star, restart
        parts = *above, self.plots, self.statistics, self.profile, 1
        fill_layout(QVBoxLayout(inside), *parts, margins=PANEL_MARGINS, spacing=5)

    def _connect(self) -> None:
        for switch in (self.region, self.line):
            switch.toggled.connect(lambda _: self.show_marks())
        self.true_size.clicked.connect(self.true_size_requested)
        self.find_star.clicked.connect(self.star_requested)
        self.keep.clicked.connect(self.picture_kept)
        self.expose.clicked.connect(lambda: self.level_requested.emit(self.level.value() / 100))
        self.propose.clicked.connect(
            lambda: self.bracket_requested.emit(ROWS[self.row.currentText()])
        )
        self.accept.clicked.connect(self._accept)
        self.stop.clicked.connect(self.cancel_requested)
        self.restart.clicked.connect(self.forget_course)

    def _accept(self) -> None:
        proposal, self._proposal = self._proposal, None
        if proposal is not None:
            self.proposal_accepted.emit(proposal)
        self._allow()

    def _allow(self) -> None:
        self.expose.setEnabled(self._exposes and not self._busy)
        self.propose.setEnabled(self._proposes and not self._busy)
        self.stop.setEnabled(self._busy)
        self.accept.setEnabled(self._proposal is not None)

    def _show_course(self, region: RegionReading) -> None:
        """Show the focus score and its share of the best, and both curves."""
        self.plots.show_history(self.history)
        best_fwhm, best = self.history.best_fwhm, self.history.best_focus
        if region.focus is None:
            self.focus.setText(f"focus: {region.no_focus}")
            return
        share = f" ({100 * region.focus / best:.0f} % of the best)" if best and best > 0 else ""
        width = "" if best_fwhm is None else f"; best FWHM {best_fwhm:.2f} px"
        self.focus.setText(f"focus {region.focus:.4g} /px²{share}{width}")


def _switch(text: str, tip: str) -> QToolButton:
    """Return a button that stays pressed as long as a mark is on the picture."""
    made = QToolButton()
    made.setText(text)
    made.setCheckable(True)
    made.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
    made.setToolTip(tip)
    return made


def _statistics_text(region: RegionReading) -> str:
    top, left, rows, columns = region.region
    return (
        f"x {left} … {left + columns - 1}  y {top} … {top + rows - 1}\n"
        f"mean {region.mean:.1f} DN  σ {region.deviation:.1f}  "
        f"{region.lowest} … {region.highest}\n"
        f"saturated {region.saturated} px  at zero {region.at_zero} px"
    )


def _star_text(star: StarReading | None, no_star: str, cross: tuple[float, float] | None) -> str:
    """Describe the star in the region, or say why there is none."""
    if star is None:
        return f"star: {no_star}"
    clipped = f"\n{star.saturated} px saturated: it looks too wide" if star.saturated else ""
    away = (
        ""
        if cross is None
        else (f"\nfrom the cross-hair: {star.x - cross[1]:+.2f} px, {star.y - cross[0]:+.2f} px")
    )
    return (
        f"FWHM {star.fwhm:.2f} px ({star.fwhm_major:.2f} x {star.fwhm_minor:.2f})\n"
        f"at x {star.x:.2f}  y {star.y:.2f}  peak {star.peak:.0f} DN{away}{clipped}"
    )


def _proposal_text(proposal: BracketProposal) -> str:
    """Describe a proposed bracket, beside the ladder that does the same quickest."""
    low, high = proposal.electrons_per_s
    count = proposal.metering_frames
    frames = "1 frame" if count == 1 else f"{count} frames"
    ladder = min(proposal.ladders, key=lambda one: one[1], default=None)
    beside = "" if ladder is None else f" The ladder {ladder[0]} takes {ladder[1]:.3g} s."
    return (
        f"{list_exposures(proposal.exposures_ms)} reach {proposal.least_snr_db:.1f} dB from "
        f"{low:.3g} to {high:.3g} electrons/s, in {proposal.seconds:.3g} s with "
        f"read-out.{beside} Metered on "
        f"{proposal.target} with {proposal.pattern} at {proposal.wavelength * 1e9:.2f} nm in "
        f"{frames}."
    )
