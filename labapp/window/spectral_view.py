"""A spectral cube: colours, bands, spectra, and maps of what is wrong."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QComboBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSlider,
    QVBoxLayout,
    QWidget,
)

from labapp.window import tone_mapping
from labapp.window.colour_scale import ColourScale, rising_palette, signed_palette
from labapp.window.cube_description import describe_cube
from labapp.window.picture_view import PictureView
from labapp.window.spectral_messages import CubeColours, SpectralResult
from labapp.window.spectrum_plot import SpectrumPlot
from labapp.window.widgets import LayoutPart, fill_layout, make_label, plain_tip

LIGHTS = {
    "D65": "daylight",
    "D50": "warmer daylight, for prints",
    "A": "halogen lamp",
    "FL2": "fluorescent lamp",
    "LED-B3": "LED lamp",
    "E": "equal energy at all wavelengths",
}
"""CIE illuminants to choose from, and what they are in words."""

_HIGHEST = 99.9
"""Percentile of a cube's values that the plot of spectra has room for, but at least white. Chosen:
single bright pixels would make all other spectra flat."""


class SpectralView(QWidget):
    """Show a restored cube in a light, band by band, with the spectrum under the mouse.

    A click holds the spectrum at a pixel; another click lets it follow the mouse again.
    `light_requested` is emitted with the name of a light when a person chooses it.
    """

    light_requested = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._result: SpectralResult | None = None
        self._colours: CubeColours | None = None
        self._pixel = (0, 0)
        self._held = self._truth_only = self._snapshot_only = False
        self._grey = tone_mapping.build_palette(mark_clipping=False)
        self.light = QComboBox(self)
        for name, words in LIGHTS.items():
            self.light.addItem(name)
            self.light.setItemData(self.light.count() - 1, words, Qt.ItemDataRole.ToolTipRole)
        self.light.setToolTip("CIE illuminant in which the cube is shown: A is a halogen lamp")
        self.truth = QPushButton("Truth", self)
        self.truth.setToolTip("While you hold it, the true cube is seen instead of the restored")
        self.truth.setEnabled(False)
        self.band = QSlider(Qt.Orientation.Horizontal, self)
        self.band.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.band.setTickPosition(QSlider.TickPosition.TicksBelow)
        self.band.setPageStep(1)
        self.band.setToolTip("Band of the cube; with the keyboard, Alt+B and the arrows")
        self.wavelength = make_label(self)
        self.map = QComboBox(self)
        self.scale = ColourScale(self)
        self.colour_picture, self.band_picture, self.map_picture = (
            PictureView(self) for _ in range(3)
        )
        self.captions = [make_label(picture, look="caption") for picture in self._pictures]
        self.spectrum = SpectrumPlot(self)
        self.place = make_label(self)
        self.note = make_label(self, look="faint", wrap=True)
        self._arrange()
        self._connect()

    def show_result(self, result: SpectralResult) -> None:
        """Show a restored cube, in its middle band and at its middle pixel."""
        self._result, self._held = result, False
        bands, rows, columns = result.values.shape
        for box in (self.band, self.map):
            box.blockSignals(True)
        kept = self.band.value() if self.band.maximum() == bands - 1 else bands // 2
        self.band.setRange(0, bands - 1)
        self.band.setValue(kept)
        self._fill_maps(result)
        for box in (self.band, self.map):
            box.blockSignals(False)
        self.truth.setEnabled(result.truth is not None)
        self._show_axes(result)
        self._pixel = rows // 2, columns // 2
        self.show_colours(result.colours)
        self._show_band()
        self._show_pixel()
        self.note.setToolTip(plain_tip("\n".join((str(result.path), *result.notes))))
        for picture in self._pictures:
            picture.fit()

    def show_colours(self, colours: CubeColours) -> None:
        """Show the cube's colours in a light; ask for others if the person has chosen another."""
        if self._result is None:
            return
        self._colours = colours
        if colours.light != self.light.currentText():
            self.light_requested.emit(self.light.currentText())
        self.note.setText(describe_cube(self._result, colours))
        self._show_colours()

    def show_only_snapshot(self, on: bool) -> None:
        """Show the snapshot in the place of the cube's colours, or these again."""
        self._snapshot_only = on
        self._show_colours()

    def show_only_truth(self, on: bool) -> None:
        """Show the true cube in the place of the restored one, or this one again."""
        self._truth_only = on
        self._show_colours()
        self._show_band()

    @property
    def _pictures(self) -> tuple[PictureView, PictureView, PictureView]:
        return self.colour_picture, self.band_picture, self.map_picture

    def _arrange(self) -> None:
        grid = QGridLayout()
        grid.setSpacing(6)
        grid.setHorizontalSpacing(12)
        height = self.truth.sizeHint().height()
        light, band, map_ = (
            self._title(text, field)
            for text, field in (("&Light", self.light), ("&Band", self.band), ("&Map", self.map))
        )
        tiles = (
            _tile(self.colour_picture, height, light, self.light, 1, self.truth),
            _tile(self.band_picture, height, band, (self.band, 1), self.wavelength),
            _tile(self.map_picture, height, map_, self.map, 1, self.scale),
            _tile(self.spectrum, height, self.place, 1),
        )
        for number, tile in enumerate(tiles):
            row, column = divmod(number, 2)
            grid.addWidget(tile, row, column)
            grid.setRowStretch(row, 1)
            grid.setColumnStretch(column, 1)
        fill_layout(QVBoxLayout(self), (grid, 1), self.note, spacing=4)
        # Otherwise Tab would stop at each picture, where keys do nothing.
        for before, after in pairwise((self.light, self.truth, self.band, self.map)):
            self.setTabOrder(before, after)
        self.wavelength.setMinimumWidth(self.fontMetrics().horizontalAdvance("1000.5 nm"))
        for caption in self.captions:
            caption.move(6, 6)
            caption.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
            caption.hide()

    def _title(self, text: str, field: QWidget) -> QLabel:
        """Return the title of a field; its Alt key moves the focus to the field."""
        label = make_label(self, text)
        label.setBuddy(field)
        return label

    def _connect(self) -> None:
        self.light.currentTextChanged.connect(self._request_light)
        self.band.valueChanged.connect(self._show_band)
        self.map.currentIndexChanged.connect(self._show_map)
        self.truth.pressed.connect(lambda: self.show_only_truth(True))
        self.truth.released.connect(lambda: self.show_only_truth(False))
        for picture in self._pictures:
            picture.pixel_hovered.connect(self._hover)
            picture.pixel_clicked.connect(self._hold)
            if picture is not self.colour_picture:
                picture.link(self.colour_picture)

    def _request_light(self, name: str) -> None:
        if self._result is not None:
            self.light_requested.emit(name)

    def _fill_maps(self, result: SpectralResult) -> None:
        """Offer the maps of a cube; the chosen one stays if there is one like it."""
        before = self.map.currentText()
        self.map.clear()
        for one in result.maps:
            self.map.addItem(one.title)
            self.map.setItemData(self.map.count() - 1, one.explanation, Qt.ItemDataRole.ToolTipRole)
        self.map.setCurrentIndex(max(self.map.findText(before), 0))

    def _show_axes(self, result: SpectralResult) -> None:
        """Set the range of the plot, in which all cubes of a result have room."""
        known = [one for one in (result.values, result.truth) if one is not None]
        highest = max(1.0, *(float(np.percentile(one, _HIGHEST)) for one in known))
        nanometres = np.round(1e9 * np.array(result.wavelengths), 3)
        self.spectrum.show_axes(
            nanometres,
            highest,
            truth=result.truth is not None,
            error=result.error is not None,
        )

    def _show_colours(self) -> None:
        result, colours = self._result, self._colours
        if result is None or colours is None:
            return
        shown, words = colours.restored, f"restored, in {colours.light}"
        if colours.difference is not None:
            words += f"  ·  CIEDE2000 {colours.difference:.1f}"
        if self._snapshot_only:
            shown, words = result.snapshot, "snapshot, bare pixels"
        elif self._truth_only and colours.true is not None:
            shown, words = colours.true, f"true, in {colours.light}"
        self.colour_picture.show_indices(shown, self._grey)
        self._write(self.captions[0], words)

    def _show_band(self) -> None:
        result, band = self._result, self.band.value()
        if result is None:
            return
        name = f"{result.wavelengths[band] * 1e9:.4g} nm"
        self.wavelength.setText(name)
        grey, words = result.grey, f"restored, {name}"
        if (quality := result.quality) is not None:
            words = f"{name}  ·  PSNR {quality.psnr[band]:.1f} dB, SSIM {quality.ssim[band]:.3f}"
        if self._truth_only and result.true_grey is not None:
            grey, words = result.true_grey, f"true, {name}"
        self.band_picture.show_indices(grey[band], self._grey)
        self._write(self.captions[1], words)
        self.spectrum.mark_band(band)
        self._show_map()

    def _show_map(self) -> None:
        result = self._result
        if result is None or self.map.currentIndex() < 0:
            return
        shown = result.maps[self.map.currentIndex()]
        palette = signed_palette() if shown.lowest < 0 else rising_palette()
        band = min(self.band.value(), len(shown.levels) - 1)
        self.map_picture.show_indices(shown.levels[band], palette)
        self.scale.show_scale(palette, shown.lowest, shown.highest)
        which = "all bands" if len(shown.levels) == 1 else self.wavelength.text()
        self._write(self.captions[2], f"{which}  ·  {shown.caption}")
        self.map.setToolTip(shown.explanation)

    def _hover(self, row: int, column: int) -> None:
        if self._result is not None and row >= 0 and not self._held:
            self._pixel = row, column
            self._show_pixel()

    def _hold(self, row: int, column: int) -> None:
        """Hold the spectrum at a pixel, or let it follow the mouse again."""
        if self._result is None:
            return
        self._held, self._pixel = not self._held, (row, column)
        self._show_pixel()

    def _show_pixel(self) -> None:
        result, (row, column) = self._result, self._pixel
        if result is None:
            return
        spectra = [
            None if cube is None else cube[:, row, column]
            for cube in (result.values, result.truth, result.error)
        ]
        self.spectrum.show_spectrum(result.values[:, row, column], *spectra[1:])
        step = result.pixel_step
        self.place.setText(
            f"Spectrum at x {column * step}, y {row * step}"
            + (", held: click to let it go" if self._held else "; click to hold it")
        )
        for picture in self._pictures:
            picture.mark_pixel(row, column)

    def _write(self, caption: QLabel, words: str) -> None:
        caption.setText(words)
        caption.adjustSize()
        caption.show()


def _tile(body: QWidget, height: int, *head: LayoutPart | tuple[LayoutPart, int] | int) -> QWidget:
    """Put a row of fields, `height` pixels high, above a picture or a plot."""
    made = QWidget()
    row = fill_layout(QHBoxLayout(), *head, spacing=6)
    row.addStrut(height)
    fill_layout(QVBoxLayout(made), row, (body, 1), spacing=3)
    return made
