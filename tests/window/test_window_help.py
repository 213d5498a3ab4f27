"""The guide in its window: every page, by keys, clicks and links."""

import pytest
from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QDesktopServices, QImage, QTextDocument
from waits import wait_until

from labapp.common.guide import list_topics
from labapp.window.help_window import HelpWindow


@pytest.fixture
def guide(qtbot):
    window = HelpWindow()
    qtbot.addWidget(window)
    window.show()
    qtbot.waitExposed(window)
    return window


def title(guide):
    return guide.page.document().firstBlock().text()


def test_f1_opens_the_guide_and_the_window_stays_usable(bench, person):
    person.presses(Qt.Key.Key_F1)
    person.waits(lambda: bench.window.help is not None and bench.window.help.isVisible())
    person.waits(lambda: title(bench.window.help) == "First session")
    assert not bench.window.help.isModal()
    bench.window.help.close()
    person.clicks(bench.window.help_button)
    person.waits(bench.window.help.isVisible)
    bench.window.help.close()


def test_every_topic_is_in_the_list_and_shows_its_page(guide, qtbot):
    for row, topic in enumerate(list_topics()):
        assert guide.topics.item(row).text() == topic.title
        guide.topics.setCurrentRow(row)
        assert title(guide) == topic.title
    assert guide.topics.count() == row + 1
    qtbot.keyClick(guide.topics, Qt.Key.Key_Home)
    assert title(guide) == "First session"


def test_a_link_turns_to_its_page(guide):
    guide.page.anchorClicked.emit(QUrl("effects.md"))
    assert title(guide) == "Effects of the simulator"
    guide.page.anchorClicked.emit(QUrl("../../tests/figures/RESULTS.md"))
    assert title(guide) == "Effects of the simulator"


def test_an_address_is_left_to_the_browser(guide, monkeypatch):
    opened = []
    monkeypatch.setattr(QDesktopServices, "openUrl", opened.append)
    guide.page.anchorClicked.emit(QUrl("https://example.org/a.md"))
    assert [url.toString() for url in opened] == ["https://example.org/a.md"]


def test_pictures_of_a_page_are_found_and_fit(guide):
    guide.show_topic("first-session")
    kind = QTextDocument.ResourceType.ImageResource.value
    picture = guide.page.loadResource(kind, QUrl("../data/first_light.jpg"))
    assert isinstance(picture, QImage)
    assert 600 < picture.width() <= guide.page.viewport().width()
    assert not guide.page.horizontalScrollBar().isVisible()


def test_a_page_begins_at_its_top(guide):
    guide.show_topic("effects")
    bar = guide.page.verticalScrollBar()
    bar.setValue(bar.maximum())
    assert bar.value() > 0
    guide.show_topic("studies")
    wait_until(lambda: bar.value() == 0, lambda: f"at {bar.value()}")
