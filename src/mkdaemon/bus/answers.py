"""Answers leave on a separate thread: a client that asks and does not read does not delay the loop.

Whether a reply waits or is dropped is the asker's choice (Zenoh's QoS of the query), and it waits up to
`bus.session.STALL`: a client that sent 100 queries and read no answer held the loop for 6.0 s. The end of a query is
such a reply as well, so no query is dropped elsewhere, unless the memory would fill up.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Final

import structlog
import zenoh

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.refusals import Token, refuse

_log = structlog.get_logger(__name__)
BUSY: Final = encode(refused(refuse(Token.BUSY, detail="too many queries wait for an answer")))
"""Error in place of an answer; a `CommandResult`."""
_ENCODING: Final = encoding_of(CommandResult)
WAITING_BYTES: Final = 1 << 20
"""What may wait for an answer in all, by what came with the queries [bytes]: eight of the longest honest requests."""
SHED_BYTES: Final = 1 << 21
"""What may wait for the error `BUSY` [bytes]; queries beyond it are ended on the thread that brought them."""
MOST_SHED: Final = 256
"""How many may: as long as a query lives, Zenoh keeps the whole buffer that brought it, 64 kB (measured 80 kB each)."""
OVERHEAD: Final = 1024
"""Of a query with nothing in it [bytes]."""
LEAVE: Final = 1.0
"""Longest wait for the thread at the end [s]; what holds it up then is cut by the end of the session."""

Work = Callable[[zenoh.Query], None]
"""Replies to a query; called on the thread."""


class AnswerThread:
    """Works through queries in order; those beyond its limits get an error in place of an answer."""

    def __init__(self, name: str, *, limit: int, limit_per_key: int) -> None:
        """Start the thread.

        Args:
            name: of the thread.
            limit: queries that may wait.
            limit_per_key: queries of one key expression that may wait; Zenoh does not say which client asks.
        """
        self._limit, self._limit_per_key = limit, limit_per_key
        self._waiting: deque[tuple[zenoh.Query, Work, str]] = deque()
        self._keys: Counter[str] = Counter()
        self._shed: deque[zenoh.Query] = deque()
        self._waiting_bytes = self._shed_bytes = 0
        self._news = threading.Condition()
        self._is_over = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def submit(self, query: zenoh.Query, work: Work) -> None:
        """Have a query answered; from any thread, returns at once where the memory has room for one more."""
        asked, size = str(query.key_expr), _size(query)
        with self._news:
            is_full = len(self._waiting) >= self._limit or self._waiting_bytes + size > WAITING_BYTES
            is_taken = not is_full and self._keys[asked] < self._limit_per_key
            if is_taken:
                self._waiting.append((query, work, asked))
                self._waiting_bytes += size
                self._keys[asked] += 1
                self._news.notify()
        if not is_taken:
            self.shed(query)

    def shed(self, query: zenoh.Query) -> None:
        """Have a query answered with the error `BUSY`; from any thread, returns at once as `submit` does."""
        size = _size(query)
        with self._news:
            has_room = len(self._shed) < MOST_SHED and self._shed_bytes + size <= SHED_BYTES
            if has_room:
                self._shed.append(query)
                self._shed_bytes += size
                self._news.notify()
        if not has_room:
            query.drop()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """End the thread; what still waits gets no answer."""
        with self._news:
            self._is_over = True
            self._news.notify()
        self._thread.join(LEAVE)

    def _run(self) -> None:
        while True:
            with self._news:
                while not (self._waiting or self._shed or self._is_over):
                    self._news.wait()
                if self._is_over:
                    return
                surplus = [self._shed.popleft() for _ in range(len(self._shed) - MOST_SHED // 2)]
                shed = self._shed.popleft() if self._shed else None
                self._shed_bytes -= sum(map(_size, surplus)) + (0 if shed is None else _size(shed))
                query, work, asked = (shed, _refuse, "") if shed is not None else self._waiting.popleft()
                size = 0 if shed is not None else _size(query)
            began = time.monotonic()
            for one in surplus:
                one.drop()  # type: ignore[no-untyped-call]  # faster than an error to each, or they would fill the memory
            surplus.clear()
            try:
                with query:
                    work(query)
            except Exception:  # noqa: BLE001
                # The asker has gone, or its answer is broken: neither may end the thread.
                _log.warning("query was not answered", key=asked, exc_info=True)
            with self._news:
                if shed is None:
                    self._waiting_bytes -= size
                    self._keys[asked] -= 1
                    if not self._keys[asked]:
                        del self._keys[asked]
            # Half the time at most: the loop needs the interpreter too.
            time.sleep(min(time.monotonic() - began, LEAVE))


def _size(query: zenoh.Query) -> int:
    """What a query that waits takes of the memory [bytes]."""
    parts = (query.payload, query.attachment, str(query.parameters), str(query.key_expr))
    return OVERHEAD + sum(len(part) for part in parts if part is not None)


def _refuse(query: zenoh.Query) -> None:
    query.reply_err(BUSY, encoding=_ENCODING)
