"""The bus of a replay: it keeps what is published, and brings what clients asked for in the recording."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from pydantic import BaseModel

from mkdaemon.bus.codec import decode_map, encode, encode_map, encoding_of
from mkdaemon.bus.commandserver import Handler
from mkdaemon.bus.gateway import Watcher
from mkdaemon.bus.intake import Prover, Taker
from mkdaemon.errors import CommandRejectedError
from mkdaemon.record.entry import STRANGER, Entry, Kind
from mkdaemon.telemetry.command import CommandResult
from mkdaemon.telemetry.refusals import Status
from mkdaemon.telemetry.signature import sign

LEASE: Final = "do/lease"
NOBODY: Final = b"\0" * 32
"""A signature that no secret gives."""


@dataclass(frozen=True, slots=True)
class Output:
    """Something that came out of the replay.

    Attributes:
        kind: a sample, or the reply to a query.
        suffix: key without `mk/<vehicle>/`.
        payload: msgpack.
        encoding: names its schema.
        at: when [s].
        exchange: of a reply, the number of its query; else 0.
    """

    kind: Kind
    suffix: str
    payload: bytes
    encoding: str
    at: float
    exchange: int = 0


class ReplayStation:
    """See `mkdaemon.daemon.wiring.Station`.

    The secret of a lease and the echo that comes before it are made anew in every run. So what a client sends of them
    is replaced by today's, where the recorded daemon found them right.

    Attributes:
        outputs: everything that came out, in order.
        open_endpoints: none; nobody can come in.
    """

    def __init__(self, replies: dict[int, Entry]) -> None:
        """Stand beside a loop that runs.

        Args:
            replies: of the recording, by the number of their exchange.
        """
        self.outputs: list[Output] = []
        self.open_endpoints: tuple[str, ...] = ()
        self._replies = replies
        self._loop = asyncio.get_running_loop()
        self._handlers: dict[str, Handler] = {}
        self._takers: dict[str, Taker] = {}
        self._watchers: list[Watcher] = []
        self._secrets: dict[int, str] = {}
        self._echoes: dict[str, str] = {}
        self._answering: set[asyncio.Task[None]] = set()

    # -- what the daemon uses -------------------------------------------------------------------------------------

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Keep a value."""
        encoding = encoding_of(schema or type(value))
        self.outputs.append(Output(Kind.SAMPLE, suffix, encode(value), encoding, self._loop.time()))

    def serve(self, root: str, handler: Handler) -> None:
        """Let a handler answer below a root."""
        self._handlers[root] = handler

    def receive(self, suffix: str, take: Taker, is_proven: Prover) -> None:
        """Hand setpoints of a key to `take`."""
        self._takers[suffix] = take

    def watch_clients(self, watcher: Watcher) -> None:
        """Tell a watcher of clients."""
        self._watchers.append(watcher)

    # -- what the recording brings --------------------------------------------------------------------------------

    def bring_setpoint(self, entry: Entry) -> None:
        """Bring a setpoint, signed with today's secret if its client held the lease."""
        take = self._takers.get(entry.suffix)
        if take is None:
            return
        take(entry.received, entry.payload, self._signature(entry))

    def bring_query(self, entry: Entry) -> None:
        """Ask what was asked."""
        root = entry.suffix.partition("/")[0]
        handler = self._handlers.get(root)
        if handler is None:
            return
        task = self._loop.create_task(self._ask(entry, handler), name=f"answer {entry.suffix}")
        self._answering.add(task)
        task.add_done_callback(self._answering.discard)

    def bring_client(self, name: str, is_here: bool) -> None:
        """Tell that a client came or went."""
        for watcher in self._watchers:
            watcher(name, is_here)

    async def close(self) -> None:
        """End what is still being worked on."""
        for task in self._answering:
            task.cancel()
        await asyncio.gather(*self._answering, return_exceptions=True)

    def _signature(self, entry: Entry) -> bytes:
        try:
            epoch = decode_map(entry.payload).get("epoch")
        except CommandRejectedError:
            epoch = None
        secret = self._secrets.get(epoch) if isinstance(epoch, int) else None
        return NOBODY if secret is None or entry.issuer == STRANGER else sign(secret, entry.suffix, entry.payload)

    async def _ask(self, entry: Entry, handler: Handler) -> None:
        began = self._loop.time()
        result = await handler(entry.suffix, self._payload(entry))
        result = result.model_copy(update={"duration": round(self._loop.time() - began, 6)})
        self._learn(entry, result)
        at = self._loop.time()
        reply = Output(Kind.REPLY, entry.suffix, encode(result), encoding_of(CommandResult), at, entry.exchange)
        self.outputs.append(reply)

    def _payload(self, entry: Entry) -> bytes:
        """What was asked, with today's secret and echo."""
        if entry.suffix != LEASE:
            return entry.payload
        return _changed(entry.payload, lambda fields: self._renewed(entry, fields))

    def _renewed(self, entry: Entry, fields: dict[str, Any]) -> dict[str, Any]:
        changes: dict[str, Any] = {}
        if fields.get("echo"):
            changes["echo"] = self._echoes.get(fields["echo"], fields["echo"])
        if fields.get("secret") and self._was_accepted(entry):
            changes["secret"] = self._secrets.get(fields.get("epoch", -1), "")
        return fields | changes

    def _was_accepted(self, entry: Entry) -> bool:
        reply = self._replies.get(entry.exchange)
        return reply is not None and decode_map(reply.payload).get("status") == Status.ACCEPTED.value

    def _learn(self, entry: Entry, result: CommandResult) -> None:
        """Keep today's secret of a lease, and which echo stands for the recorded one."""
        if entry.suffix != LEASE or not isinstance(result.reply, dict):
            return
        reply = result.reply
        if "secret" in reply:
            self._secrets[reply["epoch"]] = reply["secret"]
        recorded = self._replies.get(entry.exchange)
        answer = {} if recorded is None else decode_map(recorded.payload).get("reply")
        if "echo" in reply and isinstance(answer, dict) and "echo" in answer:
            self._echoes[answer["echo"]] = reply["echo"]


def _changed(payload: bytes, change: Callable[[dict[str, Any]], dict[str, Any]]) -> bytes:
    try:
        return encode_map(change(decode_map(payload)))
    except CommandRejectedError:
        return payload
