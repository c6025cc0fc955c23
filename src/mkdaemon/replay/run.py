"""Feeds today's flight core with recorded events, decodes the recorded bytes, and processes the images again.

Nothing runs here but pure code, entry by entry: the decoder, the translators, the flight core, vision. What stands
between them is the daemon's own `Deck`.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from pydantic import BaseModel

from mkdaemon.bus.codec import encode, encoding_of
from mkdaemon.clock import Clock
from mkdaemon.config.root import Config
from mkdaemon.control.actions import ReleaseAircraft, SendSticks
from mkdaemon.daemon.deck import Deck
from mkdaemon.link.session.traffic import Lost, Purpose, Received, Sent
from mkdaemon.protocol.boards import Board, Direction
from mkdaemon.protocol.decoder import MessageDecoder, Unknown
from mkdaemon.protocol.framing import Dropped, DropReason, Frame, FrameDecoder
from mkdaemon.record.entry import Entry, EntryKind, Notice
from mkdaemon.record.events import CORE, TICK, pack_event, unpack_event
from mkdaemon.replay.compare import ReplayOutput
from mkdaemon.replay.recorded import Recorded, fields_of, part_of
from mkdaemon.replay.sight import has_every_image, look_again

_BOARDS: Final = {board.word: board for board in Board}
_OUTPUT: Final = "control/output"
_REFUSED: Final = f"{CORE}FrameNotSent"
_PREFLIGHT: Final = "control/preflight"


@dataclass(frozen=True)
class Replayed:
    """What came out.

    Attributes:
        outputs: everything published, and what the flight core answered, in order.
        has_eyes: whether recorded images were looked at.
    """

    outputs: Sequence[ReplayOutput]
    has_eyes: bool


def replay(recorded: Recorded, cfg: Config) -> Replayed:
    """Run the recording through today's code.

    Args:
        recorded: what went in.
        cfg: the configuration to fly with.

    Raises:
        ConfigError: the configuration cannot work here: a camera file is not there, for example.
        MkError: a recorded value is not of the form it has today.
    """
    return _Replay(recorded, cfg).run()


def _layouts_of(fields: dict[str, Any]) -> dict[tuple[Board, str], str]:
    """The layouts that a notice names."""
    return {(_BOARDS[board], letter): layout for board, letter, layout in fields["layouts"]}


class _Outputs:
    """The bus of a replay: it keeps what is published."""

    def __init__(self) -> None:
        self.kept: list[ReplayOutput] = []
        self.at = 0.0

    def publish(self, suffix: str, value: BaseModel, *, schema: type[BaseModel] | None = None) -> None:
        """Keep a value."""
        encoding = encoding_of(schema or type(value))
        self.kept.append(ReplayOutput(EntryKind.SAMPLE, suffix, encode(value), encoding, self.at))


class _Replay:
    """One run."""

    def __init__(self, recorded: Recorded, cfg: Config) -> None:
        self._recorded, self._cfg = recorded, cfg
        self._offsets = recorded.wall_offsets()
        self._bus = _Outputs()
        self._bus.at = recorded.start
        self._clock = Clock(monotonic=lambda: self._bus.at, wall=self._wall, synchronised=lambda: None)
        self._deck = Deck(cfg.control, self._bus, self._clock, first_epoch=recorded.first_epoch())
        self._bytes = FrameDecoder()
        self._messages = MessageDecoder()

    def run(self) -> Replayed:
        """Bring every entry, then look at the images."""
        entries = self._recorded.entries
        for place, entry in enumerate(entries):
            self._bus.at = entry.received
            self._bring(entry, place)
        has_eyes = has_every_image(self._recorded, self._cfg)
        if has_eyes:
            for at, suffix, value in look_again(self._recorded, self._cfg, self._clock):
                self._bus.at = at
                self._bus.publish(suffix, value)
        return Replayed(self._bus.kept, has_eyes)

    def _wall(self) -> float:
        """Unix time [s], as the recorded daemon knew it."""
        place = bisect_right(self._offsets, self._bus.at, key=lambda pair: pair[0])
        known = self._offsets[max(place - 1, 0)][1] if self._offsets else self._recorded.session.base.offset_ns / 1e9
        return self._bus.at + known

    def _bring(self, entry: Entry, place: int) -> None:
        """Let something happen again."""
        match entry.kind:
            case EntryKind.EVENT if entry.suffix == TICK:
                self._tick(entry, place)
            case EntryKind.EVENT:
                self._feed(entry)
            case EntryKind.PORT_OPENED:
                self._bytes = FrameDecoder()
            case EntryKind.PORT_READ:
                self._take(self._bytes.feed(entry.payload), entry.received)
            case EntryKind.PORT_LOST:
                self._take(self._bytes.flush(), entry.received)
            case EntryKind.PORT_WRITTEN:
                self._deck.sink.sent(self._sent(entry))
            case EntryKind.NOTICE if Notice.of(entry) is Notice.LAYOUTS:
                self._messages = MessageDecoder(part_of(entry, _layouts_of))
            case EntryKind.SAMPLE if entry.suffix == "raw/tx" and fields_of(entry).get("dropped"):
                at, reason, raw = part_of(
                    entry,
                    lambda one: (float(one["stamp"]["monotonic"]), DropReason(one["dropped"]), bytes(one["raw"])),
                )
                self._deck.sink.dropped(Lost(at, Direction.TO_BOARD, reason, raw))
            case EntryKind.SAMPLE if entry.suffix == _PREFLIGHT:
                self._deck.publish_preflight(part_of(entry, lambda fields: float(fields["stamp"]["monotonic"])))
            case _:
                pass

    # -- the line -------------------------------------------------------------------------------------------------

    def _take(self, items: Sequence[Frame | Dropped], at: float) -> None:
        for item in items:
            if isinstance(item, Frame):
                self._deck.sink.received(Received(at, item, self._messages.decode(item)))
            else:
                self._deck.sink.dropped(Lost(at, Direction.FROM_BOARD, item.reason, item.raw))

    def _sent(self, entry: Entry) -> Sent:
        """What was written, as it was known to who wrote it."""
        frames = [item for item in FrameDecoder().feed(entry.payload) if isinstance(item, Frame)]
        message = self._messages.decode(frames[0]) if frames else None
        known = None if isinstance(message, Unknown) else message
        return Sent(entry.received, entry.payload, known, part_of(entry, lambda _: Purpose[entry.issuer.upper()]))

    # -- the flight core ------------------------------------------------------------------------------------------

    def _feed(self, entry: Entry) -> None:
        """Tell the core of an event; what it answers is an output."""
        event = unpack_event(entry.suffix, entry.payload)
        reply = self._deck.core.feed(event, entry.received)
        payload = pack_event(event, reply)
        self._bus.kept.append(ReplayOutput(EntryKind.EVENT, entry.suffix, payload, entry.encoding, entry.received))

    def _tick(self, entry: Entry, place: int) -> None:
        """Let the core decide, and publish what it wants."""
        now = entry.received
        for action in self._deck.core.tick(now, slept=part_of(entry, lambda fields: float(fields.get("slept", 0.0)))):
            match action:
                case SendSticks():
                    number = self._number(place)
                    if number is not None:
                        self._deck.publish_output(action, number, now)
                case ReleaseAircraft():
                    pass  # the line did it then; `Released` comes
                case _:
                    self._deck.publish(action, now)

    def _number(self, place: int) -> int | None:
        """The number that the line gave a stick frame after this entry; None where it refused the frame."""
        entries = self._recorded.entries
        for later in range(place + 1, len(entries)):
            entry = entries[later]
            if entry.kind is EntryKind.EVENT and entry.suffix == TICK:
                break
            if entry.suffix == _REFUSED:
                return None
            if entry.suffix == _OUTPUT:
                return part_of(entry, lambda fields: int(fields["frame"]))
        return 0
