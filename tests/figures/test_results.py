"""The page of results: a part that is measured leaves the rest as it was."""

from __future__ import annotations

import re

import pytest

from figures import TOLD, Figure
from figures.__main__ import is_asked
from figures.measurements import MEASUREMENTS, ON_REQUEST, measurement
from figures.results import (
    PAGE,
    RESULTS,
    Section,
    Stamp,
    quote,
    quoted_rows,
    read_sections,
    seen_rows,
    update,
)

EARLIER = Stamp("2024-02-01", "commit 0123456789", "a slow machine")
LATER = Stamp("2024-03-01", "commit 9876543210", "a fast machine")


def section(name: str, stamp: Stamp, seen: str, met: bool | None = True) -> Section:
    return Section(name, stamp, (Figure(f"what {name} measures", "≤ 1 s", seen, met),))


@pytest.fixture
def page(tmp_path):
    path = tmp_path / "RESULTS.md"
    update(section("psf", EARLIER, "0.5 s"), path)
    update(section("help", EARLIER, "0.2 s | in all"), path)
    return path


def test_a_part_that_is_measured_again_leaves_the_rest(page):
    before = read_sections(page)
    update(section("psf", LATER, "2 s", met=False), page)
    after = read_sections(page)
    assert after["help"] == before["help"]
    assert "0.5 s" not in page.read_text()
    assert "| **2 s** | **missed** |" in after["psf"]
    assert str(LATER) in after["psf"]


def test_sections_stand_in_the_order_of_the_measurements(page):
    assert list(read_sections(page)) == ["help", "psf"]
    assert list(MEASUREMENTS).index("help") < list(MEASUREMENTS).index("psf")


def test_a_figure_that_is_just_told_has_no_verdict(page):
    told = Figure("what psf costs", TOLD, "0.5 dB", None)
    absent = Figure("psf of a peer", "≤ 1 s", "the peer isn't installed", None)
    update(Section("psf", LATER, (told, absent)), page)
    rows = read_sections(page)["psf"]
    assert "| what psf costs | told | 0.5 dB |  |" in rows
    assert "| psf of a peer | ≤ 1 s | the peer isn't installed | not measured |" in rows


def test_what_was_never_measured_is_named(page):
    last = page.read_text().splitlines()[-1]
    assert last.startswith("Not measured yet: ")
    assert "demo" in last
    assert "psf" not in last.replace("psf,", "").split()


def test_a_bar_in_words_makes_no_column(page):
    assert seen_rows(page) == {
        "what help measures": "0.2 s / in all",
        "what psf measures": "0.5 s",
    }


def test_a_measurement_that_is_gone_leaves_the_page(page):
    text = page.read_text().replace("## help", "## of old")
    page.write_text(text)
    update(section("psf", LATER, "2 s"), page)
    assert list(read_sections(page)) == ["psf"]


def test_a_page_that_quotes_rows_is_brought_up_to_what_was_seen(page, tmp_path):
    other = tmp_path / "page.md"
    head = "# Ours\n| figure | goal | seen |\n| --- | --- | --- |\n"
    rows = ["| what psf measures | ≤ 1 s | 9 s |", "| a driver | of a table | unlike these |"]
    other.write_text(head + "\n".join(rows))
    quote(other, page)
    assert quoted_rows(other) == {"what psf measures": "0.5 s", "a driver": "unlike these"}
    assert other.read_text().startswith(head)


def test_the_figures_of_the_guide_are_those_that_were_seen():
    lines = PAGE.read_text().splitlines()
    names = [row.split("|")[1].strip() for row in lines if row.startswith("| ")][2:]
    assert len(names) >= 7
    seen, quoted = seen_rows(), quoted_rows(PAGE)
    for name in names:
        assert quoted[name] == seen[name]


def test_the_page_of_this_checkout_has_rows_of_known_measurements():
    sections = read_sections()
    assert sections
    assert set(sections) <= set(MEASUREMENTS)
    assert len(seen_rows(RESULTS)) >= len(sections)


@pytest.mark.parametrize("name", ON_REQUEST)
def test_what_takes_an_hour_is_measured_only_where_all_its_words_are_given(name):
    assert name in MEASUREMENTS
    words = name.split()
    assert [is_asked(name, only) for only in ([name], words)] == [True, True]
    assert [is_asked(name, only) for only in ([], words[:1], words[1:])] == [False] * 3


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_every_measurement_is_a_function(name):
    text = RESULTS.with_name(f"{MEASUREMENTS[name]}.py").read_text()
    declared = re.findall(rf'"{name}": (\w+)', text.partition("\nMEASUREMENTS = ")[2])
    assert len(declared) == 1
    assert f"def {declared[0]}(folder: Path)" in text


def test_a_measurement_gives_figures(tmp_path):
    found = list(measurement("closed-forms")(tmp_path))
    assert all(isinstance(figure, Figure) and figure.met for figure in found)
