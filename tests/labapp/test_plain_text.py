"""Names and messages from files are text wherever they're shown, never markup or controls."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from labapp.common.console import err, out, print_error, print_table, styled_line, terminal_progress
from labapp.common.errors import UserError
from labapp.common.figure_png import figure_to_png
from labapp.common.plain_text import printable, printable_line, quote, shorten
from labapp.pictures.report.html import document

NAMES = ("ring [/b]", "ring [new]", ":star:", "[red]", "$x_2", "<b>bold</b>", "100 %", "\\frac")
CONTROLS = "\x1b[31m", "\x1b]0;title\x07", "\x9b2J", "a\rb", "a\x08b", "\u202eabc", "\ud800", "\x00"


@pytest.mark.parametrize("text", NAMES)
def test_names_stay_as_they_are(text):
    assert printable(text) == printable_line(text) == text


@pytest.mark.parametrize("text", CONTROLS)
def test_controls_become_blanks(text):
    shown = printable(text)
    assert len(shown) == len(text)
    assert shown != text
    assert not re.search("[\x00-\x1f\x7f-\x9f\u202e\ud800]", shown)
    shown.encode()


def test_line_feeds_stay_in_messages_only():
    assert printable("a\nb\tc") == "a\nb c"
    assert printable_line("a\nb") == "a b"


def test_a_quoted_value_has_a_limit():
    assert quote("short") == "'short'"
    assert quote(1.5) == "1.5"
    assert len(quote("x" * 10_000)) == 203
    assert quote(10**5000) == "a int"
    assert shorten("abcdef", 6) == "abcdef"
    assert shorten("abcdefg", 6) == "abc … efg"
    assert len(str(UserError("x" * 10_000))) < 2100


@pytest.mark.parametrize("text", NAMES)
def test_the_terminal_shows_names_as_they_are(capsys, text):
    out.print(text)
    print_table(text, [text, "b "], [[text, styled_line((text, "green"))]])
    print_error(text)
    printed = capsys.readouterr()
    assert printed.out.count(text) == 5
    assert text in printed.err


@pytest.mark.parametrize("text", CONTROLS)
def test_no_control_reaches_the_terminal(capsys, text):
    out.print(text)
    err.print(text)
    print_table(text, [text], [[text], [styled_line((text, "red"))]])
    print_error(text)
    printed = capsys.readouterr()
    for shown in (printed.out, printed.err):
        assert not re.search("[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e\ud800]", shown)


def test_progress_of_any_name_is_shown(monkeypatch):
    monkeypatch.setattr(err, "_force_terminal", True)
    with err.capture() as shown, terminal_progress() as progress:
        for name in (*NAMES, *CONTROLS):
            progress.report(0.5, name)
    assert "\x1b[31m" not in shown.get()


def test_a_page_shows_names_as_they_are():
    page = document("<b>\x1b", ["<p>&lt;b&gt;\x00\ud800</p>"])
    assert "<title>&lt;b&gt; </title>" in page
    assert "<p>&lt;b&gt;  </p>" in page
    page.encode()


def test_a_picture_shows_a_dollar_and_no_formula():
    """A formula that isn't one would end the drawing; one that is wouldn't show its dollars."""

    def drawn(title: str) -> np.ndarray:
        figure = Figure(figsize=(3, 2), dpi=60)
        axes = figure.subplots()
        axes.semilogy([1, 2], [1, 100])
        axes.set_title(title)
        picture = cv2.imdecode(np.frombuffer(figure_to_png(figure), np.uint8), 0)
        assert picture is not None
        return picture

    broken, plain = drawn("$\\frac{a$"), drawn("a")
    assert (broken != plain).any()
    inked = [(drawn(text)[:14] < 128).sum() for text in ("$x$", "x")]
    assert inked[0] > inked[1], "dollars are drawn"


@pytest.fixture
def named(labapp, tiny, tmp_path):
    """The record of a plan whose names and texts are markup, and the plan."""
    text = tiny.plan.read_text().replace("Small plan", "Plan [/b] \\u001b[31m :star: <i>x</i>")
    text = text.replace("patterns.lens", 'patterns."ring [/b] \\u001b[2J"')
    text = text.replace('"lens"]', '"ring [/b] \\u001b[2J", "ring [new]"]')
    text += '[patterns."ring [new]"]\nkind = "constant"\ngrey = 3\n'
    tiny.plan.write_text(text)
    record = tmp_path / "run.h5"
    code, _, said = labapp("run", tiny.plan, *tiny.arguments(), "--out", record)
    assert code == 0, said
    assert "\x1b" not in said
    return record, tiny


def test_commands_show_a_records_names_as_they_are(labapp, named, tmp_path):
    record, tiny = named
    commands = {
        "show": ["show", record],
        "plan": ["plan", "show", tiny.plan, *tiny.arguments()],
        "verify": ["verify", record],
        "report": ["report", record, "--out", tmp_path],
        "export": ["export", record, "--to", "npy", "--out", tmp_path / "frames"],
    }
    shown = {}
    for name, command in commands.items():
        code, printed, said = labapp(*command)
        assert (name, code, said) == (name, 0, said)
        assert "\x1b" not in printed + said
        shown[name] = " ".join(printed.split())
    assert "ring [/b]" in shown["report"]
    page = (tmp_path / "report.html").read_text()
    assert "ring [/b]" in page
    assert "<i>" not in page
    assert "\x1b" not in page
    for name in ("show", "plan"):
        for text in ("ring [/b]", "ring [new]", "Plan [/b]", ":star: <i>x</i>"):
            assert text in shown[name]
