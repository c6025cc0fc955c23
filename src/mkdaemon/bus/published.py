"""Publishes values: put, recorded, counted, and kept as the key's last value."""

from __future__ import annotations

import time
from collections import Counter

import zenoh
from pydantic import BaseModel

from mkdaemon.bus.codec import encode, encoding_of, with_age
from mkdaemon.bus.keys import Use, find
from mkdaemon.bus.names import key
from mkdaemon.bus.recording import BusRecorder
from mkdaemon.stamp import Stamp


class PublishedValues:
    """Every key that was published."""

    def __init__(self, session: zenoh.Session, vehicle: str, recorder: BusRecorder) -> None:
        self._session = session
        self._vehicle = vehicle
        self._recorder = recorder
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._last: dict[str, tuple[bytes, str, float]] = {}
        self._counts: Counter[str] = Counter()

    def put(self, suffix: str, value: BaseModel, schema: type[BaseModel] | None) -> None:
        """Put a value; see `Bus.publish`.

        Raises:
            ValueError: the table of keys has no such published key.
        """
        publisher = self._publishers.get(suffix)
        if publisher is None:
            spec = find(suffix)
            if spec is None or spec.use is not Use.PUBLISHED:
                msg = f"{suffix} is not a published key of the table in bus/keys.py"
                raise ValueError(msg)
            publisher = self._publishers[suffix] = self._session.declare_publisher(key(self._vehicle, suffix))
        payload = encode(value)
        encoding = encoding_of(schema or type(value))
        stamp = getattr(value, "stamp", None)
        if not isinstance(stamp, Stamp):
            stamp = None
        self._last[suffix] = (payload, encoding, time.monotonic() if stamp is None else stamp.monotonic)
        self._counts[suffix] += 1
        self._recorder.sample(suffix, payload, encoding, stamp)
        publisher.put(payload, encoding=encoding)

    def counts(self) -> dict[str, int]:
        """Number of published values, by key."""
        return dict(self._counts)

    def answer_last(self, query: zenoh.Query) -> None:
        """Reply with the last value of every key asked for; `age` is the time since its stamp, or since it was put."""
        now = time.monotonic()
        for suffix, (payload, encoding, stamp) in list(self._last.items()):
            whole = key(self._vehicle, suffix)
            if query.key_expr.intersects(whole):
                query.reply(whole, with_age(payload, now - stamp), encoding=encoding)
