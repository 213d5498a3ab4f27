"""Tests that never end by themselves, each with one after it that passes.

They aren't collected: test_window_failures.py runs them, in a process of their own.
"""

import threading
import time

import pytest
import watchdog
from PySide6.QtCore import QEventLoop, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QDialog, QFileDialog, QLabel, QMessageBox
from waits import wait_until


@pytest.fixture(autouse=True)
def limit(qapp, request, monkeypatch):
    """Of the tests that never end; those after them need not hurry."""
    if "works" not in request.node.name:
        monkeypatch.setattr(watchdog, "LONGEST", 1.0)


@pytest.fixture
def works():
    """What the test after a broken one sees: Qt's loops work."""
    heard = []
    QTimer.singleShot(50, lambda: heard.append(1))
    return lambda: wait_until(lambda: heard == [1])


def test_a_question():
    QMessageBox.question(None, "labapp", "Is anybody there?")


def test_works_after_a_question(works):
    works()


def test_a_dialogue():
    dialogue = QDialog()
    QLabel("Say something.", dialogue)
    dialogue.exec()
    assert dialogue.windowTitle() == "another"


def test_works_after_a_dialogue(works):
    works()


def test_a_file():
    QFileDialog.getOpenFileName(None, "Plan to run")


def test_works_after_a_file(works):
    works()


def test_a_python_loop():
    while True:
        pass


def test_works_after_a_python_loop(works):
    works()


def test_a_sleep():
    time.sleep(1e6)


def test_works_after_a_sleep(works):
    works()


def test_a_lock():
    threading.Event().wait()


def test_works_after_a_lock(works):
    works()


def test_a_loop_of_qts():
    QEventLoop().exec()


def test_works_after_a_loop_of_qts(works):
    works()


def test_polling():
    while True:
        QTest.qWait(10)


def test_works_after_polling(works):
    works()


def test_a_slot():
    def slot():
        while True:
            pass

    QTimer.singleShot(0, slot)
    wait_until(lambda: False, patience=1e6)


def test_works_after_a_slot(works):
    works()


@pytest.fixture
def stubborn(monkeypatch):
    monkeypatch.setattr(watchdog, "LONGEST_TEARDOWN", 1.0)
    yield
    time.sleep(1e6)


def test_a_teardown(stubborn):
    pass


def test_works_after_a_teardown(works):
    works()
