"""Pages of the guide in the terminal: `labapp help`."""

from __future__ import annotations

from typing import Annotated

import typer

from labapp.cli.app import app


@app.command("help")
def help_(
    topic: Annotated[
        str | None, typer.Argument(help="Topic of the list, such as retrieval.")
    ] = None,
) -> None:
    """Print a page of the guide (TOPIC) on the command line; without a topic, list the topics.

    The window shows the same pages with F1. **labapp COMMAND --help** explains a command and its
    options. For instance

    **labapp help first-session**
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
    out.print("For instance: labapp help first-session")


def _show_page(topic: str) -> None:
    from rich.markdown import Markdown

    from labapp.common.console import out
    from labapp.common.guide import find_topic, terminal_text

    # Addresses are written out, because not every terminal can follow links, and files have none.
    page = Markdown(terminal_text(find_topic(topic)), hyperlinks=False)
    # Lines of more than 100 characters are hard to read.
    out.print(page, width=min(out.width, 100))
