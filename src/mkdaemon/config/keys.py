"""Every key of a configuration file in words: type, unit, default, range, meaning, and what a wrong value does.

All of it is read from the models, which are the one declaration.
"""

from __future__ import annotations

import json
import re
import types
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from mkdaemon.config.base import Reloadable
from mkdaemon.described import meanings_of

_CODE: Final = re.compile(r"`[^`]*`")
_UNIT: Final = re.compile(r" ?\[([^\[\]]+)\]")
_TYPES: Final = {int: "whole number", float: "number", str: "text", bool: "true or false", Path: "path"}
_LIMITS: Final = {
    "minimum": ">=",
    "exclusiveMinimum": ">",
    "maximum": "<=",
    "exclusiveMaximum": "<",
    "maxLength": "length <=",
}


class ConfigKey(NamedTuple):
    """One key of a file.

    Attributes:
        section: where it stands, for example `control.limiter`; empty for the top of the file.
        name: the key.
        kind: its type, in words.
        unit: of a number; empty where the name has it, or there is none.
        default: as the file would have it; `unset` or `*required*`.
        limits: what values there may be; empty for any.
        meaning: what it is for.
        consequence: what a wrong value does; empty if it is not documented.
        is_reloadable: a running daemon reloads it.
    """

    section: str
    name: str
    kind: str
    unit: str
    default: str
    limits: str
    meaning: str
    consequence: str
    is_reloadable: bool

    @property
    def dotted(self) -> str:
        """Section and name."""
        return f"{self.section}.{self.name}" if self.section else self.name


def keys_of(model: type[BaseModel], section: str = "", defaults: BaseModel | None = None) -> Iterator[ConfigKey]:
    """Every key of a file, section by section.

    Args:
        model: what reads the section.
        section: name of the section.
        defaults: the section as it is where the file says nothing; None where the model's own defaults hold.
    """
    schema = model.model_json_schema()["properties"]
    inner: list[tuple[str, type[BaseModel], BaseModel | None]] = []
    for name, info in model.model_fields.items():
        default = info.default if defaults is None else getattr(defaults, name)
        part = section_model(info.annotation)
        if part is not None:
            path = f"{section}.{name}" if section else name
            inner.append((path, part, default if isinstance(default, BaseModel) else None))
            continue
        first, _, consequence = meanings_of(model)[name].partition("\n\n")
        unit, meaning = unit_of(first)
        yield ConfigKey(
            section,
            name,
            kind=_kind_of(info.annotation),
            unit=unit,
            default=_default_of(info, default),
            limits=limits_of(schema[name]),
            meaning=meaning,
            consequence=" ".join(consequence.split()),
            is_reloadable=any(isinstance(mark, Reloadable) for mark in info.metadata),
        )
    for path, part, known in inner:
        yield from keys_of(part, path, known)


def section_at(model: type[BaseModel], section: str) -> FieldInfo:
    """The field of a section, by its dotted name.

    Raises:
        KeyError: there is none.
    """
    head, _, rest = section.partition(".")
    info = model.model_fields[head]
    part = section_model(info.annotation)
    return info if not rest or part is None else section_at(part, rest)


def section_model(annotation: Any) -> type[BaseModel] | None:
    """The model of a field that is a section, or a list of sections."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    if get_origin(annotation) in (tuple, Union, types.UnionType):
        return next(filter(None, map(section_model, get_args(annotation))), None)
    return None


def is_list(annotation: Any) -> bool:
    """Whether a section may stand there many times: `[[cameras]]`."""
    return get_origin(annotation) is tuple


def heading_of(model: type[BaseModel], section: str) -> str:
    """Heading of a section: a table, or one of a list of tables."""
    return f"[[{section}]]" if is_list(section_at(model, section).annotation) else f"[{section}]"


def about_section(model: type[BaseModel], section: str) -> str:
    """Purpose of a section."""
    part = section_model(section_at(model, section).annotation)
    return "" if part is None else " ".join((part.__doc__ or "").split())


def limits_of(field: dict[str, Any]) -> str:
    """Allowed values of a field of a JSON schema, in words; empty for any."""
    words = []
    for part in (field, *field.get("anyOf", ())):
        words += [f"{sign} {part[limit]:g}" for limit, sign in _LIMITS.items() if limit in part]
        if "pattern" in part:
            words.append(f"matches `{part['pattern']}`")
    return ", ".join(words)


def unit_of(description: str) -> tuple[str, str]:
    """Unit and meaning; the unit is the last word in brackets that is no code."""
    words = " ".join(description.split())
    hidden = _CODE.sub(lambda code: "x" * len(code[0]), words)
    found = list(_UNIT.finditer(hidden))
    if not found:
        return "", words
    unit = found[-1]
    return unit[1], words[: unit.start()] + words[unit.end() :]


def _kind_of(annotation: Any) -> str:
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kind_of(args[0])
    if origin is Literal:
        return ", ".join(f"`{value}`" for value in args)
    if origin in (Union, types.UnionType):
        return " or ".join(_kind_of(arg) for arg in args if arg is not type(None))
    if origin is tuple:
        return f"list of {_kind_of(args[0])}s" if args[-1] is Ellipsis else f"list of {len(args)} {_kind_of(args[0])}s"
    if origin is dict:
        return f"table of {_kind_of(args[1])}s"
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return ", ".join(f"`{member.value}`" for member in annotation)
    return _TYPES[annotation]


def _default_of(info: FieldInfo, default: Any) -> str:
    if info.is_required():
        return "*required*"
    if default is None:
        return "unset"
    return f"`{toml_value(default.value if isinstance(default, Enum) else default)}`"


def toml_value(value: object) -> str:
    """A value as a file has it."""
    match value:
        case bool():
            return str(value).lower()
        case str() | Path():
            return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
        case list() | tuple():
            return f"[{', '.join(map(toml_value, value))}]"
        case dict():
            return f"{{ {', '.join(f'{name} = {toml_value(inner)}' for name, inner in value.items())} }}"
    return f"{value}"
