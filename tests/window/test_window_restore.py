"""Restoring a run's photograph in the window: chosen, cancelled, compared, saved."""

import numpy as np
import tifffile
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QFileDialog
from test_window_run import acquire_small

from labapp.window.messages import JobEnded, PictureSaved, ReconstructionResult
from labapp.window.reconstruction_view import METHODS
from optics.inverse.method_names import RESTORATIONS


def drags_divider(qtbot, person, picture, row, column):
    """The left button down on the divider, once it shows that it's under the mouse, and up."""
    port = picture._view.viewport()

    def on_divider():
        # Asked anew each time: the picture moves as the layout around it settles.
        # A large picture's pixel is wider than the divider, which lies at its left edge.
        place = picture.pixel_position(row, picture.divider.value() - 0.5).toPoint()
        qtbot.mouseMove(port, place + QPoint(40, 0))
        qtbot.wait(30)  # Moves that follow within 10 ms are dropped by pyqtgraph.
        qtbot.mouseMove(port, place)
        qtbot.wait(30)
        return picture.divider.mouseHovering

    person.waits(on_divider)
    start = picture.pixel_position(row, picture.divider.value() - 0.5).toPoint()
    end = picture.pixel_position(row, column).toPoint()
    qtbot.mousePress(port, Qt.MouseButton.LeftButton, pos=start)
    for share in (0.25, 0.5, 0.75, 1.0):
        qtbot.mouseMove(port, start + (end - start) * share)
        qtbot.wait(30)
    qtbot.mouseRelease(port, Qt.MouseButton.LeftButton, pos=end)


def test_a_photograph_is_restored_compared_and_saved(bench, person, qtbot, monkeypatch, tmp_path):
    window, view = bench.window, bench.window.reconstruction
    if window.session._last_run is None:
        assert not window.actions_["reconstruct"].isEnabled()
        assert "Nothing is reconstructed yet" in view.note.text()
        assert not view.save.isEnabled()
    acquire_small(bench, person)
    person.waits(window.actions_["reconstruct"].isEnabled)

    # Cancelled at once: nothing is shown, and it can be asked again.
    bench.reports.clear()
    person.presses(Qt.Key.Key_F7)
    assert window.tabs.currentWidget() is view
    assert not window.actions_["reconstruct"].isEnabled()
    person.presses(Qt.Key.Key_Escape)
    person.waits(lambda: bench.last(JobEnded) is not None)
    assert bench.last(ReconstructionResult) is None
    person.waits(window.actions_["reconstruct"].isEnabled)

    person.chooses(view.method, "Total variation")
    person.clicks(view.start)
    person.waits(lambda: bench.last(ReconstructionResult) is not None)
    result = bench.last(ReconstructionResult)
    person.waits(lambda: f"Residual {result.residual:.2f}" in view.note.text())
    assert "photograph, axicon 30 µm" in view.note.text()
    assert "total variation" in view.note.text()
    assert result.verdict in view.note.text()
    assert result.after.shape == result.before.shape == bench.frame.image.shape
    # Undone blur is contrast, of means of 8 x 8 pixels, in which there is little noise.
    flat, sharp = (contrast(one) for one in (result.before, result.after))
    assert sharp > flat

    # Left of the divider is the picture before: dragged to the right, more of it.
    picture = view.picture
    rows, columns = result.before.shape
    picture.fit()
    person.waits(lambda: person.looks_at(picture).std() > 5)
    drags_divider(qtbot, person, picture, rows // 2, 3 * columns // 4)
    person.waits(lambda: abs(picture.divider.value() - 0.75 * columns) < 0.05 * columns)
    beside = picture.pixel_position(rows // 2, int(0.9 * columns)).toPoint()
    within = picture.pixel_position(rows // 2, int(0.3 * columns)).toPoint()
    moved = person.looks_at(picture)
    qtbot.mousePress(view.before, Qt.MouseButton.LeftButton)
    assert not picture.captions[1].isVisible()
    # Held, the photograph before is seen on both sides; released, on the left alone.
    person.waits(lambda: patch(person.looks_at(picture), beside) != patch(moved, beside))
    person.waits(lambda: patch(person.looks_at(picture), within) == patch(moved, within))
    qtbot.mouseRelease(view.before, Qt.MouseButton.LeftButton)
    person.waits(lambda: patch(person.looks_at(picture), beside) == patch(moved, beside))

    file = tmp_path / "sharp.tiff"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", staticmethod(lambda *_: (str(file), "")))
    person.clicks(view.save)
    person.waits(lambda: bench.last(PictureSaved) is not None)
    saved = tifffile.imread(file)
    assert saved.dtype == np.float32
    # The screen shows what was saved, to half a level of sRGB's.
    shown = (result.after > 0) & (result.after < 255)
    levels, light = result.after[shown].astype(float), saved[shown]
    white = np.median(light / light_of(levels))
    assert (light >= white * light_of(levels - 0.6)).all()
    assert (light <= white * light_of(levels + 0.6)).all()
    assert shown.mean() > 0.9
    assert str(file) in window.message.text

    file = tmp_path / "sharp.gif"
    person.clicks(view.save)
    person.waits(lambda: window.message.is_error)
    assert "choose .tiff, .npy, .exr, .hdr or .png" in window.message.text


def light_of(levels: np.ndarray) -> np.ndarray:
    """By IEC 61966-2-1; levels: of 255."""
    share = levels / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def contrast(picture: np.ndarray) -> float:
    """Between neighbouring means of 8 x 8 pixels."""
    rows, columns = (n // 8 for n in picture.shape)
    blocks = picture[: 8 * rows, : 8 * columns].reshape(rows, 8, columns, 8).mean((1, 3))
    return float(np.abs(np.diff(blocks)).mean())


def patch(shot: np.ndarray, at: QPoint) -> bytes:
    """A few pixels of the screen."""
    return shot[at.y() - 6 : at.y() + 7, at.x() - 6 : at.x() + 7].tobytes()


def test_a_time_in_which_nothing_fits_is_an_error_in_words(bench, person):
    window, view = bench.window, bench.window.reconstruction
    if window.session._last_run is None:
        acquire_small(bench, person)
    person.waits(window.actions_["reconstruct"].isEnabled)
    person.chooses(view.method, "Automatic")
    person.types(view.budget, "0.01")
    person.presses(Qt.Key.Key_F7)
    person.waits(lambda: window.message.is_error)
    assert "the quickest, wiener, takes about" in window.message.text
    person.waits(window.actions_["reconstruct"].isEnabled)
    person.types(view.budget, "0")
    assert view.choices == ("auto", None, False)


def test_every_restoration_there_is_can_be_chosen():
    assert list(METHODS.values()) == ["auto", *RESTORATIONS]
    assert METHODS["Total variation"] == "total-variation"
