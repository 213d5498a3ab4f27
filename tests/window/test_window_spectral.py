"""A spectral cube in the window: bands asked for, seen, compared with the truth, and saved."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import h5py
import numpy as np
import pytest
from eyes import pixels
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QApplication, QFileDialog
from small_bench.spectral import BANDS_NM, COLUMNS, ROWS, take_record
from waits import wait_until

from labapp.files.cubes import SpectralCube, read_cube
from labapp.spectral.lights import find_light
from labapp.window.engine.band_maps import list_maps
from labapp.window.engine.cube_restoration import CubeRestoration, list_bands
from labapp.window.messages import FailureReport, PictureSaved
from labapp.window.spectral_messages import (
    CubeColours,
    CubeQuality,
    RecordBands,
    SpectralResult,
)
from labapp.window.spectral_view import LIGHTS, SpectralView

BANDS = tuple(one / 1e9 for one in BANDS_NM)
SHAPE = (3, 12, 16)


def made_result(**changes) -> SpectralResult:
    """A cube of random numbers, a truth beside it, an error, and colours that aren't theirs."""
    rng = np.random.default_rng(4)
    values, truth = (rng.uniform(0, 1, SHAPE).astype(np.float32) for _ in range(2))
    error = rng.uniform(0.02, 0.3, SHAPE).astype(np.float32)
    cube = SpectralCube(values, BANDS, error=error)
    levels = rng.integers(0, 256, (5, *SHAPE[1:], 3), dtype=np.uint8)
    said = {
        "path": Path("run.h5"), "source": "photograph, ring", "wavelengths": BANDS,
        "values": values, "truth": truth, "error": error,
        "grey": rng.integers(0, 256, SHAPE, dtype=np.uint8),
        "true_grey": rng.integers(0, 256, SHAPE, dtype=np.uint8),
        "snapshot": levels[2, ..., 0],
        "maps": list_maps(cube, SpectralCube(truth, BANDS), np.zeros(SHAPE[1:])),
        "pixel_step": 3, "colours": CubeColours("D65", levels[0], levels[1], 2.5, 6.25),
        "quality": CubeQuality((30.1, 31.2, 32.3), (0.9, 0.8, 0.7), 31.2, 0.8, 4.5, "a stack"),
        "white": "the sheet", "method": "total variation", "noise": 12.0, "iterations": 40,
        "residual": 1.01, "verdict": "good", "notes": ("a remark",), "cpu_seconds": 1.5,
    }  # fmt: skip
    return SpectralResult(**(said | changes))


@pytest.fixture
def view(dark_theme, qtbot):
    made = SpectralView()
    qtbot.addWidget(made)
    made.resize(900, 700)
    made.show()
    qtbot.waitExposed(made)
    made.show_result(made_result())
    return made


def seen_at(picture, row, column) -> np.ndarray:
    """What the screen shows in a pixel of a picture, beside its middle, where the cross may be."""
    place = picture.pixel_position(row, column)
    beside = picture.pixel_position(row, column + 1).x() - place.x()
    shot = pixels(picture)
    return shot[round(place.y()), round(place.x() + 0.35 * beside)].astype(int)


def shows(picture, levels, pixel=(3, 12)) -> bool:
    """Whether the screen has these levels in a pixel, but for the palette's rounding.

    In a small window a pixel of the screen may show the one beside it.
    """
    row, column = pixel
    near = levels[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].astype(int)
    away = np.abs(near.reshape(near.shape[0] * near.shape[1], -1) - seen_at(picture, *pixel))
    return bool((away.max(1) <= 2).any())


def moves_to(qtbot, picture, row, column):
    port = picture._view.viewport()
    place = picture.pixel_position(row, column).toPoint()
    qtbot.mouseMove(port, place + QPoint(9, 0))
    qtbot.wait(30)  # Moves that follow within 10 ms are dropped by pyqtgraph.
    qtbot.mouseMove(port, place)
    qtbot.wait(30)
    return port, place


def test_the_slider_is_reached_and_moved_by_keys(view, qtbot):
    result = view._result
    assert view.band.value() == 1
    wait_until(lambda: shows(view.band_picture, result.grey[1]))
    view.activateWindow()
    wait_until(view.isActiveWindow)
    view.light.setFocus()
    wait_until(view.light.hasFocus)
    for field in (view.truth, view.band):
        qtbot.keyClick(QApplication.focusWidget(), Qt.Key.Key_Tab)
        wait_until(field.hasFocus)
    qtbot.keyClick(view.band, Qt.Key.Key_Right)
    wait_until(lambda: shows(view.band_picture, result.grey[2]))
    assert view.wavelength.text() == "620 nm"
    assert view.captions[1].text() == "620 nm  ·  PSNR 32.3 dB, SSIM 0.700"
    for _ in range(3):
        qtbot.keyClick(view.band, Qt.Key.Key_Left)
    wait_until(lambda: shows(view.band_picture, result.grey[0]))


def test_the_spectrum_is_that_of_the_pixel_under_the_mouse(view, qtbot):
    result, plot = view._result, view.spectrum
    for picture, at in ((view.band_picture, (2, 3)), (view.map_picture, (9, 14))):
        moves_to(qtbot, picture, *at)
        words = f"x {3 * at[1]}, y {3 * at[0]};"  # of the sensor, of which every third is sent
        wait_until(lambda words=words: words in view.place.text())
        row, column = at
        assert plot.restored_spectrum == pytest.approx(result.values[:, row, column])
        assert plot.true_spectrum == pytest.approx(result.truth[:, row, column])
        low, high = plot.interval
        assert high == pytest.approx((result.values + result.error)[:, row, column])
        lower = (result.values - result.error)[:, row, column]
        assert low == pytest.approx(np.where(lower < 0, 0, lower))


def test_a_click_holds_the_spectrum_and_another_lets_it_go(view, qtbot):
    port, place = moves_to(qtbot, view.colour_picture, 5, 6)
    qtbot.mouseClick(port, Qt.MouseButton.LeftButton, pos=place)
    wait_until(lambda: "x 18, y 15, held" in view.place.text())
    port, place = moves_to(qtbot, view.colour_picture, 8, 2)
    assert "x 18, y 15, held" in view.place.text()
    assert view.spectrum.restored_spectrum == pytest.approx(view._result.values[:, 5, 6])
    # Clicks within its interval would be a double click.
    qtbot.wait(QApplication.doubleClickInterval() + 50)
    qtbot.mouseClick(port, Qt.MouseButton.LeftButton, pos=place)
    wait_until(lambda: "x 6, y 24; click" in view.place.text())


def test_while_held_truth_and_snapshot_are_seen(view, qtbot):
    colours = view._result.colours
    wait_until(lambda: shows(view.colour_picture, colours.restored))
    qtbot.mousePress(view.truth, Qt.MouseButton.LeftButton)
    wait_until(lambda: shows(view.colour_picture, colours.true))
    wait_until(lambda: shows(view.band_picture, view._result.true_grey[1]))
    qtbot.mouseRelease(view.truth, Qt.MouseButton.LeftButton)
    wait_until(lambda: shows(view.colour_picture, colours.restored))
    view.show_only_snapshot(True)
    wait_until(lambda: shows(view.colour_picture, view._result.snapshot[..., None].repeat(3, 2)))
    assert view.captions[0].text() == "snapshot, bare pixels"


def test_the_error_comes_first_and_the_difference_is_signed(view):
    result = view._result
    titles = [view.map.itemText(at) for at in range(view.map.count())]
    assert titles == ["Error", "Difference", "Unexplained"]
    error, difference, unexplained = result.maps
    # Errors are evenly spread up to 0.3, so that the next of 1, 2, 5 is 0.5.
    assert (error.lowest, error.highest) == (0, pytest.approx(0.5))
    assert error.levels == pytest.approx(510 * result.error, abs=0.51)
    assert (difference.lowest, difference.highest) == (-1, 1)
    wrong = result.values - result.truth
    assert difference.levels == pytest.approx(127.5 + 127.5 * wrong, abs=0.51)
    assert (unexplained.levels == 128).all()
    view.map.setCurrentIndex(1)
    bright, dark = (np.unravel_index(at, SHAPE) for at in (wrong.argmax(), wrong.argmin()))
    for (band, row, column), is_amber in ((bright, True), (dark, False)):
        view.band.setValue(int(band))

        def is_seen(row=row, column=column, is_amber=is_amber):
            red, _, blue = seen_at(view.map_picture, row, column)
            return (red > blue + 50) if is_amber else (blue > red + 50)

        wait_until(is_seen)
    assert view.captions[2].text().endswith("restored less true, share of white")


def test_without_truth_or_error_the_residual_is_left(view):
    cube = SpectralCube(view._result.values, BANDS)
    rest = np.full(SHAPE[1:], np.nan)
    rest[0, 0], rest[0, 1] = 2.0, -9.0
    colours = replace(view._result.colours, true=None, difference=None, largest_difference=None)
    maps = list_maps(cube, None, rest)
    view.show_result(
        made_result(
            truth=None, error=None, true_grey=None, quality=None, maps=maps, colours=colours
        )
    )
    assert not view.truth.isEnabled()
    assert view.spectrum.true_spectrum.size == 0
    assert view.spectrum.interval is None
    assert [one.title for one in maps] == ["Unexplained"]
    # From -4 to 4 times the noise; what isn't known looks like nothing.
    assert maps[0].levels[0, 0, :3].tolist() == [191, 0, 128]
    view.band.setValue(2)
    assert view.captions[2].text() == "all bands  ·  unexplained, over the noise"
    assert "PSNR" not in view.note.text()


def test_the_scores_are_said_in_words(view, qtbot):
    said = view.note.text()
    assert "Against a stack: PSNR 31.2 dB and SSIM 0.800, means of the bands" in said
    assert "spectral angle 4.5°; CIEDE2000 2.5 in D65, 6.2 at 95 % of the pixels" in said
    assert "a remark" in view.note.toolTip()
    with qtbot.waitSignal(view.light_requested) as asked:
        view.light.setCurrentText("A")
    assert asked.args == ["A"]
    # Colours that come late, in a light that isn't chosen any more, are asked for again.
    with qtbot.waitSignal(view.light_requested):
        view.show_colours(view._result.colours)
    view.show_colours(replace(view._result.colours, light="A", difference=3.5))
    assert "CIEDE2000 3.5 in A" in view.note.text()
    assert view.captions[0].text() == "restored, in A  ·  CIEDE2000 3.5"


def test_every_light_that_is_offered_is_known():
    assert [find_light(one).name for one in LIGHTS] == list(LIGHTS)


def test_of_a_large_cube_every_third_pixel_is_sent():
    values = np.random.default_rng(5).uniform(0, 1, (2, 4, 2500)).astype(np.float32)
    cube = SpectralCube(values, BANDS[:2], error=values / 8)
    restored = SimpleNamespace(
        cube=cube, truth=None, scores=None, residual_map=np.zeros((4, 2500)), verdict="good",
        cpu_seconds=1.0, doubts="alike",
        image=SimpleNamespace(method="tv", noise=1.0, iterations=1, residual=1.0),
    )  # fmt: skip
    problem = SimpleNamespace(
        source="run.h5, photograph", rate=np.ones((4, 2500)), notes=(),
        response=SimpleNamespace(source="the sheet"),
    )  # fmt: skip
    sent = CubeRestoration(Path("run.h5"), problem, restored, find_light("E")).result_message
    assert sent.pixel_step == 3
    assert sent.source == "photograph"
    assert "alike" in sent.notes
    assert np.array_equal(sent.values, values[:, ::3, ::3])
    assert np.array_equal(sent.error, values[:, ::3, ::3] / 8)
    assert sent.colours.restored.shape == (2, 834, 3)
    assert sent.snapshot.shape == sent.maps[0].levels.shape[1:] == (2, 834)


@pytest.fixture(scope="module")
def record(tmp_path_factory) -> Path:
    return take_record(tmp_path_factory.mktemp("spectral"))


@pytest.fixture
def panel(bench, person):
    """The tab with its box "Bands" not ticked, before and after."""
    found = bench.window.reconstruction
    found.bands.setChecked(False)
    bench.reports.clear()
    yield found
    found.bands.setChecked(False)
    found.band_list.clear()


def opens(bench, person, chosen_file, path):
    """By the button "Open run" of the queue's panel."""
    chosen_file(path)
    person.clicks(bench.window.queue.buttons["open"])


def without_star(record: Path, copy: Path) -> Path:
    """A copy of a record that lacks the frames of its star."""
    shutil.copy(record, copy)
    with h5py.File(copy, "r+") as file:
        data, names = file["entry/data"], file["entry/targets/names"][()].tolist()
        data["stored"][...] = data["stored"][()] * (data["target"][()] != names.index(b"star"))
    return copy


def test_a_cube_is_restored_seen_in_a_light_and_saved(
    bench, person, panel, chosen_file, record, tmp_path, monkeypatch
):
    window, view = bench.window, panel.spectra
    person.chooses(view.light, "D65")
    # Without "Bands", no wavelength is chosen: it says what to do.
    opens(bench, person, chosen_file, record)
    person.waits(lambda: "Not restored: it has several wavelengths" in panel.note.text())
    assert not window.message.is_error
    person.waits(lambda: panel.band_list.placeholderText() == "all: 460, 540, 620 nm")
    assert "tick Bands to restore a spectral cube (F7)" in panel.note.text()

    window.tabs.setCurrentWidget(panel)
    person.clicks(panel.bands)
    assert panel.band_list.isVisible()
    assert not panel.method.isVisible()
    person.waits(window.actions_["reconstruct"].isEnabled)
    window.tabs.setCurrentWidget(window.side_by_side)
    person.presses(Qt.Key.Key_F7)
    person.waits(lambda: bench.last(SpectralResult) is not None)
    result = bench.last(SpectralResult)
    person.waits(lambda: window.tabs.currentWidget() is panel)
    assert panel.shows_cube
    assert result.wavelengths == pytest.approx(BANDS)
    assert result.values.shape == (3, ROWS, COLUMNS)
    assert result.pixel_step == 1
    assert f"PSNR {result.quality.mean_psnr:.1f} dB" in view.note.text()
    person.waits(lambda: shows(view.colour_picture, result.colours.restored, (40, 70)))

    # In the light of a halogen lamp, to which the eye is adapted, other colours are seen.
    person.chooses(view.light, "A")
    person.waits(lambda: view.captions[0].text().startswith("restored, in A"))
    lamp = bench.last(CubeColours)
    assert lamp.light == "A"
    assert not np.array_equal(lamp.restored, result.colours.restored)
    person.waits(lambda: shows(view.colour_picture, lamp.restored, (40, 70)))

    def saves(file):
        monkeypatch.setattr(QFileDialog, "getSaveFileName", staticmethod(lambda *_: (file, "")))
        person.clicks(panel.save)

    saves(str(tmp_path / "leaf.h5"))
    person.waits(lambda: bench.last(PictureSaved) is not None)
    assert np.array_equal(read_cube(tmp_path / "leaf.h5").values, result.values)
    saves(str(tmp_path / "leaf.png"))
    person.waits(lambda: bench.last(PictureSaved).path.name == "leaf.png")
    saved = cv2.imread(str(tmp_path / "leaf.png"))[..., ::-1]
    assert np.array_equal(saved, lamp.restored)
    before = record.read_bytes()
    saves(str(record))
    person.waits(lambda: "is the record of the run" in window.message.text)
    assert record.read_bytes() == before


def test_bands_can_be_chosen_and_wrong_ones_are_refused_in_words(
    bench, person, panel, chosen_file, record, tmp_path
):
    window = bench.window
    window.tabs.setCurrentWidget(panel)
    person.clicks(panel.bands)
    person.types(panel.band_list, "620, 460")
    opens(bench, person, chosen_file, record)
    person.waits(lambda: bench.last(SpectralResult) is not None)
    assert bench.last(SpectralResult).wavelengths == pytest.approx((460e-9, 620e-9))
    for typed, words in (
        ("green", "Bands green: isn't a list of numbers"),
        ("460,690", "Bands 690:"),
        ("540", "is one band"),
    ):
        person.waits(window.actions_["reconstruct"].isEnabled)
        bench.reports.clear()
        person.types(panel.band_list, typed)
        person.presses(Qt.Key.Key_F7)
        person.waits(lambda: bench.last(FailureReport) is not None)
        person.waits(lambda words=words: words in window.message.text)
    panel.band_list.clear()
    opens(bench, person, chosen_file, without_star(record, tmp_path / "lost.h5"))
    person.waits(lambda: "has no star 'star' with pattern 'ring' at 460" in window.message.text)
    person.waits(window.actions_["reconstruct"].isEnabled)


def test_what_is_no_record_has_no_bands(tmp_path):
    (tmp_path / "run.h5").write_text("not a record")
    for path in (tmp_path / "run.h5", tmp_path / "none.h5"):
        assert list_bands(path) == RecordBands(path, ())
