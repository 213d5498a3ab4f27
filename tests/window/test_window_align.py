"""Find, focus, expose, bracket and keep: by clicks, on pictures whose numbers the test knows."""

import json
import re

import numpy as np
import pytest
import tifffile
from aligning_walk import Walk, bring_nearer, defocus_nm
from person import Person
from PySide6.QtCore import Qt
from test_window_run import set_bracket
from window_scene import write_bench

from labapp.runs.record.reader import Record
from labapp.window.measuring_messages import (
    BracketProposal,
    ExposureFound,
    PictureMeasured,
    StarFound,
)
from labapp.window.messages import PictureSaved, RunEnded


def measured(bench, person):
    """The next measurement of a picture that isn't older than the one that came last."""
    newest = bench.frame.number
    bench.reports.clear()
    person.waits(
        lambda: (last := bench.last(PictureMeasured)) is not None and last.number >= newest
    )
    return bench.last(PictureMeasured)


def test_a_star_is_found_exposed_and_measured(bench, person, align):
    person.clicks(align.find_star)
    person.waits(lambda: bench.last(StarFound) is not None)
    person.waits(align.region.isChecked)
    y, x = bench.last(StarFound).place
    assert (y, x) == pytest.approx((32, 48), abs=1.5)
    person.types(align.level, "50")
    person.clicks(align.expose)
    person.waits(lambda: bench.last(ExposureFound) is not None)
    found = bench.last(ExposureFound)
    person.waits(lambda: bench.frame.exposure == found.exposure)
    assert bench.frame.image.max() == pytest.approx(64 + 0.5 * (4095 - 64), rel=0.1)
    # What is set is what the field says; nothing was set twice.
    settings = bench.window.settings
    assert settings.exposure.value() == pytest.approx(found.exposure * 1e3)
    person.waits(lambda: settings.exposure_read.text() == f"{found.exposure * 1e3:.3f} ms")
    person.waits(lambda: f"is at {100 * found.level:.0f} % of full scale" in align.said.text())
    assert found.level == pytest.approx(0.5, rel=0.06)
    seen = measured(bench, person)
    assert seen.region.star.peak == pytest.approx(0.5 * (4095 - 64), rel=0.15)
    width = re.search(r"FWHM ([\d.]+) px", align.star.text())
    assert float(width[1]) == pytest.approx(seen.region.star.fwhm, rel=0.05)
    person.waits(lambda: len(align.plots.fwhm.values) > 3 and len(align.plots.focus.values) > 3)


def test_defocus_by_the_pattern_widens_the_star_and_lowers_the_score(bench, person, align):
    person.clicks(align.find_star)
    person.waits(align.region.isChecked)
    person.clicks(align.restart)
    # A single picture makes no best one.
    person.waits(lambda: len(align.history.points) >= 5)
    sharp = measured(bench, person).region
    form = bench.window.pattern.form
    person.chooses(form.kind, "Aberrations")
    person.types(form.numbers["zernike", "spherical"], "0")
    person.types(form.numbers["zernike", "defocus"], "400")
    person.clicks(bench.window.pattern.show_button)
    person.waits(lambda: bench.frame.pattern != "neutral")
    count = bench.frames
    person.waits(lambda: bench.frames > count + 3)
    blurred = measured(bench, person).region
    assert blurred.star.fwhm > 1.3 * sharp.star.fwhm
    assert blurred.focus < 0.9 * sharp.focus
    person.waits(lambda: "of the best" in align.focus.text())
    share = float(re.search(r"\((\d+) % of the best", align.focus.text())[1])
    assert share < 90


def test_the_regions_numbers_are_those_of_the_raw_picture(bench, person, align):
    person.clicks(align.region)
    person.presses(Qt.Key.Key_F5)
    person.waits(lambda: "STOPPED" in bench.window.live_view.caption.text())
    marks = bench.window.session.alignment.marks
    marks.place_region((20, 30), 16)
    person.waits(lambda: "x 22 … 37  y 12 … 27" in align.statistics.text())
    part = bench.frame.image[12:28, 22:38]
    assert f"mean {part.mean():.1f} DN  σ {part.std():.1f}" in align.statistics.text()
    assert f"{part.min()} … {part.max()}" in align.statistics.text()
    person.presses(Qt.Key.Key_F5)


def test_the_line_shows_the_numbers_along_it(bench, person, align):
    person.clicks(align.line)
    person.waits(lambda: len(align.profile.values) > 10)
    (_, x), (_, last) = bench.window.session.alignment.marks.line
    assert (x, last) == pytest.approx((23.5, 71.5), abs=0.1)
    person.presses(Qt.Key.Key_F5)
    person.waits(lambda: "STOPPED" in bench.window.live_view.caption.text())
    image = bench.frame.image.astype(float)
    # Half a pixel below a row's centre, and half a pixel beyond a column's: the mean of four.
    rows = image[31:33].mean(axis=0)
    wanted = (rows[23:72] + rows[24:73]) / 2
    person.waits(lambda: align.profile.values == pytest.approx(list(wanted)))
    person.presses(Qt.Key.Key_F5)


def test_the_cross_hair_tells_how_far_the_star_is(bench, person, align):
    person.clicks(align.find_star)
    person.waits(align.region.isChecked)
    person.clicks(align.cross)
    assert bench.window.session.alignment.marks.cross == (32, 48)
    person.waits(lambda: "from the cross-hair" in align.star.text())
    said = align.star.text()
    x, y = (float(one) for one in re.search(r"at x ([\d.]+)  y ([\d.]+)", said).groups())
    away = (float(one) for one in re.search(r"hair: (\S+) px, (\S+) px", said).groups())
    assert tuple(away) == pytest.approx((x - 48, y - 32), abs=0.011)


def test_one_to_one_is_a_pixel_a_pixel(bench, person, align):
    picture = bench.window.live_view.picture
    person.clicks(align.true_size)
    scale = picture.devicePixelRatioF()
    person.waits(lambda: picture.box.viewPixelSize() == pytest.approx((scale, scale), rel=1e-3))
    picture.fit()


def test_a_picture_is_kept_with_its_settings(bench, person, align):
    person.presses(Qt.Key.Key_F5)
    person.waits(lambda: "STOPPED" in bench.window.live_view.caption.text())
    person.clicks(align.keep)
    person.waits(lambda: bench.last(PictureSaved) is not None)
    path = bench.last(PictureSaved).path
    with tifffile.TiffFile(path) as file:
        assert np.array_equal(file.asarray(), bench.frame.image)
        said = json.loads(file.pages[0].description)
    assert (said["target"], said["pattern"]) == ("star", "neutral")
    assert said["exposure"] == 1e-3
    assert said["wavelength"] == pytest.approx(550e-9)
    assert said["number"] == bench.frame.number
    assert said["simulated"] == ["slm", "filter", "camera", "targets"]
    person.waits(lambda: str(path) in bench.window.message.text)
    person.clicks(align.keep)
    person.waits(lambda: bench.last(PictureSaved).path != path)
    person.presses(Qt.Key.Key_F5)


def test_a_proposed_bracket_is_taken(bench, person, align, tmp_path):
    run = bench.window.run
    bench.reports.clear()
    person.clicks(align.propose)
    person.waits(lambda: bench.last(BracketProposal) is not None)
    proposal = bench.last(BracketProposal)
    assert (proposal.row, proposal.target, proposal.pattern) == ("star", "star", "neutral")
    assert proposal.least_snr_db >= 30
    assert list(proposal.exposures_ms) == sorted(proposal.exposures_ms)
    person.waits(lambda: "reach 30." in align.said.text())
    # Metering leaves the exposure as it was.
    count = bench.frames
    person.waits(lambda: bench.frames > count + 2 and bench.frame.exposure == 1e-3)
    person.clicks(align.accept)
    assert "proposed on star with neutral" in run.star.exposures_label.text()
    set_bracket(person, run.photograph, "400", "2", "1")
    person.chooses(bench.window.pattern.form.kind, "Axicon")
    person.types(bench.window.pattern.form.numbers["axicon", "radius_um"], "30")
    bench.reports.clear()
    person.presses(Qt.Key.Key_F6)
    person.waits(lambda: bench.last(RunEnded) is not None)
    ended = bench.last(RunEnded)
    assert ended.state == "COMPLETE"
    with Record(ended.path) as record:
        times = record.column("exposure")[record.select(target="star", pattern="neutral")]
    assert sorted(times * 1e3) == pytest.approx(list(proposal.exposures_ms))
    # Whoever changes a field has a ladder again.
    person.types(run.star.count, "3")
    assert "proposed" not in run.star.exposures_label.text()


def test_darkness_is_said_to_be_none(bench, person, align):
    person.chooses(bench.window.settings.target, "dark")
    person.waits(lambda: bench.frame.target == "dark")
    before = bench.frame.exposure
    person.clicks(align.find_star)
    person.waits(lambda: "no spot stands out" in align.said.text())
    person.clicks(align.expose)
    person.waits(lambda: bench.window.message.is_error)
    assert "nothing is seen" in bench.window.message.text
    assert "stays as it was" in bench.window.message.text
    person.waits(align.expose.isEnabled)
    count = bench.frames
    person.waits(lambda: bench.frames > count + 2 and bench.frame.exposure == before)


def test_from_a_star_out_of_focus_to_a_restored_photograph(own_bench, qtbot, tmp_path):
    """By clicks alone; the focus is where the thin lens has it, within the last step."""
    files = write_bench(tmp_path)
    files.scene.write_text(bring_nearer(files.scene.read_text()))
    bench = own_bench(files=files)
    walked = Walk(bench, Person(bench, qtbot)).go()
    assert walked.defocus == pytest.approx(defocus_nm(), abs=80)
    assert walked.fwhm < walked.first_fwhm / 3
    assert walked.level == pytest.approx(0.6, rel=0.1)
    assert min(walked.exposures) >= 2
    assert walked.residual < 1.2
    assert list(walked.seconds)[-1] == "restored"
