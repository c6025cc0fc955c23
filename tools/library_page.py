"""Builds docs/library-reference.md from the docstrings of `mkdaemon.client` and of the errors it raises."""

from __future__ import annotations

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from types import ModuleType
from typing import Any

import docstring_parser
from docstring_parser import DocstringStyle

import mkdaemon.client as library
from mkdaemon import errors
from mkdaemon.client import verbcalls
from mkdaemon.client.asking import Asking
from mkdaemon.client.keytree import KeyTree

_HEAD = """# Reference of the Python library

Made from the docstrings of `mkdaemon.client` by `make docs`. [library.md](library.md) shows how to use it.
Other modules of `mkdaemon.client`, such as `linktest` and `cameralook`, are internal to `mkctl`, and may
change in any release.
"""
_ERRORS = (
    "MkError",
    "CommandRejectedError",
    "LeaseLostError",
    "ManoeuvreError",
    "NotEngagedError",
    "SilenceError",
    "ConfigError",
    "ProtocolError",
)
_SECTIONS = {"param": "Args", "returns": "Returns", "raises": "Raises", "attribute": "Attributes"}


def library_page(_: Path) -> str:
    """The whole page."""
    parts = [_HEAD, *_functions(library)]
    first = ["Vehicle", "Stream", "LastValue", "Lease"]
    parts.extend(_class(library.Vehicle))
    parts.append(_STREAMS)
    parts.extend(part for name in first[1:] for part in _class(getattr(library, name)))
    for name, cls in _services().items():
        parts.extend(_class(cls, title=f"uav.{name}"))
    others = [name for name in library.__all__ if name not in first]
    parts.extend(part for name in others for part in _class(getattr(library, name)))
    parts.append(_ERROR_HEAD)
    parts.extend(part for name in _ERRORS for part in _class(getattr(errors, name), level=3))
    return re.sub(r"\n{3,}", "\n\n", "\n".join(parts)).rstrip() + "\n"


_STREAMS = """## Streams

Every key that carries values is a `Stream`: `state/attitude` is `uav.state.attitude`, `vision/<camera>/pose` is
`uav.vision(camera).pose`. [keys.md](keys.md) lists the keys with the fields of their values.
"""
_ERROR_HEAD = "## Errors\n\nAll of them are in `mkdaemon.errors`.\n"


def _functions(module: ModuleType) -> Iterator[str]:
    for name in module.__all__:
        member = getattr(module, name)
        if inspect.isfunction(member):
            yield from _describe_function(_syntax(inspect.unwrap(member)), level=2)


def _services() -> dict[str, type]:
    """The services of a vehicle, by their attribute; those written by hand stand before those that are made."""
    found: dict[str, type] = {}
    for cls in (library.Vehicle, verbcalls.VerbCalls):
        module = vars(sys.modules[cls.__module__])
        body = inspect.getsource(vars(cls)["__init__"])
        for name, kind in re.findall(r"self\.(\w+)(?:: \w+)? = (\w+)\(self\)", body):
            if not name.startswith("_"):
                found.setdefault(name, module[kind])
    return found


def _class(cls: type, level: int = 2, title: str = "") -> Iterator[str]:
    """A class with its own public members and those of its bases within the library."""
    if not inspect.isclass(cls):
        return
    yield f"{'#' * level} {title or cls.__name__}\n"
    yield _docstring(inspect.getdoc(cls) or "")
    for base in cls.__mro__:
        if base.__module__.startswith("mkdaemon.client") and base not in {KeyTree, Asking}:
            yield from _members(base, level + 1)


def _members(cls: type, level: int) -> Iterator[str]:
    body = _syntax(cls).body
    for node, following in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            is_public = node.name == "__call__" or not node.name.startswith("_")
            if is_public and not any("overload" in ast.unparse(d) for d in node.decorator_list):
                yield from _describe_function(node, level)
        elif isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            yield from _describe_attribute(node, inspect.cleandoc(str(following.value.value)))


def _describe_attribute(node: ast.stmt, words: str) -> Iterator[str]:
    if isinstance(node, ast.AnnAssign):
        kind = re.sub(r"ClassVar\[_Last\[(\w+)\]\]", r"\1 | None", ast.unparse(node.annotation))
        yield f"* `{ast.unparse(node.target)}`: {words} `{kind}`"
    elif isinstance(node, ast.Assign):
        yield f"* `{ast.unparse(node)}`: {words}"


def _describe_function(node: ast.FunctionDef | ast.AsyncFunctionDef, level: int) -> Iterator[str]:
    """Heading, signature and docstring."""
    decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
    returned = ast.unparse(node.returns) if node.returns is not None else "None"
    if "property" in decorators:
        text = f"{node.name}: {returned}"
    else:
        arguments = re.sub(r"^(self|cls)(, )?", "", _arguments(node))
        prefix = "await " if isinstance(node, ast.AsyncFunctionDef) else ""
        if "asynccontextmanager" in decorators:
            prefix, returned = "async with ", re.sub(r"AsyncIterator\[(.*)\]", r"\1", returned)
        text = f"{prefix}{node.name.strip('_')}({arguments}) -> {returned}"
    yield f"\n{'#' * level} {node.name.strip('_')}\n\n```python\n{text}\n```\n"
    yield _docstring(ast.get_docstring(node) or "")


def _arguments(node: ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    """Arguments with the defaults written as the standard style has them; constants by their own name are left out."""
    text = re.sub(r"(?<=[\w\]])=(?=\S)", " = ", ast.unparse(node.args))
    return re.sub(r" = [A-Z_]+\b", " = ...", text)


def _docstring(text: str) -> str:
    """A Google docstring as Markdown: its sections become lists."""
    found = docstring_parser.parse(text, DocstringStyle.GOOGLE)
    parts = [_in_a_line(paragraph) for paragraph in (found.description or "").split("\n\n")]
    for kind, entries in groupby(found.meta, key=lambda entry: entry.args[0]):
        named = [(f"`{entry.args[1]}`: " if entry.args[1:] else "", entry.description or "") for entry in entries]
        parts += [f"{_SECTIONS[kind]}:", "\n".join(f"* {name}{_in_a_line(words)}" for name, words in named)]
    return "\n\n".join(parts) + "\n"


def _in_a_line(text: str) -> str:
    return " ".join(text.split())


def _syntax(thing: Any) -> Any:
    """The syntax tree of a class or function."""
    return ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]
