"""XML read safely into a small tree that remembers lines.

Document type declarations are refused, so no entity can be declared: no file is fetched and nothing expands.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from mkdaemon.errors import ConfigError
from mkdaemon.missions.source import FilePlace

MAX_DEPTH = 64
"""Deepest nesting accepted; GPX and KML need fewer than ten levels."""


@dataclass(slots=True)
class Element:
    """One element, its name without namespace prefix.

    Attributes:
        name: local name, for example `rtept`.
        attributes: by local name.
        place: file and line of the opening tag.
        children: elements within, in order.
        runs: characters directly within, in the pieces between what else is within.
    """

    name: str
    attributes: dict[str, str]
    place: FilePlace
    children: list[Element] = field(default_factory=list)
    runs: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """Characters directly within, all runs joined."""
        return "".join(self.runs)

    def find(self, name: str) -> Element | None:
        """Return the first child of this name."""
        return next((child for child in self.children if child.name == name), None)

    def text_of(self, name: str) -> str | None:
        """Return the trimmed text of the first child of this name; None where there is none."""
        child = self.find(name)
        return None if child is None else child.text.strip()

    def walk(self, name: str) -> Iterator[Element]:
        """Yield every element of this name below, in document order."""
        for child in self.children:
            if child.name == name:
                yield child
            yield from child.walk(name)


def parse_xml(text: str, name: str) -> Element:
    """Read a document.

    Args:
        text: the document.
        name: the file, for messages.

    Raises:
        ConfigError: it is no well-formed XML, declares a document type, or nests too deeply.
    """
    # The text is decoded already: what the document says of its encoding counts for nothing, and is not looked up.
    parser = expat.ParserCreate("utf-8", " ")
    parser.buffer_text = True
    root = Element("", {}, FilePlace(name, 1))
    stack = [root]

    def here() -> FilePlace:
        return FilePlace(name, parser.CurrentLineNumber)

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) > MAX_DEPTH:
            raise here().wrong(f"elements nest deeper than {MAX_DEPTH}", "this is not a mission file")
        element = Element(_local(tag), {_local(key): value for key, value in attributes.items()}, here())
        stack[-1].children.append(element)
        stack.append(element)

    def end(_tag: str) -> None:
        stack.pop()

    def characters(run: str) -> None:
        stack[-1].runs.append(run)

    def doctype(*_: object) -> None:
        raise here().wrong("a document type declaration", "delete the <!DOCTYPE> line: mission files need none")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = characters
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        what = expat.errors.messages.get(error.code, "not well formed")
        msg = f"{name}:{error.lineno}: no well-formed XML ({what}); export the file again"
        raise ConfigError(msg) from error
    return root.children[0]


def _local(tag: str) -> str:
    """Name without its namespace."""
    return tag.rpartition(" ")[2]
