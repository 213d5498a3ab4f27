"""Marks on the live picture that a person moves: a region, a line and a cross-hair."""

from __future__ import annotations

import pyqtgraph as pg
from PySide6.QtCore import QObject, Qt, Signal

from labapp.window.measuring_messages import PixelLine, PixelRegion, StarReading
from labapp.window.picture_view import PictureView
from labapp.window.theme import ACCENT, REAL

_FIRST_REGION = 96
"""Side of the first region in pixels. Chosen: a star out of focus, with dark around it."""

_LEAST_REGION = 8
"""Least side of a region in pixels: a star's shape can't be told in less."""

_LEVEL = 10
"""Height of the marks above the picture, as Qt draws higher numbers later."""


class PictureMarks(QObject):
    """Draw and move the marks; `changed` is emitted when region or line lie somewhere else.

    Places are in pixels of the camera, whatever the zoom is.
    """

    changed = Signal()

    def __init__(self, picture: PictureView) -> None:
        super().__init__(picture)
        self._picture = picture
        self._shape = (1, 1)
        pen = pg.mkPen(ACCENT, width=2)
        self._region = pg.RectROI((0, 0), (1, 1), pen=pen, scaleSnap=True, translateSnap=True)
        self._region.addScaleHandle((0, 0), (1, 1))
        self._line = pg.LineSegmentROI(((0, 0), (1, 1)), pen=pen)
        thin = pg.mkPen(REAL, style=Qt.PenStyle.DashLine)
        self._cross = [pg.InfiniteLine(angle=angle, pen=thin, movable=True) for angle in (0, 90)]
        self._star = pg.ScatterPlotItem(symbol="o", pxMode=False, pen=pg.mkPen(REAL), brush=None)
        for item in (self._region, self._line, *self._cross, self._star):
            item.setZValue(_LEVEL)
            item.hide()
            picture.box.addItem(item, ignoreBounds=True)
        for roi in (self._region, self._line):
            roi.sigRegionChangeFinished.connect(lambda _: self.changed.emit())

    def adopt_shape(self, shape: tuple[int, int]) -> None:
        """Put the marks where they begin in pictures of (rows, columns)."""
        self._shape = shape
        rows, columns = shape
        self.place_region((rows / 2, columns / 2))
        (start, end), middle = self._line.getHandles(), rows / 2
        start.setPos(self._line.mapFromParent(pg.Point(columns / 4, middle)))
        end.setPos(self._line.mapFromParent(pg.Point(3 * columns / 4, middle)))
        # The optical axis is in the middle of pixel n // 2.
        self._cross[0].setValue(rows // 2 + 0.5)
        self._cross[1].setValue(columns // 2 + 0.5)

    def place_region(self, centre: tuple[float, float], side: int = _FIRST_REGION) -> None:
        """Put the region around a place (row, column), within the picture."""
        sizes = [min(side, n) for n in self._shape]
        top, left = (
            min(max(round(c - size / 2), 0), n - size)
            for c, size, n in zip(centre, sizes, self._shape, strict=True)
        )
        self._region.setPos((left, top), finish=False)
        self._region.setSize((sizes[1], sizes[0]), finish=True)

    def show_region(self, on: bool) -> None:
        """Show or hide the region, which is measured as long as it is shown."""
        self._region.setVisible(on)
        self._star.setVisible(on)
        self.changed.emit()

    def show_line(self, on: bool) -> None:
        """Show or hide the line, along which numbers are measured while it is shown."""
        self._line.setVisible(on)
        self.changed.emit()

    def show_cross(self, on: bool) -> None:
        """Show or hide the cross-hair, which begins on the axis and can be dragged."""
        for line in self._cross:
            line.setVisible(on)

    def show_star(self, star: StarReading | None) -> None:
        """Show a ring as wide as the star that was measured in the region."""
        if star is None:
            self._star.setData([], [])
        else:
            self._star.setData([star.x + 0.5], [star.y + 0.5], size=max(2 * star.fwhm, 1.0))

    @property
    def region(self) -> PixelRegion | None:
        """Return the region in whole pixels; None while it is hidden."""
        if not self._region.isVisible():
            return None
        place, size = self._region.pos(), self._region.size()
        sides = (max(round(one), _LEAST_REGION) for one in (size.y(), size.x()))
        return (round(place.y()), round(place.x()), *sides)

    @property
    def line(self) -> PixelLine | None:
        """Return both ends of the line; None while it is hidden."""
        if not self._line.isVisible():
            return None
        # Between pixels, the picture's coordinates are half a pixel beyond those of their centres.
        start, end = (self._line.mapToParent(handle.pos()) for handle in self._line.getHandles())
        return (start.y() - 0.5, start.x() - 0.5), (end.y() - 0.5, end.x() - 0.5)

    @property
    def cross(self) -> tuple[float, float]:
        """Return where the cross-hair is, (row, column); pixel centres are whole."""
        return self._cross[0].value() - 0.5, self._cross[1].value() - 0.5
