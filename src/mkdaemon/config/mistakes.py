"""Mistakes of a configuration, one line each: file, line, key, what is needed, the nearest valid key."""

from __future__ import annotations

import difflib
import json
import math
import re
import typing
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from mkdaemon.config.root import Config
from mkdaemon.described import meanings_of
from mkdaemon.errors import ConfigError

Place = tuple[str | int, ...]

_TAG: Final = re.compile(r"[A-Z]|(literal|dict|tuple|list|set)\[|constrained-|function-|(bool|int|float|str|path)$")
"""Parts of a pydantic location that name the branch of a union and stand in no file."""
_NEEDS: Final[Mapping[str, str]] = {
    "string_type": "a text in quotes",
    "path_type": "a path in quotes",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "tuple_type": "an array [ ... ]",
    "dict_type": "a table {{ ... }}",
    "model_type": "a section [{place}]",
    "literal_error": "{expected}",
    "enum": "{expected}",
}
"""What a value should have been, by pydantic's type of the mistake; other mistakes are bounds and say so themselves."""
_BOUNDS: Final[Mapping[str, str]] = {
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "string_too_short": "must not be empty",
    "missing": "must be given",
}


_UNIT: Final = re.compile(r"\[([A-Za-z%][^\],;]*)[^\]]*\]")


class Mistake(NamedTuple):
    """One mistake.

    Attributes:
        section: where the union or the value stands; mistakes of one section are branches of one union.
        place: the value itself.
        details: what pydantic says.
    """

    section: Place
    place: Place
    details: ErrorDetails


class MistakesError(ConfigError):
    """A configuration with mistakes; its text has the first, unknown keys first, and how many more there are.

    Attributes:
        each: one line for every mistake.
    """

    def __init__(self, each: Sequence[str]) -> None:
        more = f" (and {len(each) - 1} more)" if len(each) > 1 else ""
        super().__init__(each[0] + more)
        self.each = tuple(each)


def explain(
    error: ValidationError, path: Path | None, text: str, given: Mapping[str, str], root: type[BaseModel] = Config
) -> MistakesError:
    """One line for every mistake, unknown keys first.

    Args:
        error: what validation found.
        path: file that was read; None for none.
        text: what stands in it.
        given: where values that go before the file come from, by dotted key: `command line`.
        root: what the whole file stands for.
    """
    mistakes = [_mistake(details) for details in error.errors(include_url=False)]
    mistakes.sort(key=lambda mistake: mistake.details["type"] != "extra_forbidden")
    sections: dict[Place, list[Mistake]] = {}
    for mistake in mistakes:
        sections.setdefault(mistake.section, []).append(mistake)
    return MistakesError([_line(branches, path, text, given, root) for branches in sections.values()])


def _line(
    branches: list[Mistake], path: Path | None, text: str, given: Mapping[str, str], root: type[BaseModel]
) -> str:
    """One line for what one place of the file does not fit."""
    deepest = max(len(mistake.place) for mistake in branches)
    branches = [mistake for mistake in branches if len(mistake.place) == deepest]
    place = branches[0].place
    key = ".".join(str(part) for part in place)
    other = next((given[option] for option in given if key == option or key.startswith(f"{option}.")), None)
    if other is not None:
        where = other
    elif path is None:
        where = "configuration"
    else:
        line = line_of(text, place)
        where = f"{path}:{line}" if line else str(path)
    return f"{where}: {key or 'configuration'}: {_what(branches, root)}"


def _mistake(details: ErrorDetails) -> Mistake:
    location = details["loc"]
    # The first part is a key of the file, whatever it looks like.
    tags = [i for i, part in enumerate(location) if i > 0 and isinstance(part, str) and _TAG.match(part)]
    place = tuple(part for i, part in enumerate(location) if i not in tags)
    return Mistake(location[: tags[0]] if tags else place, place, details)


def _what(branches: Sequence[Mistake], root: type[BaseModel]) -> str:
    details = next((branch.details for branch in branches if branch.details["type"] not in _NEEDS), None)
    if details is None:
        needs = dict.fromkeys(_need(branch) for branch in branches)
        return f"{' or '.join(needs)} is needed{_shown(branches[0].details)}"
    if details["type"] == "extra_forbidden":
        return _unknown_key(branches[0].place, root)
    bound = _BOUNDS.get(details["type"])
    if bound is not None:
        unit = _unit(branches[0].place, root)
        needed = " ".join(filter(None, (bound.format(**details.get("ctx", {})), unit)))
        return f"{needed}{_shown(details)}{_degrees(details, unit)}"
    if details["type"] == "string_pattern_mismatch" and (meaning := _meaning(branches[0].place, root)):
        return f"{json.dumps(details['input'])} will not do. {meaning}"
    reason = details["msg"].removeprefix("Value error, ")
    return f"{reason[:1].lower()}{reason[1:]}{'' if details['type'] == 'value_error' else _shown(details)}"


def _need(mistake: Mistake) -> str:
    place = ".".join(str(part) for part in mistake.place)
    if mistake.details["type"] == "tuple_type" and isinstance(mistake.details["input"], dict):
        return f"an array of tables [[{place}]]"
    return _NEEDS[mistake.details["type"]].format(place=place, **mistake.details.get("ctx", {}))


def _shown(details: ErrorDetails) -> str:
    """The value that was found, as TOML writes it; nothing for a section or an array."""
    value = details["input"]
    is_empty = details["type"] in {"missing", "string_too_short"}
    return "" if is_empty or isinstance(value, dict | list) else f", not {json.dumps(value)}"


def _meaning(place: Place, root: type[BaseModel]) -> str:
    """What a key is for: the docstring of its field."""
    if not place:
        return ""
    for model in _models_at(place[:-1], root):
        if (meaning := meanings_of(model).get(str(place[-1]))) is not None:
            return meaning.partition("\n\n")[0]
    return ""


def _unit(place: Place, root: type[BaseModel]) -> str:
    """The unit of a key, as its meaning, or that of the table it is in, has it in brackets; empty where none has."""
    found: list[str] = _UNIT.findall(_meaning(place, root) or _meaning(place[:-1], root))
    return found[-1] if found else ""


def _degrees(details: ErrorDetails, unit: str) -> str:
    """The right number if degrees were written: too large as radians, plausible as degrees."""
    limit = next((float(value) for name, value in details.get("ctx", {}).items() if name in {"lt", "le"}), None)
    value = details["input"]
    if not unit.startswith("rad") or limit is None or not isinstance(value, int | float) or value <= limit:
        return ""
    meant = math.radians(value)
    return f"; {value:g} degrees are {meant:.3g} rad" if meant <= limit else ""


def _unknown_key(place: Place, root: type[BaseModel]) -> str:
    name = str(place[-1])
    here = sorted({key for model in _models_at(place[:-1], root) for key in model.model_fields})
    elsewhere = [dotted for dotted in _all_keys(root) if dotted.rpartition(".")[2] == name]
    if elsewhere:
        return f'unknown key here; "{elsewhere[0]}" is where it belongs'
    near = difflib.get_close_matches(name, here, n=1, cutoff=0.5)
    if near:
        return f'unknown key; did you mean "{near[0]}"?'
    return f"unknown key; known here: {', '.join(here)}" if here else "unknown key"


def _models_at(place: Place, root: type[BaseModel]) -> list[type[BaseModel]]:
    """The section at a place; list indices are passed over."""
    models: list[type[BaseModel]] = [root]
    for part in place:
        found = [
            inner
            for model in models
            if isinstance(part, str) and part in model.model_fields
            for inner in _models(model.model_fields[part].annotation)
        ]
        models = found or models
    return models


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Every model an annotation may hold."""
    parts = typing.get_args(annotation)
    if not parts and isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in parts:
        yield from _models(inner)


def _all_keys(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    for name, info in model.model_fields.items():
        yield prefix + name
        for inner in _models(info.annotation):
            yield from _all_keys(inner, f"{prefix}{name}.")


_HEADER: Final = re.compile(r"^\s*(\[\[?)\s*([^\]]+?)\s*\]\]?")
_ASSIGNMENT: Final = re.compile(r"^\s*([A-Za-z0-9_\-\".]+)\s*=")


def line_of(text: str, place: Place) -> int | None:
    """Find the line of a key by reading headers and assignments only.

    Where the key itself does not stand in the text: the nearest section above it, or the first line below it.
    """
    wanted = list(place)
    found: dict[int, int] = {}
    section: list[str | int] = []
    tables: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            here = section = []
            if header[1] == "[[":
                tables[header[2]] = tables.get(header[2], -1) + 1
            names = [part.strip().strip('"') for part in header[2].split(".")]
            for depth, name in enumerate(names, 1):
                section.append(name)
                if (index := tables.get(".".join(names[:depth]))) is not None:  # the latest table of an array
                    section.append(index)
        elif assignment := _ASSIGNMENT.match(line):
            here = [*section, *(part.strip('"') for part in assignment[1].split("."))]
        else:
            continue
        shared = min(len(here), len(wanted))
        if here[:shared] == wanted[:shared]:
            found.setdefault(shared, number)
    return found[max(found)] if found else None
