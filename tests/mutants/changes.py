"""All mutants of a module: its text with one small change each."""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass

NEGATED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
NEXT_DOOR: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
}  # fmt: skip
SWAPPED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult, ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.LShift: ast.RShift, ast.RShift: ast.LShift,
}  # fmt: skip
OPPOSITES = {
    "min": "max", "minimum": "maximum", "amin": "amax", "argmin": "argmax", "any": "all",
    "floor": "ceil", "cos": "sin", "real": "imag",
}  # fmt: skip
OPPOSITES |= {there: here for here, there in OPPOSITES.items()}
ROUND_TRIPS = {
    "clamp", "clip", "abs", "conj", "round", "sqrt", "square", "flip", "flatten", "strip", "lower",
    "sort", "sorted", "reversed",
}  # fmt: skip
"""Calls that hand on their first operand, a little changed: leaving them out still runs."""
COMPOUND = (ast.If, ast.While, ast.For, ast.With, ast.FunctionDef, ast.AsyncFunctionDef,
            ast.ClassDef, ast.Try, ast.Match)  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    kind: str
    lines: range
    """Of the statement that it changes; a test that executes none of them can't notice."""
    before: str
    after: str
    """What was changed, and into what, on one line each."""
    text: str
    """The whole module."""

    @property
    def line(self) -> int:
        return self.lines.start


def mutants(text: str) -> list[Mutant]:
    """Every mutant of a module's text, in the order of its lines."""
    found, seen = [], set()
    encoded, starts = text.encode(), _line_starts(text)
    for statement in _statements(ast.parse(text)):
        for kind, node, new in _changes(statement):
            start = starts[node.lineno - 1] + node.col_offset
            end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
            if (start, end, new) not in seen:
                seen.add((start, end, new))
                before = _one_line(encoded[start:end].decode())
                changed = (encoded[:start] + new.encode() + encoded[end:]).decode()
                found.append(Mutant(kind, _own_lines(statement), before, _one_line(new), changed))
    return found


def _line_starts(text: str) -> list[int]:
    """Where each line begins, in bytes, which is how the syntax tree counts columns."""
    starts = [0]
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return starts


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _statements(tree: ast.AST) -> Iterator[ast.stmt]:
    """Statements that do something when the module runs, outer ones before those inside."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.stmt):
            if _says_nothing(node):
                continue
            yield node
        if isinstance(node, (ast.stmt, ast.ExceptHandler, ast.match_case)):
            yield from _statements(node)


def _says_nothing(node: ast.stmt) -> bool:
    """Imports, docstrings, names that are exported, and what only type checkers read."""
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        return True
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return True
    if isinstance(node, ast.If):
        return "TYPE_CHECKING" in ast.unparse(node.test)
    return isinstance(node, ast.Assign) and ast.unparse(node.targets[0]).startswith("__")


def _own_lines(node: ast.stmt) -> range:
    """Of a simple statement all, of one with others inside it only its head."""
    last = node.end_lineno or node.lineno
    if isinstance(node, COMPOUND):
        inside = [one.lineno for one in ast.walk(node) if isinstance(one, ast.stmt)][1:]
        last = max(node.lineno, min([line - 1 for line in inside if line > node.lineno] or [last]))
    return range(node.lineno, last + 1)


Change = tuple[str, ast.expr | ast.stmt, str]
"""Its kind, the node whose text goes, and the text that comes instead."""


def _changes(statement: ast.stmt) -> Iterator[Change]:
    """Changes of one statement, without those inside it."""
    yield from _deleted(statement)
    if isinstance(statement, ast.Raise):
        return
    for part in _expressions(statement):
        for node in _parts(part):
            for kind, new in _replaced(node):
                if ast.dump(new) != ast.dump(node):
                    yield kind, node, f"({ast.unparse(new)})"


def _deleted(statement: ast.stmt) -> Iterator[Change]:
    """A statement that can go without a NameError: a call, or what changes something in place."""
    if isinstance(statement, ast.Return):
        if statement.value is not None and ast.unparse(statement.value) != "None":
            yield "return value dropped", statement, "return None"
        return
    in_place = isinstance(statement, ast.Assign) and not isinstance(statement.targets[0], ast.Name)
    called = isinstance(statement, ast.Expr) and isinstance(statement.value, (ast.Call, ast.Yield))
    leaves = isinstance(statement, (ast.AugAssign, ast.Raise, ast.Continue, ast.Break, ast.Delete))
    if (in_place and not isinstance(statement.targets[0], ast.Tuple)) or called or leaves:
        yield "statement deleted", statement, "pass"


def _expressions(statement: ast.stmt) -> Iterator[ast.expr]:
    """What a statement works out: no annotations, no decorators."""
    if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef)):
        defaults = statement.args.defaults + statement.args.kw_defaults
        yield from (one for one in defaults if one is not None)
        return
    if isinstance(statement, ast.ClassDef):
        return
    for name, value in ast.iter_fields(statement):
        if name in ("annotation", "decorator_list"):
            continue
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, ast.expr):
                yield one
            elif isinstance(one, ast.withitem):
                yield one.context_expr


def _parts(node: ast.expr) -> Iterator[ast.expr]:
    """An expression and all in it; a formatted text's inside has no true place in the file."""
    if isinstance(node, ast.JoinedStr):
        return
    yield node
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            yield from _parts(child)
        elif isinstance(child, (ast.keyword, ast.comprehension)):
            for inner in ast.iter_child_nodes(child):
                if isinstance(inner, ast.expr):
                    yield from _parts(inner)
        elif isinstance(child, ast.arguments):
            for inner in (*child.defaults, *child.kw_defaults):
                if inner is not None:
                    yield from _parts(inner)


Replaced = Iterator[tuple[str, ast.expr]]


def _replaced(node: ast.expr) -> Replaced:
    match node:
        case ast.Compare():
            yield from _compared(node)
        case ast.BinOp():
            yield from _calculated(node)
        case ast.UnaryOp():
            kind = "negation dropped" if isinstance(node.op, ast.Not) else "sign dropped"
            if isinstance(node.op, (ast.Not, ast.USub)):
                yield kind, node.operand
        case ast.BoolOp():
            op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield "and, or", ast.BoolOp(op, node.values)
        case ast.IfExp():
            yield "choice turned round", ast.IfExp(node.test, node.orelse, node.body)
        case ast.Constant():
            yield from _other_constants(node)
        case ast.Call():
            yield from _called(node)
        case ast.Subscript(slice=ast.Slice() | ast.Tuple()):
            yield from _sliced(node)
        case ast.Attribute(ctx=ast.Load(), attr="real" | "imag"):
            yield "opposite", ast.Attribute(node.value, OPPOSITES[node.attr], node.ctx)


def _compared(node: ast.Compare) -> Replaced:
    for at, op in enumerate(node.ops):
        for kind, table in (("comparison", NEGATED), ("limit", NEXT_DOOR)):
            sides = (node.left, *node.comparators)[at : at + 2]
            # Among real numbers a limit is met by chance alone.
            if type(op) in table and (kind == "comparison" or any(map(_counts, sides))):
                new = copy.deepcopy(node)
                new.ops[at] = table[type(op)]()
                yield kind, new


def _counts(node: ast.expr) -> bool:
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int) and not isinstance(node.value, bool)
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "len"


def _calculated(node: ast.BinOp) -> Replaced:
    if any(isinstance(side, ast.JoinedStr) or _is_text(side) for side in (node.left, node.right)):
        return
    if type(node.op) in SWAPPED:
        yield "operator", ast.BinOp(node.left, SWAPPED[type(node.op)](), node.right)


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, (str, bytes))


def _other_constants(node: ast.Constant) -> Replaced:
    value = node.value
    if isinstance(value, bool):
        yield "constant", ast.Constant(not value)
    elif isinstance(value, int):
        yield "constant", ast.Constant(value + 1)
    elif isinstance(value, float):
        yield "constant", ast.Constant(2 * value if value else 1.0)


def _called(node: ast.Call) -> Replaced:
    name = node.func.attr if isinstance(node.func, ast.Attribute) else ast.unparse(node.func)
    if name in OPPOSITES:
        new = copy.deepcopy(node)
        if isinstance(new.func, ast.Attribute):
            new.func.attr = OPPOSITES[name]
        else:
            new.func = ast.Name(OPPOSITES[name])
        yield "opposite", new
    if name in ROUND_TRIPS:
        inner = _operand(node)
        if inner is not None:
            yield "call left out", inner
    ordered = name not in {*OPPOSITES, "isinstance", "hypot", "gcd", "lcm", "zip", "getattr"}
    if ordered and len(node.args) > 1 and not any(isinstance(a, ast.Starred) for a in node.args):
        first, second, *rest = node.args
        yield "arguments swapped", ast.Call(node.func, [second, first, *rest], node.keywords)
    for at, keyword in enumerate(node.keywords):
        if keyword.arg not in (None, "dtype", "device"):
            left = node.keywords[:at] + node.keywords[at + 1 :]
            yield "argument left out", ast.Call(node.func, node.args, left)


def _operand(node: ast.Call) -> ast.expr | None:
    """x of x.clamp(…), torch.clamp(x, …) and abs(x)."""
    if isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) not in (
        "np", "torch", "math", "scipy", "np.fft", "torch.fft",
    ):  # fmt: skip
        return node.func.value
    return node.args[0] if node.args else None


def _sliced(node: ast.Subscript) -> Replaced:
    """Each end of each slice, one further in."""
    count = len(node.slice.elts) if isinstance(node.slice, ast.Tuple) else 1
    for at in range(count):
        for end, op in (("lower", ast.Add()), ("upper", ast.Sub())):
            new = copy.deepcopy(node)
            part = new.slice.elts[at] if isinstance(new.slice, ast.Tuple) else new.slice
            if not isinstance(part, ast.Slice) or getattr(part, end) is None:
                continue
            setattr(part, end, ast.BinOp(getattr(part, end), op, ast.Constant(1)))
            yield "slice", new
