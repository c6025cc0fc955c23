"""`mkdaemon decode`: recorded bytes to one JSON object a frame, and one for everything that was no frame."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from mkdaemon.errors import MkError
from mkdaemon.link.ports.capture import Chunk, read_chunks
from mkdaemon.protocol.dialect import Evidence, decide
from mkdaemon.protocol.framing import Dropped, Frame, FrameDecoder
from mkdaemon.protocol.messages import VersionRequestWhich
from mkdaemon.protocol.wire import MessageDecoder, Unknown, WireMessage, board_at


@dataclass(slots=True)
class Decoding:
    """One pass over a recording: both directions, one dialect learnt on the way.

    Attributes:
        messages: typed frames by (direction, board, name).
        dropped: losses by reason, unknown frames included.
        size: bytes read.
    """

    messages: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    size: int = 0
    _framing: dict[str, FrameDecoder] = field(default_factory=lambda: {"rx": FrameDecoder(), "tx": FrameDecoder()})
    _evidence: Evidence = field(default_factory=Evidence)
    _decoder: MessageDecoder = field(default_factory=MessageDecoder)
    _foreign_version: bool = False

    def run(self, chunks: Iterable[Chunk]) -> Iterator[dict[str, Any]]:
        """Decode all chunks; what is unfinished at the end is a loss of its own.

        Raises:
            MkError: see `read_chunks`.
        """
        t: float | None = None
        for t, direction, raw in chunks:
            self.size += len(raw)
            for item in self._framing[direction].feed(raw):
                yield self._describe(t, direction, item)
        for direction, framing in self._framing.items():
            for item in framing.flush():
                yield self._describe(t, direction, item)

    def _describe(self, t: float | None, direction: str, item: Frame | Dropped) -> dict[str, Any]:
        head: dict[str, Any] = {"t": t, "dir": direction}
        if isinstance(item, Dropped):
            self.dropped[item.reason.value] += 1
            return {**head, "dropped": item.reason.value, "hex": item.raw.hex()}
        message = self._decoder.decode(item)
        board = board_at(item.address)
        word = board.word if board is not None else f"address_{item.address}"
        self._learn(direction, item, message)
        if isinstance(message, Unknown):
            self.dropped["unknown"] += 1
            return {**head, "dropped": "unknown", "board": word, "id": item.id, "hex": item.raw.hex()}
        spec = message.spec
        self.messages[direction, word, spec.name] += 1
        fields = message.model_dump(mode="json")
        return {**head, "board": word, "id": item.id, "message": spec.name, "layout": spec.layout, "fields": fields}

    def _learn(self, direction: str, frame: Frame, message: WireMessage | Unknown) -> None:
        if direction == "tx":
            if frame.id == "v":
                self._foreign_version = isinstance(message, VersionRequestWhich)
            return
        if frame.id == "V" and self._foreign_version:
            return  # it names the other board's release under its own address
        board = board_at(frame.address)
        evidence = self._evidence.with_message(board, message) if board is not None else self._evidence
        if evidence != self._evidence:
            self._evidence = evidence
            self._decoder = MessageDecoder(decide(evidence).layouts)

    def summary(self) -> str:
        """Return what was found, in a few lines."""
        lines = [f"{self.size} bytes, {self.messages.total()} messages, {self.dropped.total()} dropped"]
        lines += [f"  {count:6} {' '.join(kind)}" for kind, count in sorted(self.messages.items())]
        lines += [f"  {count:6} dropped: {reason}" for reason, count in sorted(self.dropped.items())]
        return "\n".join(lines)


def decode(
    file: Annotated[str, Parameter(help="Recording to read; - for standard input.", allow_leading_hyphen=True)], /
) -> None:
    """Decode recorded traffic: raw bytes, a capture (lines of t, dir, hex), or standard input.

    Prints one JSON object a frame and one for everything dropped, and a summary on standard error.

    Raises:
        MkError: the recording is missing, unreadable, empty, or a line of it is damaged.
    """
    decoding = Decoding()
    if file == "-":
        _print(decoding.run(read_chunks(sys.stdin.buffer, "standard input")), live=True)
    else:
        try:
            stream = Path(file).open("rb")  # noqa: SIM115 - closed below; only opening may fail this way
        except OSError as error:
            msg = f"cannot read {file}: {error.strerror or error}"
            raise MkError(msg) from error
        with stream:
            _print(decoding.run(read_chunks(stream, file)), live=False)
    print(decoding.summary(), file=sys.stderr)


def _print(objects: Iterable[dict[str, Any]], *, live: bool) -> None:
    for line in objects:
        sys.stdout.write(json.dumps(line, ensure_ascii=False) + "\n")
        if live:
            sys.stdout.flush()
    sys.stdout.flush()
