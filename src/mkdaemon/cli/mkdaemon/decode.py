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
from mkdaemon.foreignfiles import LONGEST_CAPTURE, open_regular
from mkdaemon.protocol import Chunk, Decoded, Dropped, Unknown, decode_chunks, read_chunks
from mkdaemon.protocol.framing import Frame, FrameDecoder


@dataclass(slots=True)
class Decoding:
    """One pass over a recording: describes everything in it, and counts.

    Attributes:
        messages: typed frames by (direction, board, name).
        dropped: losses by reason, unknown frames included.
        size: bytes read.
        turned: of the losses, frames that are whole with a carriage return for their line feed.
    """

    messages: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    size: int = 0
    turned: int = 0

    def run(self, chunks: Iterable[Chunk]) -> Iterator[dict[str, Any]]:
        """Decode all chunks; an unfinished frame at the end counts as a separate loss.

        Raises:
            MkError: see `read_chunks`.
        """
        return map(self._describe, decode_chunks(map(self._counted, chunks)))

    def _counted(self, chunk: Chunk) -> Chunk:
        self.size += len(chunk.raw)
        return chunk

    def _describe(self, decoded: Decoded) -> dict[str, Any]:
        t, direction, frame, content = decoded
        head: dict[str, Any] = {"t": t, "dir": direction.value}
        if isinstance(content, Dropped):
            self.dropped[content.reason.value] += 1
            self.turned += _was_turned(content.raw)
            return {**head, "dropped": content.reason.value, "hex": content.raw.hex()}
        assert frame is not None
        word = f"address_{frame.address}" if decoded.board is None else decoded.board.word
        if isinstance(content, Unknown):
            self.dropped["unknown"] += 1
            return {**head, "dropped": "unknown", "board": word, "id": frame.id, "hex": frame.raw.hex()}
        spec = content.spec
        self.messages[direction.value, word, spec.name] += 1
        fields = content.model_dump(mode="json")
        return {**head, "board": word, "id": frame.id, "message": spec.name, "layout": spec.layout, "fields": fields}

    def summary(self) -> str:
        """Return what was found, in a few lines."""
        lines = [f"{self.size} bytes, {self.messages.total()} messages, {self.dropped.total()} dropped"]
        lines += [f"  {count:6} {' '.join(kind)}" for kind, count in sorted(self.messages.items())]
        lines += [f"  {count:6} dropped: {reason}" for reason, count in sorted(self.dropped.items())]
        if self.turned:
            lines.append(
                f"  {self.turned:6} of these are whole with CR for LF: the terminal that recorded them was not raw; "
                "record again after: stty -F DEVICE raw"
            )
        return "\n".join(lines)


def _was_turned(raw: bytes) -> bool:
    """Whether a terminal made a line feed of the carriage return of a frame (icrnl)."""
    return raw.endswith(b"\n") and any(isinstance(item, Frame) for item in FrameDecoder().feed(raw[:-1] + b"\r"))


def decode(
    file: Annotated[str, Parameter(help="Recording to read; - for standard input.", allow_leading_hyphen=True)], /
) -> None:
    """Decode recorded traffic: raw bytes, a capture (lines of t, dir, hex), or standard input.

    Prints one JSON object a frame and one for everything dropped, and a summary on standard error.

    Example: mkdaemon decode bytes.bin

    Raises:
        MkError: the recording is missing, unreadable, empty, or a line of it is damaged.
    """
    decoding = Decoding()
    if file == "-":
        _print(decoding.run(read_chunks(sys.stdin.buffer, "standard input")), live=True)
    else:
        try:
            stream = open_regular(Path(file), LONGEST_CAPTURE)
        except OSError as error:
            msg = f"cannot read {file}: {error.strerror or error}; name a file of recorded bytes, or - for a stream"
            raise MkError(msg) from error
        with stream:
            _print(decoding.run(read_chunks(stream, file)), live=False)
    print(decoding.summary(), file=sys.stderr)


def _print(objects: Iterable[dict[str, Any]], *, live: bool) -> None:
    for line in objects:
        sys.stdout.write(json.dumps(line) + "\n")
        if live:
            sys.stdout.flush()
    sys.stdout.flush()
