"""The command that shows the guide."""

from __future__ import annotations

from typing import Annotated

import typer

from labapp.cli.app import app

_WIDTH = 100
"""Characters; longer lines are hard to read."""


@app.command("help")
def help_(
    topic: Annotated[str | None, typer.Argument(help="A topic of the list, as retrieval.")] = None,
) -> None:
    """Show a page of the guide; without a topic, list the topics.

    The window shows the same pages: F1. What a command does and takes is told by
    **labapp COMMAND --help**.
    """
    if topic is None:
        _list_topics()
    else:
        _show_page(topic)


def _list_topics() -> None:
    from labapp.common.console import out, print_table
    from labapp.common.guide import list_topics

    rows = [(one.name, one.summary) for one in list_topics()]
    print_table("The guide", ("topic", "what it is about"), rows)
    out.print("For instance: labapp help first-session", markup=False)


def _show_page(topic: str) -> None:
    from rich.markdown import Markdown

    from labapp.common.console import out
    from labapp.common.guide import find_topic, terminal_text

    # Addresses in words: not every terminal can follow a link, and files have none.
    page = Markdown(terminal_text(find_topic(topic)), hyperlinks=False)
    out.print(page, width=min(out.width, _WIDTH))
