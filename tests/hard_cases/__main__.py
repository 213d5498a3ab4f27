"""The catalogue as a table in Markdown: `PYTHONPATH=tests python -m hard_cases`."""

from __future__ import annotations

from hard_cases.catalogue import listing

if __name__ == "__main__":
    print(listing())
