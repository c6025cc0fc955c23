"""Models whose fields are described by the docstrings below them, read on demand.

Under pydantic's own `use_attribute_docstrings` the source of every class is read and parsed while it is imported: a
quarter of the time that the daemon took to start.
"""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise

from pydantic import BaseModel, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema


class Described(BaseModel):
    """A model whose JSON Schema tells what the docstrings of its fields say."""

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler(core_schema)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for name, meaning in meanings_of(cls).items():
            if meaning and name in properties:
                properties[name].setdefault("description", meaning)
        return schema


@cache
def meanings_of(model: type[BaseModel]) -> Mapping[str, str]:
    """Return what the docstrings of a model's fields say, by field; empty where one has none, or there is no source."""
    found: dict[str, str] = {}
    for cls in reversed(model.__mro__):
        own = _docstrings(cls.__module__).get(cls.__qualname__, {}) if issubclass(cls, BaseModel) else {}
        found.update({name: own.get(name, "") for name in inspect.get_annotations(cls)})
    return {name: field.description or found.get(name, "") for name, field in model.model_fields.items()}


@cache
def _docstrings(module: str) -> Mapping[str, Mapping[str, str]]:
    """Docstrings of the fields of every class of a module."""
    try:
        source = inspect.getsource(sys.modules[module])
    except (OSError, TypeError):
        return {}
    return dict(_classes(ast.parse(source).body, ""))


def _classes(body: Sequence[ast.stmt], prefix: str) -> Iterator[tuple[str, Mapping[str, str]]]:
    """The qualified name of every class, and the docstrings of its fields."""
    for node in body:
        if isinstance(node, ast.ClassDef):
            yield f"{prefix}{node.name}", dict(_fields(node))
            yield from _classes(node.body, f"{prefix}{node.name}.")
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from _classes(node.body, f"{prefix}{node.name}.<locals>.")


def _fields(node: ast.ClassDef) -> Iterator[tuple[str, str]]:
    for field, below in pairwise(node.body):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(below, ast.Expr)
            and isinstance(below.value, ast.Constant)
            and isinstance(below.value.value, str)
        ):
            yield field.target.id, inspect.cleandoc(below.value.value)
