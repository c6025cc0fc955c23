"""Evidence about the boards, gathered message by message. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import Final, NamedTuple

from mkdaemon.protocol.boards import Board
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.generations import PROTOCOL_MAJORS, Release
from mkdaemon.protocol.messages import (
    ControlStateV1,
    ControlStateV2,
    ControlStateV3,
    OsdData4,
    OsdData5,
    OsdSet,
    Receiver071,
    Receiver077,
    Receiver200,
    Settings,
    VersionReply,
    VersionRequest,
)
from mkdaemon.protocol.wire import MESSAGES, WireMessage

EVIDENCE_LETTERS: Final = frozenset(cls.spec.id for cls in MESSAGES.values() if cls.spec.tells_firmware)
"""Letters of the answers that tell something about the firmware, whatever their form."""


class ControlForm(Enum):
    """Length of the external control that a FlightCtrl holds."""

    LONG = "long"
    """Layout v1."""
    SHORT = "short"
    """Layouts v2 and v3."""


class Foreign(NamedTuple):
    """A board with firmware that is not MikroKopter's, or not known.

    Attributes:
        board: who.
        reason: one sentence.
    """

    board: Board
    reason: str


@dataclass(frozen=True, slots=True)
class Evidence:
    """Evidence about the boards.

    Attributes:
        releases: release each board named in its version reply.
        hardware: FlightCtrl board revision times ten, where it named one.
        label_checksum: checksum of the FlightCtrl's debug labels, where it named one.
        settings_revision: first byte of the parameter set it sent.
        receiver: layout of its receiver channels.
        control_form: form of the external control it read back.
        osd_versions: versions and data sets of the NaviData received.
        foreign: a board whose firmware is not MikroKopter's; None where there is none.
    """

    releases: Mapping[Board, Release] = field(default_factory=lambda: MappingProxyType({}))
    hardware: int | None = None
    label_checksum: int | None = None
    settings_revision: int | None = None
    receiver: str | None = None
    control_form: ControlForm | None = None
    osd_versions: frozenset[int] = frozenset()
    foreign: Foreign | None = None

    def with_message(self, board: Board, message: WireMessage | Unknown) -> Evidence:
        """Return the evidence after one more message from a board; most messages change nothing.

        Never pass the answer to a `VersionRequestWhich`: it names another board's release under the FlightCtrl's
        address.
        """
        if isinstance(message, Unknown):
            return self._with_unknown(board, message)
        match message:
            case VersionReply():
                return self._with_version(board, message)
            case Settings():
                return replace(self, settings_revision=message.parameters[0])
            case Receiver071() | Receiver077() | Receiver200():
                return replace(self, receiver=message.spec.layout)
            case ControlStateV1():
                return replace(self, control_form=ControlForm.LONG)
            case ControlStateV2() | ControlStateV3():
                return replace(self, control_form=ControlForm.SHORT)
            case OsdData4() | OsdData5():
                return replace(self, osd_versions=self.osd_versions | {message.version})
            case OsdSet():
                return replace(self, osd_versions=self.osd_versions | {message.index})
            case _:
                return self

    def with_flightctrl_of(self, known: Evidence) -> Evidence:
        """Return the evidence with what a FlightCtrl showed of itself before; `known` must name its release."""
        return replace(
            self,
            releases=MappingProxyType({**self.releases, Board.FC: known.releases[Board.FC]}),
            hardware=known.hardware,
            label_checksum=known.label_checksum,
            settings_revision=known.settings_revision,
            control_form=known.control_form,
        )

    def without_flightctrl(self) -> Evidence:
        """Return the evidence without anything a FlightCtrl showed of itself."""
        others = dict(self.releases)
        others.pop(Board.FC, None)
        return Evidence(releases=MappingProxyType(others), osd_versions=self.osd_versions, foreign=self.foreign)

    def _with_unknown(self, board: Board, message: Unknown) -> Evidence:
        if message.id == OsdData5.spec.id and message.payload:
            return replace(self, osd_versions=self.osd_versions | {message.payload[0]})
        if message.id != VersionRequest.spec.reply:
            return self
        if not message.payload:
            reason = f"{board.word} answers the version request with an empty frame, as the ctraabe firmware does"
        else:
            reason = f"{board.word} answers the version request with {len(message.payload)} bytes, not 12"
        return replace(self, foreign=Foreign(board, reason))

    def _with_version(self, board: Board, message: WireMessage) -> Evidence:
        facts = message.model_dump()
        if facts["protocol_major"] not in PROTOCOL_MAJORS:
            reason = (
                f"{board.word} speaks serial protocol {facts['protocol_major']}, MikroKopter firmware "
                f"{PROTOCOL_MAJORS[0]} to {PROTOCOL_MAJORS[-1]}: not MikroKopter firmware, or newer than this program"
            )
            return replace(self, foreign=Foreign(board, reason))
        release = Release(facts["major"], facts["minor"], facts["patch"])
        known = self
        if self.releases.get(board, release) != release:
            # Another release at the same address is another aircraft, or a board that was flashed: start over.
            known = Evidence()
        if known.foreign is not None and known.foreign.board is board:
            known = replace(known, foreign=None)
        known = replace(known, releases=MappingProxyType({**known.releases, board: release}))
        if board is Board.FC:
            known = replace(known, hardware=facts.get("hardware"), label_checksum=facts.get("label_checksum"))
        return known
