"""Channels and metadata of an MCAP file, read without trust."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel of a file.

    Attributes:
        number: its id in the file.
        topic: its name.
        message_encoding: how its messages are stored.
        metadata: what else the writer said.
    """

    number: int
    topic: str
    message_encoding: str
    metadata: dict[str, str]


class _Cut(Exception):  # noqa: N818  # never leaves this module
    """The content ends too early."""


class _Fields:
    def __init__(self, content: bytes) -> None:
        self._content = content
        self._at = 0

    def number(self, size: int) -> int:
        return int.from_bytes(self._take(size), "little")

    def text(self) -> str:
        return self._take(self.number(4)).decode()

    def map(self) -> dict[str, str]:
        length = self.number(4)
        end = self._at + length
        found = {}
        while self._at < end:
            name = self.text()
            found[name] = self.text()
        if self._at != end:
            raise _Cut
        return found

    def _take(self, size: int) -> bytes:
        part = self._content[self._at : self._at + size]
        if len(part) < size:
            raise _Cut
        self._at += size
        return part


def read_channel(content: bytes) -> Channel | None:
    """A channel from a record's content; None where it is none."""
    try:
        fields = _Fields(content)
        number = fields.number(2)
        fields.number(2)
        return Channel(number, fields.text(), fields.text(), fields.map())
    except (_Cut, UnicodeDecodeError):
        return None


def read_metadata(content: bytes) -> tuple[str, dict[str, str]] | None:
    """Name and map of a metadata record; None where it is none."""
    try:
        fields = _Fields(content)
        return fields.text(), fields.map()
    except (_Cut, UnicodeDecodeError):
        return None
