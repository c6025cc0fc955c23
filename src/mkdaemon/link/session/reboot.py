"""Signs that the boards on the line have started anew, or are other boards: printed text, and a long silence. Pure.

A FlightCtrl prints 628 characters while it boots, in stages over 4.7 s, keeps the first stick frame it receives
meanwhile and obeys it afterwards. Source: docs/firmware-notes, "Receiving" and "External control".
"""

from __future__ import annotations

import math
from typing import Final

from mkdaemon.link.session.peers import Peers
from mkdaemon.link.session.verdict import Verdict

GAP: Final = 0.55
"""A silence longer than this may have been a reboot, or an exchange of the aircraft [s].

So long after the last frame a lease has ended, too (`control.patience`): no flight ends because of this."""
BOOT_TIME: Final = 8.0
"""Text so long after the first one belongs to the same boot [s]; a FlightCtrl boots in 4.7 s."""
_SHORTEST: Final = 8
"""Fewer characters are the rest of a broken frame."""
_SHARE: Final = 0.1
"""Part of the characters that no frame has: boot text has spaces, digits and line breaks, and noise few [characters
each]; tuned on the text of genuine boards and on frames with 5 % of their bytes damaged or lost."""
_PAYLOAD: Final = frozenset(range(0x3D, 0x7D))


def is_printed(raw: bytes) -> bool:
    """Whether bytes outside any frame were printed by a board, and are not what is left of a broken frame."""
    words = raw.strip(b" \r\n\t\0")
    foreign = sum(1 for code in words if code not in _PAYLOAD)
    readable = all(0x20 <= code < 0x7F or code in b"\r\n\t" for code in words)
    return len(words) >= _SHORTEST and readable and foreign >= _SHARE * len(words)


class RebootWatch:
    """Tells when the boards must be asked anew who they are."""

    def __init__(self, peers: Peers) -> None:
        self._peers = peers
        self._text_at = -math.inf

    def text_received(self, raw: bytes, now: float) -> bool:
        """Note text between frames; returns whether a board prints it by itself."""
        return is_printed(raw) and self._peers.redirected is None and not self._peers.caused_silence(now, now)

    def begins(self, now: float) -> bool:
        """Note a sign; returns whether it is the first one of a boot."""
        is_first = now - self._text_at > BOOT_TIME
        if is_first:
            self._text_at = now
        return is_first

    def board_named_itself(self) -> None:
        """A version reply came: what is printed from now on belongs to another boot."""
        self._text_at = -math.inf

    def was_gap(self, verdict: Verdict, now: float) -> bool:
        """Whether the line has been silent under this verdict for so long, and not by our doing."""
        is_long = verdict.is_outage and now - verdict.silent_since > GAP
        return is_long and not self._peers.caused_silence(verdict.silent_since, now)
