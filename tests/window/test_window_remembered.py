"""Settings last from one session to the next, and never keep the window from opening."""

import pytest
from waits import wait_until

from labapp.window.engine_connection import EngineConnection
from labapp.window.exposure_bracket import SNRBracket
from labapp.window.main_window import MainWindow
from labapp.window.remembered_settings import RememberedSettings


@pytest.fixture
def opened(dark_theme, qtbot):
    def open_(file):
        window = MainWindow(EngineConnection(), RememberedSettings(file))
        qtbot.addWidget(window)
        window.show()
        return window

    return open_


def test_fields_come_back(opened, tmp_path):
    first = opened(tmp_path / "window.ini")
    first.settings.wavelength.setValue(633.2)
    first.run.star.count.setValue(6)
    first.run.photograph.chosen.setChecked(True)
    first.run.photograph.snr.setValue(36.5)
    first.pattern.form.select_kind("lens")
    first.pattern.form.numbers["lens", "focal_length_m"].setValue(-7.5)
    first.resize(1400, 800)
    first.close()
    second = opened(tmp_path / "window.ini")
    assert second.settings.wavelength.value() == 633.2
    assert second.run.star.bracket.count == 6
    assert second.run.photograph.bracket == SNRBracket(36.5, 2)
    table = second.pattern.form.pattern_table(633.2)
    assert table == {"kind": "lens", "focal_length_m": -7.5, "wavelength_nm": 633.2}
    assert second.size() == first.size()


def test_what_was_in_front_is_in_front_again(opened, tmp_path):
    first = opened(tmp_path / "window.ini")
    first.actions_["why"].trigger()
    wait_until(lambda: not first.effects.visibleRegion().isEmpty())
    first.close()
    second = opened(tmp_path / "window.ini")
    wait_until(lambda: not second.effects.visibleRegion().isEmpty())
    wait_until(second.queue.visibleRegion().isEmpty)
    wait_until(second.actions_["why"].isChecked)


@pytest.mark.parametrize(
    "text",
    ["\x00\xff not settings", "[General]\nwavelength_nm=nan\nstar_count=many\nlayout=7\n"],
)
def test_a_broken_file_is_left_out(opened, tmp_path, text):
    file = tmp_path / "window.ini"
    file.write_text(text)
    window = opened(file)
    assert window.isVisible()
    assert window.settings.wavelength.value() == 550
    assert window.run.star.bracket.count == 4


def test_a_place_that_cannot_be_written_is_no_obstacle(opened, tmp_path):
    (tmp_path / "file").write_text("")
    window = opened(tmp_path / "file" / "window.ini")
    assert window.isVisible()
    assert window.close()
