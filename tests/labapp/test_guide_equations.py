"""The guide names what is in the code, and has the equations that the code cites."""

import ast
import pkgutil
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PRODUCT = ("optics", "simulator", "drivers", "labapp")
PAGE = (ROOT / "labapp/docs/equations.md").read_text()
PAGES = [PAGE, (ROOT / "labapp/docs/glossary.md").read_text()]
NAMES = sorted(set(re.findall(rf"`((?:{'|'.join(PRODUCT)})(?:\.\w+)+)`", "\n".join(PAGES))))
_NUMBER = r"\d\.\d+(?:\.\d+)?"
CITATION = re.compile(
    rf"(Goodman, )?(?:Eq\.|§)\s*({_NUMBER}(?:(?:,|,?\s+and|,?\s+to)\s+§?{_NUMBER})*)"
)


def cited_numbers(text: str) -> set[str]:
    """Equations and sections of the thesis that a text cites, ranges spelt out."""
    found = set()
    for other_book, numbers in CITATION.findall(text):
        if other_book:
            continue
        listed = re.findall(r"(to\s+)?§?(\d)\.(\d+)((?:\.\d+)?)", numbers)
        for place, (is_end, chapter, last, section) in enumerate(listed):
            first = int(listed[place - 1][2]) if is_end else int(last)
            found |= {f"{chapter}.{number}{section}" for number in range(first, int(last) + 1)}
    return found


def docstrings(path: Path) -> list[str]:
    """Docstrings of a module, or none where it cites nothing: most modules needn't be parsed."""
    source = path.read_text()
    if not CITATION.search(source):
        return []
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = (node for node in ast.walk(ast.parse(source)) if isinstance(node, kinds))
    return [text for node in nodes if (text := ast.get_docstring(node))]


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_the_pages_can_be_imported(name):
    assert pkgutil.resolve_name(name) is not None


def test_every_cited_equation_stands_in_the_page():
    listed = cited_numbers("\n".join(re.findall(r"^\| (?:Eq\.|§)[^|]*", PAGE, re.MULTILINE)))
    cited = {
        number: path.relative_to(ROOT)
        for room in PRODUCT
        for path in sorted((ROOT / room).rglob("*.py"))
        for text in docstrings(path)
        for number in cited_numbers(re.sub(r"Statistical Optics, §[\d.]+", "", text))
    }
    assert {number: path for number, path in cited.items() if number not in listed} == {}
    assert len(cited) >= 25


def test_ranges_are_spelt_out():
    assert cited_numbers("(thesis Eq. 3.1, 5.1 to 5.3; §3.3.2)") == {
        "3.1",
        "5.1",
        "5.2",
        "5.3",
        "3.3.2",
    }
    assert cited_numbers("Goodman, Eq. 6.32") == set()
