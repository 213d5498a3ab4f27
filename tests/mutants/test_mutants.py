"""The mutation check on a module that is so small that all its mutants are known."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mutants.__main__ import choose
from mutants.changes import mutants
from mutants.related import related

SHOP = '''\
"""What things cost."""


def price(count, each, discount=0.0):
    total = count * each
    if count > 10:
        total -= discount
    return total


def change(paid, due):
    """Counted in another process, by the tests."""
    return paid - due
'''

WEAK_TESTS = """\
import subprocess, sys
from shop.price import price

def test_two_things():
    assert price(2, 3.0) == 6.0

def test_change():
    code = "from shop.price import change; assert change(5, 2) == 3"
    subprocess.run([sys.executable, "-c", code], check=True)
"""


@pytest.fixture
def shop(tmp_path: Path) -> Path:
    files = {
        "shop/__init__.py": "from shop.price import price as price\n",
        "shop/price.py": SHOP,
        "shop/bill.py": "from shop.price import change\n",
        "tests/conftest.py": "",
        "tests/test_weak.py": WEAK_TESTS,
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def after(text: str) -> set[str]:
    return {one.after for one in mutants(text)}


def test_the_check_finds_what_weak_tests_let_through(shop):
    check = [sys.executable, "-m", "mutants", "--root", shop, "--count", "0", "--json", "out.json"]
    paths = [Path(__file__).parents[1], shop]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, paths)),
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
    }
    told = subprocess.run(
        [*check, "shop/price.py"], env=environment, cwd=shop, capture_output=True, text=True
    )
    assert told.returncode == 0, told.stderr
    rows = json.loads((shop / "out.json").read_text())
    killed = {(row["line"], row["after"]) for row in rows if row["killed_by"]}
    assert killed == {
        (5, "(count / each)"),
        (8, "return None"),
        (13, "return None"),
        (13, "(paid + due)"),
    }
    survived = {(row["line"], row["after"]): row["files_of_tests"] for row in rows
                if not row["killed_by"]}  # fmt: skip
    assert survived == {
        (4, "(1.0)"): 1, (6, "(count <= 10)"): 1, (6, "(count >= 10)"): 1, (6, "(11)"): 1,
        # Nobody buys eleven.
        (7, "pass"): 0,
    }  # fmt: skip
    assert "4 of 9 killed (44%)" in told.stdout
    assert (shop / "shop/price.py").read_text() == SHOP


@pytest.mark.parametrize(("text", "changed"), [
    ("x = a < b", {"(a >= b)"}),
    ("x = n < 3", {"(n >= 3)", "(n <= 3)", "(4)"}),
    ("x = a is None", {"(a is not None)"}),
    ("x = a + b", {"(a - b)"}),
    ("x = -a", {"(a)"}),
    ("x = not a", {"(a)"}),
    ("x = a and b", {"(a or b)"}),
    ("x = a if b else c", {"(c if b else a)"}),
    ("x = 0.0", {"(1.0)"}),
    ("x = True", {"(False)"}),
    ("x = min(a, b)", {"(max(a, b))"}),
    ("x = f(a, b, c)", {"(f(b, a, c))"}),
    ("x = f(a, b=c)", {"(f(a))"}),
    ("x = a.clamp(b)", {"(a)"}),
    ("x = np.clip(a)", {"(a)"}),
    ("x = a[b:c]", {"(a[b + 1:c])", "(a[b:c - 1])"}),
    ("x = a[:, b:]", {"(a[:, b + 1:])"}),
    ("f(a)", {"pass"}),
    ("a.b = c", {"pass"}),
    ("a += b", {"pass"}),
    ("def f(a=0.5) -> None:\n    return a", {"(1.0)", "return None"}),
])  # fmt: skip
def test_each_kind_of_change(text, changed):
    assert after(text) == changed


@pytest.mark.parametrize("text", [
    '"""A docstring."""', "import a", "from a import b", '__all__ = ["a"]', 'x = "text"',
    "x: Literal[3]", "return_ = None", "x = f(a, a)", 'raise_ = f"{1 + 1}"', 'x = "a" + b',
    "if TYPE_CHECKING:\n    f(a)",
])  # fmt: skip
def test_what_no_test_could_notice_is_left_alone(text):
    assert not mutants(text)


def test_mutants_are_modules_with_one_change_each():
    text = Path(ast.__file__).read_text()
    plain, some = ast.dump(ast.parse(text)), choose(mutants(text), 6, 3)
    trees = [ast.dump(ast.parse(one.text)) for one in some]
    assert len({plain, *trees}) == 7
    assert all(one.before in " ".join(text.split()) for one in some)


def test_the_seed_chooses_and_no_statement_has_two_before_each_has_one():
    every = mutants(SHOP)
    assert choose(every, 4, 1) == choose(every, 4, 1)
    assert any(choose(every, 4, 1) != choose(every, 4, seed) for seed in (2, 3, 4))
    assert len({one.line for one in choose(every, 6, 1)}) == 6
    assert {one.line for one in choose(every, 0, 1, "5-6")} == {5, 6}


def test_related_tests_are_found_through_faces_and_helpers_nearest_first(shop):
    tests = {
        "test_a_far.py": "import shop.bill\n",
        "test_b_face.py": "from shop import price\n",
        "test_c_helped.py": "import helper\n",
        "helper.py": "import shop.price\n",
        "test_d_stranger.py": "import json\n",
        "test_e_runs_it.py": 'MODULE = "shop.price"\n',
    }
    for name, text in tests.items():
        (shop / "tests" / name).write_text(text)
    found = [one.name for one in related(shop, shop / "shop/price.py")]
    assert set(found[:4]) == {
        "test_b_face.py", "test_c_helped.py", "test_e_runs_it.py", "test_weak.py",
    }  # fmt: skip
    assert found[4:] == ["test_a_far.py"]
