"""Bytes that arrived, and what became of them: frames, damage, text. Pure; driven with `now`."""

from __future__ import annotations

from collections import deque

from mkdaemon.protocol.framing import DropReason


class ReceivedBytes:
    """Bytes of the moving window, right and damaged."""

    def __init__(self, window: float) -> None:
        """Start empty; figures are over `window` [s]."""
        self._window = window
        self._damage: deque[tuple[float, int, DropReason]] = deque(maxlen=1024)
        self._decoded: deque[tuple[float, int]] = deque(maxlen=4096)
        self._raw: deque[tuple[float, int]] = deque(maxlen=256)
        self._text = ""

    def clear(self) -> None:
        """A port was opened: what came before says nothing about it."""
        self._damage.clear()
        self._raw.clear()

    def forget_damage(self) -> None:
        """An outage is over: the damage it did says nothing about the line as it is now."""
        self._damage.clear()

    def arrived(self, size: int, now: float) -> None:
        """Bytes arrived, whatever they are."""
        self._raw.append((now, size))

    def frame(self, size: int, now: float) -> None:
        """So many bytes were a right frame."""
        self._decoded.append((now, size))

    def damaged(self, reason: DropReason, raw: bytes, now: float, *, keep_text: bool) -> None:
        """Bytes were no frame.

        Args:
            reason: why.
            raw: the bytes.
            now: [s; monotonic].
            keep_text: text replaces the text known so far.
        """
        self._damage.append((now, len(raw), reason))
        self._decoded.append((now, len(raw)))
        if reason is DropReason.TEXT and keep_text:
            self._text = raw.decode("latin-1")

    def rates(self, now: float) -> tuple[float, float]:
        """Undecodable bytes and wrong checksums a second over the window [1/s]."""
        self._forget(now)
        checksums = sum(1 for _, _, reason in self._damage if reason is DropReason.CHECKSUM)
        return sum(size for _, size, _ in self._damage) / self._window, checksums / self._window

    def share(self, now: float) -> tuple[int, int]:
        """Damaged and all bytes of the window."""
        self._forget(now)
        return sum(size for _, size, _ in self._damage), sum(size for _, size in self._decoded)

    def arrived_since(self, since: float) -> int:
        """Bytes that arrived after a moment [s], whatever they are."""
        return sum(size for at, size in self._raw if at > since)

    def damaged_since(self, since: float) -> int:
        """Bytes that arrived after a moment [s] and were no frame."""
        return sum(size for at, size, _ in self._damage if at > since)

    def text_since(self, since: float) -> str | None:
        """The text, where everything that was no frame after a moment [s] is text; None otherwise."""
        recent = [reason for at, _, reason in self._damage if at > since]
        is_text = recent and all(reason is DropReason.TEXT for reason in recent) and _is_readable(self._text)
        return self._text if is_text else None

    def _forget(self, now: float) -> None:
        for events in (self._damage, self._decoded):
            while events and events[0][0] < now - self._window:
                events.popleft()


def _is_readable(sample: str) -> bool:
    """Mostly printable, as boot banners are and a wrong baud rate is not."""
    readable = sum(1 for c in sample if c.isascii() and (c.isprintable() or c.isspace()))
    return readable > 0 and readable >= 0.9 * len(sample)
