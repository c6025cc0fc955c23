"""A Zenoh client of the daemon: everything `mkctl` does goes through here.

Nothing is imported from the daemon: any program on any machine can do the same with zenoh and msgpack alone.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple, Self

import msgpack
import zenoh
from cyclopts import Parameter

from mkdaemon.bus.codec import encode_map
from mkdaemon.bus.keys import ROOT, key, suffix_of
from mkdaemon.bus.session import close_session, open_session, session_config
from mkdaemon.config.vehicle import NAME_PATTERN
from mkdaemon.errors import CommandRejectedError, ConfigError, MkError

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
BACKLOG: Final = 4096
"""Samples a watcher may lag behind before the oldest are dropped."""
PATIENCE: Final = 15.0
"""Longest wait for the answer to a command [s]; board requests with retries take up to 8 s."""


@Parameter(name="*")
@dataclass(frozen=True, slots=True)
class Connection:
    """Which vehicle, and where its daemon is."""

    vehicle: Annotated[str, Parameter(env_var="MK_VEHICLE")] = "mk1"
    """Name of the vehicle."""
    connect: Annotated[str, Parameter(env_var="MK_CONNECT")] = DEFAULT_ENDPOINT
    """Zenoh endpoint of the daemon or of a router."""
    zenoh_file: Annotated[Path | None, Parameter(env_var="MK_ZENOH_FILE")] = None
    """Zenoh configuration of this client, for TLS: configs/zenoh/."""
    json: Annotated[bool, Parameter(negative=())] = False
    """Print JSON, one object a line, in place of text."""


HERE: Final = Connection()
"""The default of every command's `connection`: this machine, or what the environment says."""


class Sample(NamedTuple):
    """A value from the bus.

    Attributes:
        suffix: key without `mk/<vehicle>/`.
        fields: the map; a schema is parsed JSON.
        encoding: as published, for example `application/msgpack;mk.Attitude.v1`.
    """

    suffix: str
    fields: dict[str, Any]
    encoding: str


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a command.

    Attributes:
        status: accepted, denied, busy, unsupported, timeout, not_observable.
        reply: what the board or the daemon answered; empty where nothing.
        token: stable word of a refusal.
        reason: why it was refused.
        fix: what to do about it.
        duration: time the daemon took [s].
        reply_type: schema of the reply, for example `VersionFc210.v1`; names the layout the board spoke.
    """

    status: str
    reply: dict[str, Any]
    token: str | None = None
    reason: str | None = None
    fix: str | None = None
    duration: float | None = None
    reply_type: str | None = None

    @property
    def is_accepted(self) -> bool:
        """Whether it was done, or sent where success cannot be seen."""
        return self.status in {"accepted", "not_observable"}

    def require(self) -> dict[str, Any]:
        """Return the reply.

        Raises:
            CommandRejectedError: the command was refused; says token, reason and fix.
        """
        if not self.is_accepted:
            raise CommandRejectedError(self.token or self.status, self.reason or "no reason given.", self.fix or "")
        return self.reply


class Client:
    """An open session with one vehicle's daemon."""

    def __init__(self, session: zenoh.Session, vehicle: str, endpoint: str) -> None:
        self.vehicle = vehicle
        self._session = session
        self._endpoint = endpoint
        self._loop = asyncio.get_running_loop()

    @classmethod
    @asynccontextmanager
    async def open(cls, connection: Connection) -> AsyncIterator[Self]:
        """Connect, and close on leaving.

        Raises:
            MkError: nobody listens at the endpoint.
            ConfigError: the endpoint or the vehicle's name cannot be understood.
        """
        if re.fullmatch(NAME_PATTERN, connection.vehicle) is None:
            msg = f"--vehicle {connection.vehicle!r}: a name has lower-case letters, digits, - and _"
            raise ConfigError(msg)
        session = await open_session(
            session_config("client", connect=[connection.connect], zenoh_file=connection.zenoh_file)
        )
        try:
            yield cls(session, connection.vehicle, connection.connect)
        finally:
            await close_session(session)

    async def get(self, pattern: str, *, patience: float = 3.0) -> dict[str, Sample]:
        """Ask for the last values of all keys that match; each has its `age` [s] among its fields.

        Args:
            pattern: key without `mk/<vehicle>/`; may hold `*` and `**`.
            patience: longest wait [s].

        Raises:
            MkError: the pattern is no key expression.
        """
        replies = await self._query(pattern, b"", patience)
        return {sample.suffix: sample for sample in replies}

    async def command(
        self, target: str, name: str, fields: Mapping[str, Any] | None = None, *, patience: float = PATIENCE
    ) -> Answer:
        """Ask a board, or the daemon, to do something.

        Args:
            target: `fc`, `nc`, `mag`, ... for a MikroKopter request, `do` for a verb of the daemon, `sim` for one of
                the simulator.
            name: key of the request, for example `version_request`, or the verb.
            fields: of the request; dangerous ones want `confirm = True`.
            patience: longest wait for the answer [s].

        Raises:
            MkError: no daemon speaks for this vehicle at the endpoint, or more than one does.
        """
        suffix = f"{target}/{name}" if target in {"do", "sim"} else f"cmd/{target}/{name}"
        replies = await self._query(suffix, encode_map(dict(fields or {})), patience)
        if not replies:
            raise MkError(
                await self.absence() or f"the daemon gives no answer to {suffix}: is it older than this mkctl?"
            )
        if len(replies) > 1:
            msg = (
                f"{len(replies)} daemons of the name {self.vehicle} answered, and all have obeyed: "
                "give each aircraft a vehicle.name of its own"
            )
            raise MkError(msg)
        result = replies[0].fields
        return Answer(
            status=result.get("status", "denied"),
            reply=result.get("reply") or {},
            token=result.get("token"),
            reason=result.get("reason"),
            fix=result.get("fix"),
            duration=result.get("duration"),
            reply_type=result.get("reply_type"),
        )

    @asynccontextmanager
    async def watch(self, *patterns: str) -> AsyncIterator[AsyncIterator[Sample]]:
        """Subscribe for as long as the context lives; iterate over what comes.

        The oldest samples are dropped when the reader is `BACKLOG` behind.

        Raises:
            MkError: a pattern is no key expression.
        """
        queue: asyncio.Queue[zenoh.Sample] = asyncio.Queue(BACKLOG)
        loop = self._loop

        def put(sample: zenoh.Sample) -> None:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(sample)

        def on_sample(sample: zenoh.Sample) -> None:
            with suppress(RuntimeError):  # the loop may be closing
                loop.call_soon_threadsafe(put, sample)

        handler = zenoh.handlers.Callback(on_sample, indirect=False)
        subscribers = [self._session.declare_subscriber(self._expression(pattern), handler) for pattern in patterns]

        async def samples() -> AsyncIterator[Sample]:
            while True:
                yield self._sample(await queue.get())

        try:
            yield samples()
        finally:
            for subscriber in subscribers:
                subscriber.undeclare()  # type: ignore[no-untyped-call]

    @asynccontextmanager
    async def token(self, name: str) -> AsyncIterator[None]:
        """Show the liveliness token `client/<name>` for as long as the context lives; its end ends a lease."""
        with self._session.liveliness().declare_token(self._key(f"client/{name}")):
            yield

    def stream(self, suffix: str) -> zenoh.Publisher:
        """Make a publisher for setpoints: newest wins, so what cannot be sent at once is dropped."""
        return self._session.declare_publisher(
            self._key(suffix),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )

    async def vehicles(self) -> list[str]:
        """Names of all vehicles whose daemon is alive."""
        replies = await asyncio.to_thread(lambda: list(self._session.liveliness().get(f"{ROOT}/*/alive", timeout=1)))
        return sorted(str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok is not None)

    def _key(self, suffix: str) -> str:
        return key(self.vehicle, suffix)

    def _expression(self, pattern: str) -> zenoh.KeyExpr:
        """A pattern as a user writes it; whole keys, copied from somewhere, are understood too.

        Raises:
            MkError: it is no key expression.
        """
        suffix = pattern.removeprefix(self._key(""))
        try:
            return zenoh.KeyExpr(self._key(suffix))
        except zenoh.ZError as error:
            why = str(error).partition(" at /")[0].rpartition("`: ")[2]
            msg = f"{pattern!r} is no key: {why}"
            raise MkError(msg) from error

    async def _query(self, suffix: str, payload: bytes, patience: float) -> list[Sample]:
        done: asyncio.Future[None] = self._loop.create_future()
        replies: list[zenoh.Sample] = []
        loop = self._loop

        def finish() -> None:
            if not done.done():
                done.set_result(None)

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                replies.append(reply.ok)

        def on_end() -> None:
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(finish)

        handler = zenoh.handlers.Callback(on_reply, on_end, indirect=False)
        # Every answer, also a second one of the same key: a router would keep only one of two daemons' answers.
        self._session.get(
            self._expression(suffix),
            handler,
            payload=payload or None,
            timeout=patience,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        await done
        return [self._sample(reply) for reply in replies]

    def _sample(self, sample: zenoh.Sample) -> Sample:
        encoding, raw = str(sample.encoding), sample.payload.to_bytes()
        return Sample(suffix_of(self.vehicle, str(sample.key_expr)), _read(encoding, raw), encoding)

    async def absence(self) -> str | None:
        """Say that there is no daemon for this vehicle, and what there is; None while there is one."""
        others = await self.vehicles()
        if self.vehicle in others:
            return None
        if others:
            return (
                f"no daemon for vehicle {self.vehicle} at {self._endpoint}; there is {', '.join(others)}: use --vehicle"
            )
        return f"no daemon at {self._endpoint}: start `mkdaemon run`, or use --connect"


def _read(encoding: str, raw: bytes) -> dict[str, Any]:
    if "msgpack" in encoding:
        value = msgpack.unpackb(raw)
    elif "json" in encoding:
        value = json.loads(raw)
    else:
        value = {"raw": raw}
    return value if isinstance(value, dict) else {"value": value}
