"""The guide: pages of Markdown in labapp/docs, a topic each, for terminal and window.

A page begins with its title and a paragraph whose first sentence says what the page is about: that
is the topic's line in lists. A page is added by adding its file. Nothing heavy is imported.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from labapp.common.errors import UserError, suggest_spelling

PAGES = Path(__file__).parents[1] / "docs"

_ORDER = (
    "first-session", "python", "new-bench", "calibration", "plans-and-runs", "records", "patterns",
    "retrieval", "image-formation", "restoration", "accuracy", "studies", "real-devices",
    "virtual-bench", "effects", "equations", "glossary", "figures", "architecture", "walks",
    "extend", "decisions",
)  # fmt: skip
"""From first steps to the inside. A page comes where the longest of these words begins its name."""

_LINK = re.compile(r"\[([^\]]+)\]\(([\w-]+)\.md\)")


@dataclass(frozen=True)
class Topic:
    """A page of the guide. name: what a person asks for; summary: a sentence."""

    name: str
    title: str
    summary: str
    path: Path

    @property
    def text(self) -> str:
        """The page as Markdown."""
        return self.path.read_text(encoding="utf-8")


def list_topics() -> list[Topic]:
    """All pages, in the order in which they are best read."""
    return sorted(map(_read_topic, PAGES.glob("*.md")), key=lambda one: (_rank(one.name), one.name))


def find_topic(name: str) -> Topic:
    """The page on a topic; UserError suggests the nearest.

    Capitals, blanks and a file's ending don't matter.
    """
    wanted = name.strip().lower().removesuffix(".md").replace(" ", "-").replace("_", "-")
    topics = {one.name: one for one in list_topics()}
    if wanted in topics:
        return topics[wanted]
    having = [one for one in topics if wanted and wanted in one.split("-")]
    question = suggest_spelling(wanted, having or topics, 0.0 if having else 0.5)
    raise UserError(
        f"help topic {name!r} is not known. {question}labapp help lists the topics, and "
        "labapp --help the commands."
    )


def terminal_text(topic: Topic) -> str:
    """A page as Markdown whose links to other pages are the commands that show them."""
    return _LINK.sub(r"\1 (`labapp help \2`)", topic.text)


def _read_topic(path: Path) -> Topic:
    head, _, rest = path.read_text(encoding="utf-8").strip().partition("\n")
    paragraph = " ".join(rest.strip().split("\n\n")[0].split())
    sentence = re.split(r"(?<=[.?!:]) ", _LINK.sub(r"\1", paragraph))[0]
    return Topic(path.stem, head.lstrip("# "), sentence.replace("`", ""), path)


def _rank(name: str) -> int:
    """Of a page in the order; what isn't told there comes last."""
    fits = [k for k, word in enumerate(_ORDER) if name == word or name.startswith(f"{word}-")]
    return fits[0] if fits else len(_ORDER)
