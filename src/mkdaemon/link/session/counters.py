"""What crossed the line since the start, counted."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from mkdaemon.link.session.scheduler import Entry
from mkdaemon.protocol.boards import Board
from mkdaemon.protocol.framing import Dropped, DropReason, Frame


@dataclass(slots=True)
class Counters:
    """Bytes, frames by board and command letter (`nc.O`), and losses by reason.

    Attributes:
        rx_bytes: received.
        tx_bytes: sent.
        rx: right frames received.
        tx: frames sent.
        dropped: what did not get through.
    """

    rx_bytes: int = 0
    tx_bytes: int = 0
    rx: Counter[str] = field(default_factory=Counter)
    tx: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)

    def bytes_received(self, size: int) -> None:
        """Bytes arrived, whatever they are."""
        self.rx_bytes += size

    def frame_received(self, board: Board, frame: Frame) -> None:
        """A right frame arrived."""
        self.rx[f"{board.word}.{frame.id}"] += 1

    def damaged(self, loss: Dropped) -> None:
        """Bytes were no frame."""
        self.dropped[loss.reason.value] += 1

    def sent(self, entry: Entry) -> None:
        """A frame, or the escape sequence, went out."""
        self.tx_bytes += len(entry.raw)
        if entry.message is not None:
            self.tx[f"{entry.board.word}.{entry.message.spec.id}"] += 1

    def expired(self) -> None:
        """A frame was too old to be sent."""
        self.dropped[DropReason.EXPIRED.value] += 1
