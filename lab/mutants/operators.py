"""Mutants of a module: every small change of its syntax tree that a test should notice.

Not changed are docstrings and other strings, what an f-string says, annotations, logging, what only a type checker
reads, and how a dataclass is made (mypy finds who writes to a frozen one).
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

_COMPARED: Final[dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
"""The boundary, where there is one, and the opposite."""
_CALCULATED: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.MatMult: ast.Mult,
    ast.BitOr: ast.BitAnd,
    ast.BitAnd: ast.BitOr,
}
_SWAPPED: Final = {"min": "max", "max": "min", "any": "all", "all": "any"}
_EMPTY: Final = {
    "bool": "not",
    "int": "0",
    "float": "0.0",
    "list": "[]",
    "tuple": "()",
    "dict": "{}",
    "set": "set()",
    "frozenset": "frozenset()",
}
"""What a function with this annotation returns in place of its value; `not` negates it."""
_LOGS: Final = frozenset({"log", "_log", "logger", "_logger"})
_UNREAD: Final = frozenset({"annotation", "returns", "type_comment", "type_params"})
"""Fields that only a type checker reads."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one module.

    Attributes:
        path: of the file, from the root of the tree.
        line: of the change, from 1.
        column: of the change, from 0.
        operator: kind of the change.
        scope: qualified name of the function or class it is in; empty in the module itself.
        statement: line of the statement it is in.
        at_import: the changed code runs while the module is imported.
        was: what stood there.
        becomes: what stands there now.
    """

    path: str
    line: int
    column: int
    operator: str
    scope: str
    statement: int
    at_import: bool
    was: str
    becomes: str

    @property
    def id(self) -> str:
        """The same on every machine and in every run."""
        return f"{self.path}:{self.line}:{self.column}:{self.operator}"


class _Spot(NamedTuple):
    """A field of a node; of a list in it the item of this number."""

    parent: ast.AST
    field: str
    number: int | None = None

    @contextmanager
    def holding(self, new: object) -> Iterator[None]:
        """Put something there while the context lasts; None removes an item."""
        before = getattr(self.parent, self.field)
        if self.number is None:
            setattr(self.parent, self.field, new)
        else:
            items = [new] if new is not None else []
            setattr(self.parent, self.field, [*before[: self.number], *items, *before[self.number + 1 :]])
        try:
            yield
        finally:
            setattr(self.parent, self.field, before)


class _Place(NamedTuple):
    """What surrounds a node: qualified name, whether it is in a function, its statement's line, what is returned."""

    scope: str = ""
    in_function: bool = False
    statement: int = 0
    returns: str = ""


class Module:
    """A source file and its mutants.

    Args:
        path: of the file, from the root of the tree.
        source: its text.

    Attributes:
        mutants: by their ids, in the order of the text.
        is_program: tests may start the file in a process of its own, where no line is seen.
    """

    def __init__(self, path: str, source: str) -> None:
        self._tree = ast.parse(source)
        self.is_program = any(
            isinstance(node, ast.If) and _is_left_alone(node) and "__main__" in ast.unparse(node)
            for node in self._tree.body
        )
        finder = _Finder(path)
        finder.enter(self._tree, _Place())
        self._changes = {mutant.id: (spot, new) for mutant, spot, new in finder.changes}
        assert len(self._changes) == len(finder.changes), f"{path}: two mutants with one id"
        mutants = sorted((mutant for mutant, *_ in finder.changes), key=lambda mutant: (mutant.line, mutant.column))
        self.mutants = {mutant.id: mutant for mutant in mutants}

    @classmethod
    def read(cls, root: Path, path: str) -> Module:
        """Read one of a tree."""
        return cls(path, (root / path).read_text(encoding="utf-8"))

    def with_mutant(self, mutant_id: str) -> str:
        """Return the source with one mutant in it, without its comments."""
        spot, new = self._changes[mutant_id]
        with spot.holding(new):
            return ast.unparse(ast.fix_missing_locations(self._tree))


class _Finder:
    """Walks through a tree and collects its changes: the mutant, where it is, and what takes the place of the node."""

    def __init__(self, path: str) -> None:
        self.changes: list[tuple[Mutant, _Spot, object]] = []
        self._path = path

    def enter(self, parent: ast.AST, around: _Place) -> None:
        """Look at everything below a node; decorators, bases and default values belong to what surrounds it."""
        inside = around
        match parent:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                inside = around._replace(scope=f"{around.scope}.{parent.name}".lstrip("."))
                if not isinstance(parent, ast.ClassDef):
                    returns = ast.unparse(parent.returns) if parent.returns else ""
                    inside = inside._replace(in_function=True, returns=returns)
            case ast.Lambda():
                around = inside = around._replace(in_function=True)
        for field, value in ast.iter_fields(parent):
            if field in _UNREAD:
                continue
            for number, node in enumerate(value if isinstance(value, list) else [value]):
                if isinstance(node, ast.AST) and not isinstance(node, ast.JoinedStr) and not _is_left_alone(node):
                    spot = _Spot(parent, field, number if isinstance(value, list) else None)
                    self._look(spot, node, inside if field == "body" else around)

    def _look(self, spot: _Spot, node: ast.AST, place: _Place) -> None:
        match node:
            case ast.stmt():
                place = place._replace(statement=node.lineno)
                self._statements(spot, node, place)
            case ast.expr():
                self._expressions(spot, node, place)
            case ast.keyword(arg=str()):
                callee, was = ast.unparse(spot.parent).partition("(")[0], _shown(node)
                self._add("keyword", node, place, spot, None, (f"{callee}(.., {was})", f"{callee}(..)"))
        self.enter(node, place)

    def _statements(self, spot: _Spot, node: ast.stmt, place: _Place) -> None:
        match node:
            case ast.Return(value=ast.expr() as value):
                if new := _other_value(value, place.returns):
                    self._add("return", node, place, _Spot(node, "value"), new, node)
            case ast.AugAssign(op=op) if type(op) in _CALCULATED:
                self._add("arithmetic", node, place, _Spot(node, "op"), _CALCULATED[type(op)](), node)
            case ast.If(test=test) | ast.While(test=test):
                self._negate(_Spot(node, "test"), test, place)
        if spot.number is not None and _is_removable(node, place.in_function):
            self._add("removed", node, place, spot, ast.Pass(), (_shown(node), "pass"))

    def _expressions(self, spot: _Spot, node: ast.expr, place: _Place) -> None:
        match node:
            case ast.Compare(ops=ops, comparators=comparators):
                for number, (op, right) in enumerate(zip(ops, comparators, strict=True)):
                    others = _COMPARED[type(op)]
                    for name, other in zip(("boundary", "compare")[-len(others) :], others, strict=True):
                        self._add(name, right, place, _Spot(node, "ops", number), other(), node)
            case ast.BinOp(op=op, right=right) if type(op) in _CALCULATED and not _is_text(node):
                self._add("arithmetic", right, place, _Spot(node, "op"), _CALCULATED[type(op)](), node)
            case ast.BoolOp(op=op, values=values):
                other_op = ast.Or() if isinstance(op, ast.And) else ast.And()
                self._add("boolean", values[1], place, _Spot(node, "op"), other_op, node)
            case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
                self._add("unary", node, place, spot, operand, (_shown(node), _shown(operand)))
            case ast.IfExp(test=test):
                self._negate(_Spot(node, "test"), test, place)
            case ast.Name(id=name, ctx=ast.Load()) if name in _SWAPPED:
                self._add("swapped", node, place, spot, ast.Name(_SWAPPED[name], ast.Load()), spot.parent)
            case ast.Constant(value=bool() | int() | float() as value):
                self._add("constant", node, place, spot, ast.Constant(_another(value)), spot.parent)
        if isinstance(spot.parent, ast.comprehension) and spot.field == "ifs":
            self._negate(spot, node, place)

    def _negate(self, spot: _Spot, test: ast.expr, place: _Place) -> None:
        """A condition, where not a change of the comparison says the same."""
        is_covered = isinstance(test, ast.Constant) or (isinstance(test, ast.Compare) and len(test.ops) == 1)
        if not is_covered and not (isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not)):
            self._add("negated", test, place, spot, _negated(test), (_shown(test), _shown(_negated(test))))

    def _add(
        self,
        operator: str,
        at: ast.stmt | ast.expr | ast.keyword,
        place: _Place,
        spot: _Spot,
        new: ast.AST | None,
        show: ast.AST | tuple[str, str],
    ) -> None:
        """Keep a change; `at` has its line and column, `show` what a reader sees of it, or both as words."""
        if new is not None:
            ast.copy_location(new, at)
        if isinstance(show, ast.AST):
            was = _shown(show)
            with spot.holding(new):
                show = (was, _shown(show))
        where = (at.lineno, at.col_offset, operator, place.scope, place.statement, not place.in_function)
        self.changes.append((Mutant(self._path, *where, *show), spot, new))


def _other_value(value: ast.expr, returns: str) -> ast.expr | None:
    """What is returned instead; None where nothing else fits the annotation."""
    kinds = returns.replace('"', "").split(" | ")
    if "None" in kinds:
        return None if isinstance(value, ast.Constant) and value.value is None else ast.Constant(None)
    empty = _EMPTY.get(kinds[0].partition("[")[0], "")
    if empty == "not":
        return None if isinstance(value, ast.Constant) else _negated(value)
    return ast.parse(empty, mode="eval").body if empty and ast.unparse(value) != empty else None


def _is_left_alone(node: ast.AST) -> bool:
    """Docstrings, logging, imports, what only a type checker reads, and how a dataclass is made."""
    match node:
        case ast.Call(func=ast.Name(id="dataclass")):
            return True
        case ast.Import() | ast.ImportFrom() | ast.Assert():
            return True
        case ast.Expr(value=ast.Constant()):
            return True
        case ast.Expr(value=ast.Call(func=ast.Attribute(value=value))):
            return ast.unparse(value).split(".")[-1] in _LOGS
        case ast.If(test=ast.Name(id="TYPE_CHECKING")) | ast.If(test=ast.Compare(left=ast.Name(id="__name__"))):
            return True
    return False


def _is_removable(node: ast.stmt, in_function: bool) -> bool:
    """Calls, and what stays after the function ended; a local name that is missing would be noticed at once."""
    match node:
        case ast.Expr(value=ast.Call() | ast.Await() | ast.Yield() | ast.YieldFrom()):
            return True
        case ast.AugAssign() | ast.Delete() | ast.Break() | ast.Continue() | ast.Return(value=None):
            return True
        case ast.Assign(targets=targets):
            return in_function and any(isinstance(target, ast.Attribute | ast.Subscript) for target in targets)
    return False


def _is_text(node: ast.BinOp) -> bool:
    return any(
        isinstance(side, ast.JoinedStr) or (isinstance(side, ast.Constant) and isinstance(side.value, str | bytes))
        for side in (node.left, node.right)
    )


def _negated(node: ast.expr) -> ast.expr:
    return ast.copy_location(ast.UnaryOp(ast.Not(), node), node)


def _another(value: bool | float) -> bool | float:
    """A truth turned round, the next whole number, twice a quantity."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    return 2 * value or 1.0


def _shown(node: object) -> str:
    """The first line of what a reader sees."""
    if isinstance(node, ast.comprehension):
        return ", ".join(ast.unparse(test) for test in node.ifs)
    assert isinstance(node, ast.AST)
    return ast.unparse(ast.fix_missing_locations(node)).partition("\n")[0]
