"""Choosing a pattern: its preview first, and on the SLM only when asked."""

import cv2
import numpy as np
import pytest
from PySide6.QtCore import Qt

from labapp.window.engine.plan_building import validate_pattern
from labapp.window.messages import PatternPreview
from labapp.window.pattern_kinds import PATTERN_KINDS, NumberField, TextField


def first(field):
    """What a field holds in a new window."""
    return field.initial if isinstance(field, NumberField | TextField) else "picture.png"


@pytest.mark.parametrize("kind", PATTERN_KINDS, ids=lambda kind: kind.name)
def test_every_kind_is_a_pattern_of_a_plan_at_its_limits(kind):
    """Fields that a plan file doesn't know, or that reach too far, would be told to nobody."""
    values = {field.key: first(field) for field in kind.fields}
    coded = {"wavelength_nm": 500.0} if kind.needs_wavelength else {}
    spec = validate_pattern(kind.build_table(values) | coded)
    assert spec.label.endswith("for 500 nm") == kind.needs_wavelength
    for field in kind.fields:
        if isinstance(field, NumberField) and field.unit not in (" m", " pixels"):
            for limit in (field.low, field.high):
                validate_pattern(kind.build_table(values | {field.key: limit}) | coded)


def preview_name(bench) -> str:
    """Of the latest preview; empty until there is one."""
    preview = bench.last(PatternPreview)
    return preview.name if preview else ""


def test_a_pattern_changes_the_picture(bench, person):
    before = bench.frame.image.astype(float)
    person.chooses(bench.window.pattern.form.kind, "Axicon")
    person.types(bench.window.pattern.form.numbers["axicon", "radius_um"], "20")
    person.waits(lambda: "axicon 20" in preview_name(bench))
    assert bench.window.pattern.displayed_label.text() == "≠ On the SLM: neutral"
    assert bench.frame.pattern == "neutral"
    person.clicks(bench.window.pattern.show_button)
    name = "axicon 20 µm for 550 nm"
    person.waits(lambda: bench.frame.pattern == name)
    person.waits(lambda: bench.window.pattern.displayed_label.text() == f"On the SLM: {name}")
    assert name in bench.window.live_view.caption.text()
    after = bench.frame.image.astype(float)
    # The axicon blurs: detail goes, light stays.
    assert np.diff(after).std() < 0.5 * np.diff(before).std()
    assert abs(after.mean() - before.mean()) < 0.1 * before.mean()


def test_the_previewed_psf_is_a_ring(bench, person):
    person.chooses(bench.window.pattern.form.kind, "Ring")
    person.types(bench.window.pattern.form.numbers["ring", "radius_um"], "100")
    person.waits(lambda: preview_name(bench).startswith("ring 100/"))
    psf = bench.last(PatternPreview).psf
    y, x = np.indices(psf.shape) - psf.shape[0] // 2
    distance = np.hypot(y, x) * 3.45
    # The unmodulated light stands in the middle; beyond it, most light is on the ring.
    ring, elsewhere = np.abs(distance - 100) < 20, distance > 15
    assert psf[ring].sum() > 0.7 * psf[elsewhere].sum()
    person.waits(lambda: "Predicted PSF" in bench.window.pattern.note.text())
    person.waits(lambda: len(np.unique(person.looks_at(bench.window.pattern.psf))) > 30)


def test_a_psf_may_have_any_shape(bench, person):
    """The letter I: most light in a narrow column."""
    person.chooses(bench.window.pattern.form.kind, "Letters")
    person.types(bench.window.pattern.form.texts["letters", "text"], "I")
    person.waits(lambda: preview_name(bench).startswith("letters I 100/5 µm"))
    psf = bench.last(PatternPreview).psf
    y, x = (np.indices(psf.shape) - psf.shape[0] // 2) * 3.45
    beside = np.hypot(y, x) > 15
    inside = (np.abs(x) < 15) & (np.abs(y) < 65)
    assert psf[inside & beside].sum() > 0.8 * psf[beside].sum()


def test_a_pattern_that_is_too_steep_is_refused_with_the_limit(bench, person):
    person.chooses(bench.window.pattern.form.kind, "Blazed grating")
    person.waits(lambda: "blaze 40 px" in preview_name(bench))
    person.types(bench.window.pattern.form.numbers["blaze", "period_px"], "1.5")
    person.waits(lambda: bench.window.message.is_error)
    assert "1.33 pi per pixel" in bench.window.message.text
    assert "choose at least 2 pixels" in bench.window.message.text
    assert bench.window.pattern.note.text() == "no preview"
    person.clicks(bench.window.message)


def test_a_logo_is_chosen_from_a_file(bench, person, tmp_path):
    """Bright on the left only: so is the light, but for the unmodulated."""
    path = tmp_path / "logo.png"
    half = np.zeros((40, 80), np.uint8)
    half[:, :20] = 255
    cv2.imwrite(str(path), half)
    person.chooses(bench.window.pattern.form.kind, "Logo from a picture")
    person.waits(lambda: bench.window.pattern.note.text() == "choose a picture file")
    person.types(bench.window.pattern.form.texts["logo", "file"], str(path))
    person.waits(lambda: preview_name(bench).startswith("logo logo.png"))
    psf = bench.last(PatternPreview).psf
    assert psf[:, :70].sum() > 2 * psf[:, 90:].sum()


def test_a_picture_of_the_wrong_size_is_refused_in_words(bench, person, tmp_path):
    path = tmp_path / "small.png"
    cv2.imwrite(str(path), np.zeros((10, 20), np.uint8))
    person.chooses(bench.window.pattern.form.kind, "Image file")
    person.types(bench.window.pattern.form.file, str(path))
    person.waits(lambda: bench.window.message.is_error)
    assert "20x10 pixels; the panel needs 192x108" in bench.window.message.text
    count = bench.frames
    person.waits(lambda: bench.frames > count + 3)
    person.clicks(bench.window.message)
    assert not bench.window.message.is_error


def test_a_picture_of_the_right_size_is_shown(bench, person, tmp_path):
    path = tmp_path / "checks.png"
    checks = (np.indices((108, 192)) // 4).sum(axis=0) % 2 * 60
    cv2.imwrite(str(path), checks.astype(np.uint8))
    person.chooses(bench.window.pattern.form.kind, "Image file")
    person.types(bench.window.pattern.form.file, str(path))
    person.clicks(bench.window.pattern.show_button)
    person.waits(lambda: bench.frame.pattern == "image checks.png")


def test_reset_layout_brings_panels_back(bench, person):
    dock = bench.window.docks["Pattern"]
    dock.setFloating(True)
    person.clicks(bench.window.bar.buttons["reset"])
    assert not dock.isFloating()
    assert bench.window.dockWidgetArea(dock) == Qt.DockWidgetArea.LeftDockWidgetArea
