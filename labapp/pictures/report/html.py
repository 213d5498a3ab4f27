"""Parts of an HTML page that is a single file without external resources."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape

import labapp
from labapp.common.plain_text import printable, printable_line

_STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #8882; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 78rem; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: .2rem } h2 { margin-top: 2.2rem }
.badge { background: #b45309; color: #fff; border-radius: .4rem; padding: .1rem .6rem;
  font-weight: 600; font-size: .9rem }
table { border-collapse: collapse; margin: .6rem 0 }
th, td { padding: .25rem .9rem .25rem 0; text-align: left; border-bottom: 1px solid var(--line) }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums }
figure { margin: .6rem 0 } figcaption { font-size: .95rem; padding: .2rem 0 }
img { max-width: 100%; height: auto; border-radius: .3rem; background: #fff }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(30rem, 1fr)); gap: 1rem;
  align-items: start }
footer { margin-top: 3rem; font-size: .85rem; opacity: .7 }
"""


def document(title: str, parts: Sequence[str]) -> str:
    """Assemble a page from the HTML of its parts."""
    body = printable("\n".join(parts))
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(printable_line(title))}</title><style>{_STYLE}</style></head>"
        f"<body>{body}</body></html>\n"
    )


def heading(title: str, simulated: Sequence[str]) -> str:
    """Return a heading, with a badge that names simulated devices."""
    badge = ""
    if simulated:
        badge = f'<span class="badge">SIMULATED: {escape(", ".join(simulated))}</span>'
    return f"<h1>{escape(title)}</h1>{badge}"


def html_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; columns whose heading ends in a blank hold numbers."""
    kinds = [' class="number"' if head.endswith(" ") else "" for head in heads]
    top = "".join(f"<th{k}>{escape(h.strip())}</th>" for h, k in zip(heads, kinds, strict=True))
    lines = [
        "".join(f"<td{k}>{escape(cell)}</td>" for cell, k in zip(row, kinds, strict=True))
        for row in rows
    ]
    inner = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{inner}</tbody></table>"


def html_figure(data: bytes, text: str, kind: str = "png") -> str:
    """Return the HTML that embeds a figure with a caption; `kind` is "png" or "gif"."""
    source = f"data:image/{kind};base64," + base64.b64encode(data).decode()
    under = f"<figcaption>{escape(text)}</figcaption>" if text else ""
    return f'<figure><img src="{source}" alt="{escape(text)}">{under}</figure>'


def footer() -> str:
    """Return a footer with the version of labapp and the time."""
    made = datetime.now(UTC).isoformat(timespec="seconds")
    return f"<footer>labapp {labapp.__version__}, {made}</footer>"
