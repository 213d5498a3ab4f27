"""The guide: a page on every topic, shown by `labapp help`, whole where code has lists."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from labapp.common import guide
from labapp.common.errors import UserError
from labapp.common.guide import PAGES, find_topic, list_topics, terminal_text
from labapp.files.file_lookup import bundled_plans
from labapp.studies import STUDIES
from simulator.effects.registry import EFFECTS

ROOT = Path(__file__).parents[2]
TOPICS = {topic.name: topic for topic in list_topics()}


def headings(name: str, level: int) -> list[str]:
    return re.findall(rf"^{'#' * level} (.+)$", TOPICS[name].text, re.MULTILINE)


@pytest.mark.parametrize("name", TOPICS)
def test_a_page_begins_with_its_title_and_a_sentence(name):
    topic = TOPICS[name]
    assert topic.text.startswith(f"# {topic.title}\n")
    assert 20 < len(topic.summary) < 200
    assert topic.summary.endswith((".", ":"))
    assert guide._rank(name) < len(guide._ORDER), "name it in the order of topics"


def test_pages_are_in_the_wheel():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["labapp"]
    packed = {path for pattern in patterns for path in (ROOT / "labapp").glob(pattern)}
    assert {topic.path for topic in TOPICS.values()} <= packed
    assert PAGES == ROOT / "labapp/docs"


def test_the_list_begins_with_the_first_session_and_names_every_page(labapp):
    code, said, _ = labapp("help")
    assert code == 0
    assert next(iter(TOPICS)) == "first-session"
    assert all(re.search(rf"^ *{name} ", said, re.MULTILINE) for name in TOPICS)


@pytest.mark.parametrize("name", TOPICS)
def test_every_page_is_shown_in_a_terminal(labapp, name):
    code, said, _ = labapp("help", name)
    assert code == 0
    assert TOPICS[name].title.split()[0] in said
    assert not re.search(r"\]\([\w-]+\.md", terminal_text(TOPICS[name]))


def test_a_link_to_a_page_is_a_command_in_a_terminal():
    assert "Effects (`labapp help effects`)" in terminal_text(TOPICS["virtual-bench"])


@pytest.mark.parametrize("asked", ["First session", "first_session", "first-session.md"])
def test_a_topic_is_found_however_it_is_written(asked):
    assert find_topic(asked).name == "first-session"


@pytest.mark.parametrize(
    ("asked", "near"), [("retrival", "retrieval"), ("bench", "new-bench"), ("record", "records")]
)
def test_an_unknown_topic_names_the_nearest(asked, near):
    with pytest.raises(UserError, match=rf"topic '{asked}' is not known\. Did you mean '{near}'\?"):
        find_topic(asked)


def test_what_is_like_no_topic_gets_no_suggestion():
    with pytest.raises(UserError, match=r"not known\. labapp help lists the topics"):
        find_topic("xyzzy")


def test_every_effect_is_on_its_page_with_its_levels_and_source():
    assert headings("effects", 3) == [effect.name for effect in EFFECTS]
    text = " ".join(TOPICS["effects"].text.split())
    for effect in EFFECTS:
        part = text.split(f"### {effect.name} ")[1].split("###")[0]
        assert "- Caused by: " in part
        assert f"- Levels: {', '.join(effect.levels)}." in part
        assert f"- Source: {effect.source}." in part


def test_every_study_is_on_its_page_with_a_command():
    assert headings("studies", 2) == list(STUDIES)
    assert all(f"labapp study {name} " in TOPICS["studies"].text for name in STUDIES)


def test_every_ready_plan_is_on_its_page():
    named = re.findall(r"^\| `([a-z-]+)` \|", TOPICS["plans-and-runs"].text, re.MULTILINE)
    assert named == sorted(bundled_plans())
