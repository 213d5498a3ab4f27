"""The pages of the user guide, Markdown files in labapp/docs, for terminal and window.

A page begins with its title and a paragraph. The paragraph's first sentence says what the page is
about and is shown in lists of topics. A new file in the folder is a new page. The module imports
nothing that loads slowly.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from labapp.common.errors import UserError, suggest_spelling

PAGES = Path(__file__).parents[1] / "docs"

_ORDER = (
    "first-session", "python", "new-bench", "aligning", "calibration", "plans-and-runs", "records",
    "patterns", "retrieval", "image-formation", "pictures", "restoration", "multispectral",
    "depth-of-field", "accuracy", "studies", "real-devices", "virtual-bench", "effects",
    "equations", "glossary", "figures", "architecture", "walks", "work", "extend",
    "decisions", "changelog", "citing",
)  # fmt: skip
"""Order of the pages, from first steps to internals. A page is placed by the beginning of its
name; all other pages come last."""

_LINK = re.compile(r"\[([^\]]+)\]\(([\w-]+)\.md\)")


@dataclass(frozen=True)
class Topic:
    """A page of the guide: the word that users type, its title, a sentence, its file."""

    name: str
    title: str
    summary: str
    path: Path

    @property
    def text(self) -> str:
        """The page as Markdown."""
        return self.path.read_text(encoding="utf-8")


def list_topics() -> list[Topic]:
    """List the guide's pages in reading order."""
    return sorted(map(_read_topic, PAGES.glob("*.md")), key=lambda one: (_rank(one.name), one.name))


def find_topic(name: str) -> Topic:
    """Find the page on a topic; capitals, blanks and the ending ".md" don't matter.

    Raises UserError, which suggests a similar topic, if there is no such page.
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
    """Return a page as Markdown in which each link is the `labapp help` command of its target."""
    return _LINK.sub(r"\1 (`labapp help \2`)", topic.text)


def _read_topic(path: Path) -> Topic:
    head, _, rest = path.read_text(encoding="utf-8").strip().partition("\n")
    paragraph = " ".join(rest.strip().split("\n\n")[0].split())
    sentence = re.split(r"(?<=[.?!:]) ", _LINK.sub(r"\1", paragraph))[0]
    return Topic(path.stem, head.lstrip("# "), sentence.replace("`", ""), path)


def _rank(name: str) -> int:
    """Rank a page in reading order; pages that _ORDER doesn't list come last."""
    fits = [k for k, word in enumerate(_ORDER) if name == word or name.startswith(f"{word}-")]
    return fits[0] if fits else len(_ORDER)
