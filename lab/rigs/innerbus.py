"""A bus inside the process that clients take for Zenoh: `mkctl` and the simulator beside a daemon in virtual time.

Queries, subscriptions, publishers and liveliness tokens of one vehicle; everything is delivered at once.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Final

import zenoh
from pydantic import BaseModel

from mkdaemon.bus.codec import encode, encoding_of, with_age
from mkdaemon.bus.intake import Arrived
from mkdaemon.bus.names import key, suffix_of
from mkdaemon.bus.recording import BusRecorder, recorded_taker
from mkdaemon.bus.schema import schema_json, schema_names
from mkdaemon.errors import CommandRejectedError
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.command import CommandResult, refused
from mksim.programs.virtualports import LocalBus

SOURCE: Final = "5eed"
"""Id of every session."""
SOURCE_INFO: Final[Any] = SimpleNamespace(source_id=SimpleNamespace(zid=SOURCE))
"""The same as Zenoh has it, which makes one for open sessions alone."""


class Bytes(bytes):
    """A payload as Zenoh hands it over."""

    def to_bytes(self) -> bytes:
        """The bytes."""
        return bytes(self)


@dataclass(frozen=True, slots=True)
class InnerSample:
    """A sample; see `zenoh.Sample`."""

    key_expr: str
    payload: Bytes
    encoding: str
    kind: zenoh.SampleKind = field(default_factory=lambda: zenoh.SampleKind.PUT)


@dataclass(frozen=True, slots=True)
class InnerReply:
    """An answer; see `zenoh.Reply`."""

    ok: InnerSample
    err: None = None


class InnerQuery:
    """A question that somebody is answering; its end is told when all of them are done."""

    def __init__(self, asked: str, payload: bytes | None, handler: Any) -> None:
        self.key_expr = zenoh.KeyExpr(asked)
        self.payload = None if payload is None else Bytes(payload)
        self.attachment = None
        self._handler = handler
        self._open = 1

    def shared(self) -> InnerQuery:
        """The same for one more who answers."""
        self._open += 1
        return self

    def reply(self, whole: object, payload: bytes, *, encoding: str = "") -> None:
        """Answer."""
        self._handler.callback(InnerReply(InnerSample(str(whole), Bytes(payload), encoding)))

    def __enter__(self) -> InnerQuery:
        return self

    def __exit__(self, *_: object) -> None:
        self._open -= 1
        if self._open == 0 and self._handler.drop is not None:
            self._handler.drop()


class _Declared:
    """What was declared, until it is taken back."""

    def __init__(self, undeclare: Callable[[], None]) -> None:
        self._undeclare: Callable[[], None] | None = undeclare

    def undeclare(self) -> None:
        """Take it back."""
        take_back, self._undeclare = self._undeclare, None
        if take_back is not None:
            take_back()

    def __enter__(self) -> _Declared:
        return self

    def __exit__(self, *_: object) -> None:
        self.undeclare()


class _Publisher(_Declared):
    """Puts values to one key."""

    id = "0"

    def __init__(self, bus: InnerBus, whole: str) -> None:
        super().__init__(lambda: None)
        self._bus, self._whole = bus, whole

    def put(self, payload: bytes, *, encoding: str = "", attachment: bytes = b"", source_info: object = None) -> None:
        """Put one."""
        del source_info
        self._bus.arrived(self._whole, payload, encoding, attachment)


class _Liveliness:
    """Tokens."""

    def __init__(self, bus: InnerBus) -> None:
        self._bus = bus

    def declare_token(self, whole: str) -> _Declared:
        """Show one."""
        return self._bus.show_token(str(whole))

    def get(self, expression: str, *, timeout: float = 0.0) -> list[InnerReply]:
        """Those that are shown."""
        del timeout
        found = [one for one in self._bus.tokens if zenoh.KeyExpr(expression).intersects(zenoh.KeyExpr(one))]
        return [InnerReply(InnerSample(one, Bytes(), "")) for one in found]


class InnerSession:
    """A session of a client; see `zenoh.Session`."""

    def __init__(self, bus: InnerBus) -> None:
        self.id = "0"
        self.info = SimpleNamespace(routers_zid=list)  # there is no network
        self._bus = bus
        self._declared: list[_Declared] = []

    def get(self, expression: object, handler: Any, *, payload: bytes | None = None, **_: object) -> None:
        """Ask."""
        self._bus.ask_all(InnerQuery(str(expression), payload, handler))

    def declare_subscriber(self, expression: object, handler: Any) -> _Declared:
        """Hear of everything that matches."""
        return self._keep(self._bus.subscribe(str(expression), handler.callback))

    def declare_queryable(self, expression: str, handler: Any) -> _Declared:
        """Answer what matches."""
        return self._keep(self._bus.answer(expression, handler.callback))

    def declare_publisher(self, whole: str, **_: object) -> _Publisher:
        """Make a publisher."""
        return _Publisher(self._bus, whole)

    def liveliness(self) -> _Liveliness:
        """Its tokens."""
        return _Liveliness(self._bus)

    def close(self) -> None:
        """Take back everything."""
        for declared in self._declared:
            declared.undeclare()

    def _keep(self, declared: _Declared) -> _Declared:
        self._declared.append(declared)
        return declared


class InnerBus(LocalBus):
    """The bus of one daemon; for it a `Station`, for its clients the other end of their sessions.

    Attributes:
        tokens: that are shown.
    """

    def __init__(self, vehicle: str, recorder: BusRecorder) -> None:
        """Begin."""
        super().__init__()
        self.vehicle = vehicle
        self.tokens: list[str] = []
        self._recorder = recorder
        self._last: dict[str, tuple[bytes, str, float]] = {}
        self._subscribers: list[tuple[zenoh.KeyExpr, Callable[[InnerSample], None]]] = []
        self._queryables: list[tuple[zenoh.KeyExpr, Callable[[InnerQuery], None]]] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._exchange = 0
        self._put: dict[str, int] = {}

    # -- the daemon's side ----------------------------------------------------------------------------------------

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Put a value; see `Bus.publish`."""
        super().publish(suffix, value, schema=schema)
        payload, encoding, stamp = encode(value), encoding_of(schema or type(value)), getattr(value, "stamp", None)
        stamp = stamp if isinstance(stamp, Stamp) else None
        self._last[suffix] = (payload, encoding, self.loop.time() if stamp is None else stamp.monotonic)
        self._put[suffix] = self._put.get(suffix, 0) + 1
        self._recorder.sample(suffix, payload, encoding, stamp)
        self._deliver(key(self.vehicle, suffix), payload, encoding)

    def counts(self) -> dict[str, int]:
        """How many values were put, by key."""
        return dict(self._put)

    # -- the clients' side ----------------------------------------------------------------------------------------

    def show_token(self, whole: str) -> _Declared:
        """Show a liveliness token until it is taken back."""
        self._change_token(whole, is_here=True)
        return _Declared(lambda: self._change_token(whole, is_here=False))

    def subscribe(self, expression: str, take: Callable[[InnerSample], None]) -> _Declared:
        """Hand on what matches."""
        entry = (zenoh.KeyExpr(expression), take)
        self._subscribers.append(entry)
        return _Declared(lambda: self._subscribers.remove(entry))

    def answer(self, expression: str, take: Callable[[InnerQuery], None]) -> _Declared:
        """Let somebody answer what matches."""
        entry = (zenoh.KeyExpr(expression), take)
        self._queryables.append(entry)
        return _Declared(lambda: self._queryables.remove(entry))

    def arrived(self, whole: str, payload: bytes, encoding: str, attachment: bytes) -> None:
        """Take what a client put: a setpoint, or a value."""
        suffix = suffix_of(self.vehicle, whole)
        if suffix not in self.takers:
            self._deliver(whole, payload, encoding)
            return
        take, verify = self.takers[suffix]
        arrived = Arrived(self.loop.time(), payload, attachment, verify(payload, attachment), SOURCE_INFO)
        recorded_taker(self._recorder, suffix, encoding, take)(arrived)

    def ask_all(self, query: InnerQuery) -> None:
        """Have a question answered by everybody who can."""
        with query:
            asked = query.key_expr
            if not str(asked).startswith(key(self.vehicle, "")):
                return  # another vehicle's
            suffix = suffix_of(self.vehicle, str(asked))
            for expression, take in self._queryables:
                if expression.intersects(asked):
                    take(query.shared())
            if suffix.partition("/")[0] in self._handlers and "*" not in suffix and self.tokens:
                task = self.loop.create_task(self._command(query.shared(), suffix), name=f"answer {suffix}")
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
                return
            now = self.loop.time()
            for known, (payload, encoding, stamp) in list(self._last.items()):
                if asked.intersects(zenoh.KeyExpr(key(self.vehicle, known))):
                    query.reply(key(self.vehicle, known), with_age(payload, now - stamp), encoding=encoding)
            for name in schema_names():
                whole = key(self.vehicle, f"schema/{name}")
                if asked.intersects(zenoh.KeyExpr(whole)) and (schema := schema_json(name)) is not None:
                    query.reply(whole, schema, encoding="application/schema+json")

    async def _command(self, query: InnerQuery, suffix: str) -> None:
        """Ask the daemon."""
        payload = b"" if query.payload is None else bytes(query.payload)
        self._exchange += 1
        exchange = self._exchange
        self._recorder.query(suffix, payload, exchange, SOURCE)
        with query:
            try:
                result = await self._handlers[suffix.partition("/")[0]](suffix, payload)
            except CommandRejectedError as error:
                result = refused(error)
            answer = encode(result)
            self._recorder.reply(suffix, answer, encoding_of(CommandResult), exchange)
            query.reply(key(self.vehicle, suffix), answer, encoding=encoding_of(CommandResult))

    def _deliver(self, whole: str, payload: bytes, encoding: str) -> None:
        sample, here = InnerSample(whole, Bytes(payload), encoding), zenoh.KeyExpr(whole)
        for expression, take in list(self._subscribers):
            if expression.intersects(here):
                take(sample)

    def _change_token(self, whole: str, *, is_here: bool) -> None:
        if is_here:
            self.tokens.append(whole)
        else:
            self.tokens.remove(whole)
        prefix = key(self.vehicle, "client/")
        if whole.startswith(prefix):
            self.show_client(whole.removeprefix(prefix), is_here)
