"""Reads the part of YAML that tag maps are written in: mappings, lists, quoted and plain values, comments.

Anchors, tags, block texts, and several documents are refused by name. Source: YAML 1.2, chapters 6 to 8.
"""

from __future__ import annotations

import re
from typing import Any, Final, NamedTuple

from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import DEEPEST, parse_number

_TEXT: Final = r'"(?:[^"\\]|\\.)*"|\'(?:[^\']|\'\')*\''
_KEY: Final = re.compile(rf"({_TEXT}|[^\s\"'\[\]{{}},#&*!|>%@-][^:#]*|-[^\s:#][^:#]*)[ \t]*:(?:[ \t]+(.*))?$")
_TOKEN: Final = re.compile(
    rf"\s*({_TEXT}|[\[\]{{}},]|:(?=[\s\[\]{{}},]|$)|[^\s\[\]{{}},:\"']+(?::[^\s\[\]{{}},:]+)*|\S.*)"
)
_COMMENT: Final = re.compile(rf"((?:{_TEXT}|[^\"'#]|(?<=\S)#|[\"'].*)*?)(?:(?:^|(?<=\s))#.*)?$")
_OTHER: Final = re.compile(r"[&*!|>%@`]")
_WORDS: Final = {"null": None, "~": None, "true": True, "True": True, "false": False, "False": False}


class _Row(NamedTuple):
    number: int
    indent: int
    text: str


def parse_yaml(text: str) -> Any:
    """Parse a document: dicts, lists, texts, numbers (int, float), True, False and None.

    Raises:
        ConfigError: the text is not this part of YAML; names the line.
    """
    rows: list[_Row] = []
    for number, line in enumerate(text.splitlines(), 1):
        match = _COMMENT.match(line)
        content = (line if match is None else match[1]).rstrip()
        stripped = content.lstrip(" ")
        if stripped.startswith("\t"):
            raise ConfigError(f"line {number}: a tab indents it; use spaces")
        if stripped and not (number == 1 and stripped.startswith("%")) and not (stripped == "---" and not rows):
            rows.append(_Row(number, len(content) - len(stripped), stripped))
    reader = _Reader(rows)
    tree = reader.block(0, 0)
    reader.must_end()
    return tree


class _Reader:
    """Goes through the rows of a document once."""

    def __init__(self, rows: list[_Row]) -> None:
        self._rows, self._at = rows, 0

    @property
    def _row(self) -> _Row | None:
        return self._rows[self._at] if self._at < len(self._rows) else None

    def must_end(self) -> None:
        """Refuse rows that belong to nothing."""
        if self._row is not None:
            raise _wrong(self._row.number, self._row.text)

    def block(self, least: int, depth: int) -> Any:
        """The value whose rows are indented by `least` at least; None where there is none."""
        row = self._row
        if row is None or row.indent < least:
            return None
        if depth > DEEPEST:
            raise ConfigError(f"line {row.number}: it nests deeper than {DEEPEST}")
        if _is_item(row):
            return self._list(row.indent, depth)
        if row.text[0] not in "[{" and _KEY.match(row.text):
            return self._mapping(row.indent, depth)
        return self._value(row, row.text)

    def _list(self, indent: int, depth: int) -> list[Any]:
        found = []
        while (row := self._row) is not None and row.indent == indent and _is_item(row):
            rest = row.text[1:].lstrip()
            if rest:
                # What follows the dash is a block that begins where it stands.
                self._rows[self._at] = _Row(row.number, indent + len(row.text) - len(rest), rest)
            else:
                self._at += 1
            found.append(self.block(indent + 1, depth + 1))
        return found

    def _mapping(self, indent: int, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        while (row := self._row) is not None and row.indent == indent and not _is_item(row):
            match = _KEY.match(row.text)
            if match is None:
                raise _wrong(row.number, row.text)
            key, rest = str(_scalar(row.number, match[1].strip())), match[2] or ""
            if key in found:
                raise ConfigError(f"line {row.number}: {key} stands there twice; remove one")
            if rest:
                found[key] = self._value(row, rest)
                continue
            self._at += 1
            # A list may stand as far left as the key it belongs to.
            below = self._row
            is_list = below is not None and below.indent == indent and _is_item(below)
            found[key] = self.block(indent + (not is_list), depth + 1)
        return found

    def _value(self, row: _Row, text: str) -> Any:
        """A value that begins in this row; one in brackets may go on in the next."""
        self._at += 1
        if text[0] not in "[{":
            return _scalar(row.number, text)
        tokens, open_ = [], 0
        while True:
            found = _TOKEN.findall(text)
            tokens += [(row.number, token) for token in found]
            open_ += sum((token in ("[", "{")) - (token in ("]", "}")) for token in found)
            if open_ <= 0:
                break
            if self._row is None:
                raise ConfigError(f"line {tokens[0][0]}: {tokens[0][1]} is never closed; close it")
            row = self._row
            text, self._at = row.text, self._at + 1
        tokens.reverse()
        value = _flow(tokens, 0)
        if tokens:
            raise _wrong(*tokens[-1])
        return value


def _is_item(row: _Row) -> bool:
    return row.text == "-" or row.text.startswith("- ")


def _flow(tokens: list[tuple[int, str]], depth: int) -> Any:
    """A value in brackets, or one inside; `tokens` are in reverse order."""
    number, token = tokens.pop()
    if depth > DEEPEST:
        raise ConfigError(f"line {number}: it nests deeper than {DEEPEST}")
    if token not in ("[", "{"):
        return _scalar(number, token)
    end, items, pairs = "]" if token == "[" else "}", [], {}
    while tokens[-1][1] != end:
        value = _flow(tokens, depth + 1)
        if end == "]":
            items.append(value)
        elif tokens[-1][1] == ":" and len(tokens) > 1:
            tokens.pop()
            if str(value) in pairs:
                raise ConfigError(f"line {number}: {value} stands there twice; remove one")
            pairs[str(value)] = None if tokens[-1][1] in (",", end) else _flow(tokens, depth + 1)
        else:
            raise ConfigError(f"line {number}: {value} has no value; write {value}: VALUE")
        if tokens[-1][1] == ",":
            tokens.pop()
        elif tokens[-1][1] != end:
            raise _wrong(*tokens[-1])
    tokens.pop()
    return items if end == "]" else pairs


def _scalar(number: int, text: str) -> Any:
    if text[0] in "\"'" and len(text) > 1 and text[-1] == text[0]:
        return text[1:-1].replace(text[0] * 2, text[0]) if text[0] == "'" else text[1:-1]
    if text in _WORDS:
        return _WORDS[text]
    if _OTHER.match(text) or text in list("[]{},:") or text[0] in "\"'":
        raise _wrong(number, text)
    try:
        return int(text) if re.fullmatch(r"[+-]?[0-9]{1,18}", text) else parse_number(text)
    except ValueError:
        return text


def _wrong(number: int, text: str) -> ConfigError:
    return ConfigError(f"line {number}: {text[:40]!r} cannot be read here; tag maps need plain keys, values and lists")
