"""What every part of the client stands on: queries, subscriptions, publishers and tokens of one vehicle.

Nothing is imported from the daemon: any program on any machine can do the same with zenoh and msgpack alone.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager, suppress
from types import MappingProxyType
from typing import Any, Final

import msgpack
import zenoh

from mkdaemon.bus.callbacks import direct
from mkdaemon.bus.names import ROOT, key, received_suffix, received_vehicle
from mkdaemon.client.answers import Answer
from mkdaemon.client.patterns import require_known
from mkdaemon.client.samples import Sample, read_payload
from mkdaemon.client.watch import Handover, Watch
from mkdaemon.errors import CommandRejectedError, MkError
from mkdaemon.telemetry.status import Status

PATIENCE: Final = 15.0
"""Longest wait for the answer to a command [s]; board requests with retries take up to 8 s."""
DENIAL_LOOK: Final = 2.0
"""Longest wait for the answers that show whether this client may command at all [s]."""
SEQUENCES: Final = 1 << 32
"""Zenoh's numbers of a source restart at zero after this one."""
_SECURED: Final = ("tls/", "quic/")
_OTHER_ROOTS: Final = frozenset({"do", "sim"})
"""Targets of a command that are no boards."""


class SetpointPublisher:
    """Puts setpoints to one key, each with the id of this session, so that a recording says who sent it."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._publisher = publisher
        self._number = 0

    def put(self, payload: bytes, *, encoding: str | None = None, attachment: bytes | None = None) -> None:
        """Put one; see `mkdaemon.telemetry.signature` for the attachment."""
        self._number = (self._number + 1) % SEQUENCES
        source = zenoh.SourceInfo(self._publisher.id, self._number)
        self._publisher.put(payload, encoding=encoding, attachment=attachment, source_info=source)


class Transport:
    """An open session with one vehicle's daemon.

    Attributes:
        vehicle: name of the vehicle.
        endpoint: Zenoh endpoint of its daemon or of a router.
    """

    def __init__(self, session: zenoh.Session, vehicle: str, endpoint: str) -> None:
        self.vehicle = vehicle
        self._root = ROOT
        self._session = session
        self.endpoint = endpoint
        self._loop = asyncio.get_running_loop()
        self._handover = Handover(self._loop)

    @property
    def session(self) -> zenoh.Session:
        """The Zenoh session, for keys outside the vehicle."""
        return self._session

    async def get_all(self, pattern: str, *, patience: float = 3.0) -> dict[str, Sample]:
        """Ask for the last values of all keys that match, each with its `age`.

        Args:
            pattern: key without `mk/<vehicle>/`; may hold `*` and `**`.
            patience: longest wait [s].

        Returns:
            The samples by key; empty if nothing was published yet.

        Raises:
            MkError: the pattern is not a key expression.
            CommandRejectedError: the daemon has too many queries to answer.
        """
        replies = await self._query(pattern, b"", patience)
        return {sample.suffix: sample for sample in replies}

    async def get_past(self, pattern: str, past: float, ahead: float = 0.0) -> list[Sample]:
        """Ask for the last values of all keys that match and, where a recording is played, for those around its place.

        Args:
            pattern: key without `mk/<vehicle>/`; may hold `*` and `**`.
            past: all values from this time before the place on [s]; a daemon has only the last ones.
            ahead: and up to this time after it [s].

        Returns:
            The samples, those of one key in order, each with its `age`.

        Raises:
            MkError: the pattern is not a key expression.
            CommandRejectedError: the daemon has too many queries to answer.
        """
        return await self._query(pattern, b"", PATIENCE, {"past": str(past), "ahead": str(ahead)})

    async def get(self, suffix: str, *, patience: float = 3.0) -> Sample | None:
        """Ask for the last value of a key, with its `age`; None if nothing was published yet.

        Args:
            suffix: key without `mk/<vehicle>/`.
            patience: longest wait [s].

        Raises:
            MkError: there is no such key.
            CommandRejectedError: the daemon has too many queries to answer.
        """
        sample = (await self.get_all(suffix, patience=patience)).get(self._suffix(suffix))
        if sample is None:
            require_known(self._suffix(suffix))
        return sample

    async def command(
        self, target: str, name: str, fields: Mapping[str, Any] | None = None, *, patience: float = PATIENCE
    ) -> Answer:
        """Ask a board, or the daemon, to do something.

        Args:
            target: `fc`, `nc`, `mag`, ... for a MikroKopter request, `do` for a verb of the daemon, `sim` for one of
                the simulator.
            name: key of the request, for example `version_request`, or the verb.
            fields: of the request, models among them; dangerous ones want `confirm = True`.
            patience: longest wait for the answer [s].

        Raises:
            MkError: no daemon, or more than one, serves this vehicle at the endpoint.
        """
        suffix = f"{target}/{name}" if target in _OTHER_ROOTS else f"cmd/{target}/{name}"
        try:
            replies = await self._query(suffix, msgpack.packb(dict(fields or {}), default=vars), patience)
        except CommandRejectedError as error:
            return Answer(Status.BUSY, {}, error.token, error.reason, error.fix)
        if not replies:
            raise MkError(await self._silence(suffix))
        if len(replies) > 1:
            msg = (
                f"{len(replies)} daemons of the name {self.vehicle} answered, and all have obeyed: "
                "give each aircraft a different vehicle.name"
            )
            raise MkError(msg)
        return Answer.from_fields(replies[0].fields)

    async def _silence(self, suffix: str) -> str:
        """Why a command got no answer."""
        if (absence := await self.absence()) is not None:
            return absence
        if self.endpoint.startswith(_SECURED) and await self._is_denied():
            return (
                f"access denied: the daemon at {self.endpoint} answers this client, but not {suffix}: this "
                "certificate may look and not command; use a pilot's (docs/security.md)"
            )
        return f"the daemon gives no answer to {suffix}: is it older than this client?"

    async def _is_denied(self) -> bool:
        """Whether the daemon answers a query that every client may make, but no command."""
        show = msgpack.packb({"action": "show"})
        commands = await self._query("do/lease", show, DENIAL_LOOK)
        return not commands and bool(await self._query("schema/LeaseRequest.v1", b"", PATIENCE))

    def watch(self, *patterns: str, backlog: int | None = None, are_known: bool = False) -> Watch:
        """Subscribe to keys: iterate over the samples with `async for`; `async with` subscribes at once.

        Args:
            patterns: keys without `mk/<vehicle>/`; may hold `*` and `**`.
            backlog: samples that may wait for a slow reader before the oldest is dropped; 4096 unless given.
            are_known: the patterns are keys of the table, and need not be looked up there.

        Raises:
            MkError: a pattern is not a key expression, or no key that exists matches it.
        """
        expressions = [self._expression(pattern) for pattern in patterns]
        if not are_known:
            for pattern in patterns:
                require_known(self._suffix(pattern))
        return Watch(self._session, expressions, self._sample, self._handover, backlog)

    @contextmanager
    def each(self, pattern: str, take: Callable[[Sample], None]) -> Iterator[None]:
        """Subscribe without the loop: a value costs no wake-up of it, and waits for nothing that runs there.

        Args:
            pattern: key of the table without `mk/<vehicle>/`; may hold `*` and `**`.
            take: called with each sample on Zenoh's thread, one after the other. Values that come while it works wait
                at their sender, which drops what is too many.

        Raises:
            MkError: the pattern is not a key expression.
        """

        def on_sample(sample: zenoh.Sample) -> None:
            if (found := self._sample(sample)) is not None:
                take(found)

        subscriber = self._session.declare_subscriber(self._expression(pattern), direct(on_sample))
        try:
            yield
        finally:
            with suppress(zenoh.ZError):  # the session may be closed
                subscriber.undeclare()  # type: ignore[no-untyped-call]

    @asynccontextmanager
    async def token(self, name: str) -> AsyncIterator[None]:
        """Declare the liveliness token `client/<name>` while the context lasts; its end ends a lease."""
        with self._session.liveliness().declare_token(self._key(f"client/{name}")):
            yield

    def stream(self, suffix: str) -> SetpointPublisher:
        """Make a publisher for setpoints: a setpoint that cannot be sent at once is dropped."""
        publisher = self._session.declare_publisher(
            self._key(suffix),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        return SetpointPublisher(publisher)

    async def vehicles(self) -> list[str]:
        """Names of all vehicles with a live daemon, and of recordings played under a name."""
        # Each by its name: access control answers no question that asks for more than it allows.
        asked = [self._session.liveliness().get(f"{ROOT}/*/{token}", timeout=1) for token in ("alive", "playing")]
        replies = await asyncio.to_thread(lambda: [reply for one in asked for reply in one])
        names = {received_vehicle(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None}
        return sorted(name for name in names if name is not None)

    def _key(self, suffix: str) -> str:
        return key(self.vehicle, suffix, self._root)

    def _suffix(self, pattern: str) -> str:
        return pattern.removeprefix(self._key(""))

    def _expression(self, pattern: str) -> zenoh.KeyExpr:
        """A pattern as a user writes it; whole keys, copied from somewhere, are understood too.

        Raises:
            MkError: it is not a key expression.
        """
        try:
            return zenoh.KeyExpr(self._key(self._suffix(pattern)))
        except zenoh.ZError as error:
            why = str(error).partition(" at /")[0].rpartition("`: ")[2]
            raise MkError(f"{pattern!r} is not a key: {why}") from error

    async def _query(
        self, suffix: str, payload: bytes, patience: float, parameters: Mapping[str, str] = MappingProxyType({})
    ) -> list[Sample]:
        done: asyncio.Future[None] = self._loop.create_future()
        replies: list[zenoh.Sample] = []
        loop = self._loop

        def finish() -> None:
            if not done.done():
                done.set_result(None)

        errors: list[zenoh.ReplyError] = []

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                replies.append(reply.ok)
            elif reply.err is not None:
                errors.append(reply.err)

        def on_end() -> None:
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(finish)

        handler = direct(on_reply, end=on_end)
        # Every answer, also a second one of the same key: a router would keep only one of two daemons' answers.
        self._session.get(
            zenoh.Selector(self._expression(suffix), dict(parameters)),
            handler,
            payload=payload or None,
            timeout=patience,
            consolidation=zenoh.ConsolidationMode.NONE,
            source_info=zenoh.SourceInfo(self._session.id, 0),  # a recording says who asked
        )
        await done
        if errors and not replies:
            _raise_refusal(errors[0])
        return [sample for reply in replies if (sample := self._sample(reply)) is not None]

    def _sample(self, sample: zenoh.Sample) -> Sample | None:
        """Read what arrived; None where it names no key of this vehicle, or is no value."""
        suffix = received_suffix(self.vehicle, str(sample.key_expr), self._root)
        return None if suffix is None else read_sample(sample, suffix)

    async def absence(self) -> str | None:
        """The reason why this vehicle has no daemon, with the vehicles present; None if it has one."""
        others = await self.vehicles()
        if self.vehicle in others:
            return None
        if self._session.info.routers_zid():
            there = f"; there is {', '.join(others)}: use --vehicle" if others else ""
            return (
                f"the router at {self.endpoint} does not reach vehicle {self.vehicle}: its link is cut, or no daemon "
                f"runs there (`systemctl status mkdaemon` on the aircraft){there}"
            )
        if others:
            return (
                f"no daemon for vehicle {self.vehicle} at {self.endpoint}; there is {', '.join(others)}: use --vehicle"
            )
        return f"no daemon at {self.endpoint}: start `mkdaemon run`, or use --connect"


def read_sample(sample: zenoh.Sample, suffix: str) -> Sample | None:
    """Read what arrived at a key; None for a deletion, which is no value.

    Args:
        sample: as it arrived.
        suffix: of its key, as the reader is to see it.
    """
    if sample.kind != zenoh.SampleKind.PUT:
        return None
    encoding = str(sample.encoding)
    return Sample(suffix, read_payload(encoding, sample.payload.to_bytes()), encoding)


def _raise_refusal(error: zenoh.ReplyError) -> None:
    """Raise what the daemon says in place of an answer; another peer's error, as Zenoh's own timeout, says nothing."""
    if "msgpack" in str(error.encoding):
        raise Answer.from_fields(read_payload(str(error.encoding), error.payload.to_bytes())).refusal
