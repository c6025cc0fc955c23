"""Mutants of a module: every small change of its syntax tree that a test should notice.

Not changed are docstrings and other strings, what an f-string says, annotations, logging, what only a type checker
reads, and how a dataclass is made (mypy finds who writes to a frozen one).
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_COMPARED: Final[dict[type[ast.cmpop], tuple[tuple[str, type[ast.cmpop]], ...]]] = {
    ast.Lt: (("boundary", ast.LtE), ("compare", ast.GtE)),
    ast.LtE: (("boundary", ast.Lt), ("compare", ast.Gt)),
    ast.Gt: (("boundary", ast.GtE), ("compare", ast.LtE)),
    ast.GtE: (("boundary", ast.Gt), ("compare", ast.Lt)),
    ast.Eq: (("compare", ast.NotEq),),
    ast.NotEq: (("compare", ast.Eq),),
    ast.Is: (("compare", ast.IsNot),),
    ast.IsNot: (("compare", ast.Is),),
    ast.In: (("compare", ast.NotIn),),
    ast.NotIn: (("compare", ast.In),),
}
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
_FUNCTIONS: Final = ast.FunctionDef | ast.AsyncFunctionDef


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


@dataclass(frozen=True, slots=True)
class _Change:
    """A node in a field of its parent (at `index` of a list), and what takes its place; None removes it."""

    mutant: Mutant
    parent: ast.AST
    field: str
    index: int | None
    new: object

    def make(self) -> object:
        """Change the tree and return what stood there."""
        if self.index is None:
            old: object = getattr(self.parent, self.field)
            setattr(self.parent, self.field, self.new)
            return old
        nodes = getattr(self.parent, self.field)
        old = nodes[self.index]
        if self.new is None:
            del nodes[self.index]
        else:
            nodes[self.index] = self.new
        return old

    def undo(self, old: object) -> None:
        """Change it back."""
        if self.index is None:
            setattr(self.parent, self.field, old)
        elif self.new is None:
            getattr(self.parent, self.field).insert(self.index, old)
        else:
            getattr(self.parent, self.field)[self.index] = old


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
        finder.enter(self._tree)
        self._changes = {change.mutant.id: change for change in finder.changes}
        assert len(self._changes) == len(finder.changes), f"{path}: two mutants with one id"
        ordered = sorted(self._changes.values(), key=lambda change: (change.mutant.line, change.mutant.column))
        self.mutants = {change.mutant.id: change.mutant for change in ordered}

    @classmethod
    def read(cls, root: Path, path: str) -> Module:
        """Read one of a tree."""
        return cls(path, (root / path).read_text(encoding="utf-8"))

    def with_mutant(self, mutant_id: str) -> str:
        """Return the source with one mutant in it, without its comments."""
        change = self._changes[mutant_id]
        old = change.make()
        try:
            return ast.unparse(ast.fix_missing_locations(self._tree))
        finally:
            change.undo(old)


class _Finder:
    """Walks through a tree and collects its changes."""

    def __init__(self, path: str) -> None:
        self.changes: list[_Change] = []
        self._path = path
        self._scopes: list[str] = []
        self._functions = 0
        self._statement: ast.stmt | None = None
        self._returns = ""

    def enter(self, node: ast.AST) -> None:
        """Look at everything below a node."""
        for field, value in ast.iter_fields(node):
            if field in {"annotation", "returns", "type_comment", "type_params"}:
                continue
            if isinstance(value, list):
                for index, item in enumerate(value):
                    if isinstance(item, ast.AST):
                        self._look(node, field, index, item)
            elif isinstance(value, ast.AST):
                self._look(node, field, None, value)

    def _look(self, parent: ast.AST, field: str, index: int | None, node: ast.AST) -> None:
        if isinstance(node, ast.JoinedStr) or _is_left_alone(node):
            return
        if isinstance(node, _FUNCTIONS | ast.ClassDef):
            self._enter_scope(node)
            return
        before = self._statement
        if isinstance(node, ast.stmt):
            self._statement = node
            self._statements(parent, field, index, node)
        elif isinstance(node, ast.expr):
            self._expressions(parent, field, index, node)
        elif isinstance(node, ast.keyword) and node.arg is not None and index is not None:
            self._add("keyword", node, parent, field, index, None, show=node)
        deeper = isinstance(node, ast.Lambda)
        self._functions += deeper
        self.enter(node)
        self._functions -= deeper
        self._statement = before

    def _enter_scope(self, node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> None:
        """Decorators, bases and default values belong to what surrounds it."""
        outer, returned = self._statement, self._returns
        self._statement = node
        is_function = not isinstance(node, ast.ClassDef)
        for field, value in ast.iter_fields(node):
            if field != "body" and field != "returns":
                for index, item in enumerate(value if isinstance(value, list) else [value]):
                    if isinstance(item, ast.AST):
                        self._look(node, field, index if isinstance(value, list) else None, item)
        self._scopes.append(node.name)
        self._functions += is_function
        if not isinstance(node, ast.ClassDef):
            self._returns = ast.unparse(node.returns) if node.returns else ""
        for index, statement in enumerate(node.body):
            self._look(node, "body", index, statement)
        self._functions -= is_function
        self._scopes.pop()
        self._statement, self._returns = outer, returned

    def _statements(self, parent: ast.AST, field: str, index: int | None, node: ast.stmt) -> None:
        match node:
            case ast.Return(value=ast.expr() as value):
                if new := self._other_value(value):
                    self._add("return", node, node, "value", None, new, show=node)
            case ast.AugAssign(op=op) if type(op) in _CALCULATED:
                self._add("arithmetic", node, node, "op", None, _CALCULATED[type(op)](), show=node)
            case ast.If(test=test) | ast.While(test=test):
                self._negate(node, "test", test)
        if index is not None and _is_removable(node, self._functions > 0):
            passing = ast.copy_location(ast.Pass(), node)
            self._add("removed", node, parent, field, index, passing, show=node)

    def _other_value(self, value: ast.expr) -> ast.expr | None:
        """What is returned instead; None where nothing else fits the annotation."""
        kinds = self._returns.replace('"', "").split(" | ")
        new: ast.expr | None
        if "None" in kinds:
            new = None if _is_none(value) else ast.Constant(None)
        else:
            empty = _EMPTY.get(kinds[0].partition("[")[0], "")
            if empty == "not":
                new = None if isinstance(value, ast.Constant) else _negated(value)
            else:
                new = ast.parse(empty, mode="eval").body if empty and ast.unparse(value) != empty else None
        return None if new is None else ast.copy_location(new, value)

    def _expressions(self, parent: ast.AST, field: str, index: int | None, node: ast.expr) -> None:
        match node:
            case ast.Compare(ops=ops, comparators=comparators):
                for number, (op, right) in enumerate(zip(ops, comparators, strict=True)):
                    for name, other in _COMPARED[type(op)]:
                        self._add(name, right, node, "ops", number, other(), show=node)
            case ast.BinOp(op=op, right=right) if type(op) in _CALCULATED and not _is_text(node):
                self._add("arithmetic", right, node, "op", None, _CALCULATED[type(op)](), show=node)
            case ast.BoolOp(op=op, values=values):
                other_op = ast.Or() if isinstance(op, ast.And) else ast.And()
                self._add("boolean", values[1], node, "op", None, other_op, show=node)
            case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
                self._add("unary", node, parent, field, index, operand, show=node)
            case ast.IfExp(test=test):
                self._negate(node, "test", test)
            case ast.Name(id=name, ctx=ast.Load()) if name in _SWAPPED:
                self._add("swapped", node, parent, field, index, ast.Name(_SWAPPED[name], ast.Load()), show=parent)
            case ast.Constant(value=bool() | int() | float() as value):
                self._add("constant", node, parent, field, index, ast.Constant(_another(value)), show=parent)
        if isinstance(parent, ast.comprehension) and field == "ifs":
            self._negate(parent, field, node, index)

    def _negate(self, parent: ast.AST, field: str, test: ast.expr, index: int | None = None) -> None:
        """A condition, where not a change of the comparison says the same."""
        is_covered = isinstance(test, ast.Constant) or (isinstance(test, ast.Compare) and len(test.ops) == 1)
        if not is_covered and not (isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not)):
            self._add("negated", test, parent, field, index, _negated(test), show=test)

    def _add(
        self, operator: str, at: ast.AST, parent: ast.AST, field: str, index: int | None, new: object, *, show: ast.AST
    ) -> None:
        """Keep a change; `at` has its place, `show` what a reader sees of it."""
        if isinstance(new, ast.AST) and isinstance(at, ast.stmt | ast.expr | ast.keyword):
            ast.copy_location(new, at)
        assert isinstance(at, ast.stmt | ast.expr | ast.keyword)
        assert self._statement is not None
        place = (at.lineno, at.col_offset)
        draft = _Change(self._describe(operator, place, "", ""), parent, field, index, new)
        was = _shown(show)
        old = draft.make()
        becomes = "pass" if operator == "removed" else _shown(_negated(show) if operator == "negated" else show)
        if operator == "unary":
            becomes = _shown(new)
        if operator == "keyword":
            callee = ast.unparse(parent).partition("(")[0]
            was, becomes = f"{callee}(.., {was})", f"{callee}(..)"
        draft.undo(old)
        self.changes.append(_Change(self._describe(operator, place, was, becomes), parent, field, index, new))

    def _describe(self, operator: str, place: tuple[int, int], was: str, becomes: str) -> Mutant:
        assert self._statement is not None
        scope, statement = ".".join(self._scopes), self._statement.lineno
        return Mutant(self._path, *place, operator, scope, statement, not self._functions, was, becomes)


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


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _negated(node: ast.AST) -> ast.expr:
    assert isinstance(node, ast.expr)
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
