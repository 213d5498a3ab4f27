"""Choosing a pattern: its preview first, and on the SLM only when asked."""

import cv2
import numpy as np
from PySide6.QtCore import Qt

from labapp.window.messages import PatternPreview


def test_a_pattern_changes_the_picture(bench, person):
    before = bench.frame.image.astype(float)
    person.chooses(bench.window.pattern.form.kind, "Axicon")
    person.waits(lambda: "axicon" in bench.last(PatternPreview).name)
    assert bench.window.pattern.shown.text() == "On the SLM: neutral"
    assert bench.frame.pattern == "neutral"
    person.clicks(bench.window.pattern.show_button)
    name = "axicon 80 µm for 550 nm"
    person.waits(lambda: bench.frame.pattern == name)
    person.waits(lambda: bench.window.pattern.shown.text() == f"On the SLM: {name}")
    assert name in bench.window.live_view.caption.text()
    after = bench.frame.image.astype(float)
    # The axicon blurs: detail goes, light stays.
    assert np.diff(after).std() < 0.5 * np.diff(before).std()
    assert abs(after.mean() - before.mean()) < 0.1 * before.mean()


def test_the_previewed_psf_is_a_ring(bench, person):
    person.chooses(bench.window.pattern.form.kind, "Ring")
    person.types(bench.window.pattern.form.numbers["ring", "radius_um"], "100")
    person.waits(lambda: bench.last(PatternPreview).name.startswith("ring 100/"))
    psf = bench.last(PatternPreview).psf
    y, x = np.indices(psf.shape) - psf.shape[0] // 2
    distance = np.hypot(y, x) * 3.45
    # The unmodulated light stands in the middle; beyond it, most light is on the ring.
    ring, elsewhere = np.abs(distance - 100) < 20, distance > 15
    assert psf[ring].sum() > 0.7 * psf[elsewhere].sum()
    person.waits(lambda: "Predicted PSF" in bench.window.pattern.note.text())
    assert len(np.unique(person.looks_at(bench.window.pattern.psf))) > 30


def test_a_picture_of_the_wrong_size_is_refused_in_words(bench, person, tmp_path):
    path = tmp_path / "small.png"
    cv2.imwrite(str(path), np.zeros((10, 20), np.uint8))
    person.chooses(bench.window.pattern.form.kind, "Image file")
    person.types(bench.window.pattern.form.file, str(path))
    person.waits(lambda: bench.window.message.is_error)
    assert "20x10 pixels; the panel needs 1920x1080" in bench.window.message.text
    count = bench.frames
    person.waits(lambda: bench.frames > count + 3)
    person.clicks(bench.window.message)
    assert not bench.window.message.is_error


def test_a_picture_of_the_right_size_is_shown(bench, person, tmp_path):
    path = tmp_path / "checks.png"
    checks = (np.indices((1080, 1920)) // 4).sum(axis=0) % 2 * 60
    cv2.imwrite(str(path), checks.astype(np.uint8))
    person.chooses(bench.window.pattern.form.kind, "Image file")
    person.types(bench.window.pattern.form.file, str(path))
    person.clicks(bench.window.pattern.show_button)
    person.waits(lambda: bench.frame.pattern == "image checks.png")


def test_reset_layout_brings_panels_back(bench, person):
    dock = bench.window.pattern.parentWidget()
    dock.setFloating(True)
    person.clicks(bench.window.bar.buttons["reset"])
    assert not dock.isFloating()
    assert bench.window.dockWidgetArea(dock) == Qt.DockWidgetArea.LeftDockWidgetArea
