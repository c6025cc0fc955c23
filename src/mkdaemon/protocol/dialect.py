"""Which aircraft do we speak to: from what its boards answered to what may be sent to them.

Pure: `Evidence` gathers what was received, `decide` turns it into a `Dialect` by the tables of `generations`. What is
not known is not guessed: the dialect is read-only then, and says why.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final

from mkdaemon.errors import ProtocolError
from mkdaemon.protocol.decoder import Unknown
from mkdaemon.protocol.generations import (
    PROTOCOL_MAJORS,
    ControlLayout,
    DeadMan,
    FcGeneration,
    NcGeneration,
    Release,
    fc_generation,
    nc_generation,
)
from mkdaemon.protocol.messages import ExternControlV1, ExternControlV2, ExternControlV3
from mkdaemon.protocol.wire import MESSAGES, Board, Direction, WireMessage

__all__ = ["DeadMan", "Dialect", "Evidence", "Release", "decide"]

OSD_SETS: Final = frozenset(range(10, 17))
"""Numbers of the data sets a NaviCtrl streams when asked with a byte budget."""
OSD_VERSIONS: Final = frozenset({3, 4, 5}) | OSD_SETS
"""First bytes of NaviData that are documented."""

EVIDENCE_LETTERS: Final = frozenset(cls.spec.id for cls in MESSAGES.values() if cls.spec.tells_firmware)
"""Letters of the answers that tell something about the firmware, whatever their form."""

_CONTROL: Final[dict[ControlLayout, type[WireMessage]]] = {
    "v1": ExternControlV1,
    "v2": ExternControlV2,
    "v3": ExternControlV3,
}
_CONTROL_LENGTHS: Final[dict[ControlLayout, str]] = {"v1": "long", "v2": "short", "v3": "short"}


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the boards have shown of themselves so far.

    Attributes:
        releases: release each board named in its version reply.
        hardware: FlightCtrl board revision times ten, where it named one.
        label_checksum: checksum of the FlightCtrl's debug labels, where it named one.
        settings_revision: first byte of the parameter set it sent.
        receiver: layout of its receiver channels.
        control_length: `short` (v2, v3) or `long` (v1), from external control read back.
        osd_versions: versions and data sets of the NaviData received.
        foreign: why a board's firmware is not MikroKopter's; empty where it is.
    """

    releases: Mapping[Board, Release] = field(default_factory=lambda: MappingProxyType({}))
    hardware: int | None = None
    label_checksum: int | None = None
    settings_revision: int | None = None
    receiver: str | None = None
    control_length: str | None = None
    osd_versions: frozenset[int] = frozenset()
    foreign: str = ""

    def with_message(self, board: Board, message: WireMessage | Unknown) -> Evidence:
        """Return the evidence after one more message from a board; most messages change nothing.

        Never pass the answer to a `VersionRequestWhich`: it names another board's release under the FlightCtrl's
        address.
        """
        if isinstance(message, Unknown):
            return self._with_unknown(board, message)
        key, layout = message.spec.key, message.spec.layout
        if key == "version":
            return self._with_version(board, message)
        if key == "settings":
            return replace(self, settings_revision=message.parameters[0])  # type: ignore[attr-defined]
        if key == "receiver":
            return replace(self, receiver=layout)
        if key == "control_state":
            return replace(self, control_length="long" if layout == "v1" else "short")
        if message.spec.id == "O":
            number = message.version if key == "osd" else message.index  # type: ignore[attr-defined]
            return replace(self, osd_versions=self.osd_versions | {number})
        return self

    def _with_unknown(self, board: Board, message: Unknown) -> Evidence:
        if message.id == "O" and message.payload:
            return replace(self, osd_versions=self.osd_versions | {message.payload[0]})
        if message.id != "V":
            return self
        if not message.payload:
            reason = f"{board.word} answers the version request with an empty frame, as the ctraabe firmware does"
        else:
            reason = f"{board.word} answers the version request with {len(message.payload)} bytes, not 12"
        return replace(self, foreign=reason)

    def _with_version(self, board: Board, message: WireMessage) -> Evidence:
        facts = message.model_dump()
        if facts["protocol_major"] not in PROTOCOL_MAJORS:
            reason = (
                f"{board.word} speaks serial protocol {facts['protocol_major']}, MikroKopter firmware "
                f"{PROTOCOL_MAJORS[0]} to {PROTOCOL_MAJORS[-1]}: not MikroKopter firmware, or newer than this program"
            )
            return replace(self, foreign=reason)
        release = Release(facts["major"], facts["minor"], facts["patch"])
        known = self
        if self.releases.get(board, release) != release:
            # Another release at the same address is another aircraft, or a board that was flashed: start over.
            known = Evidence()
        if known.foreign.startswith(f"{board.word} "):
            known = replace(known, foreign="")
        known = replace(known, releases=MappingProxyType({**known.releases, board: release}))
        if board is Board.FC:
            known = replace(known, hardware=facts.get("hardware"), label_checksum=facts.get("label_checksum"))
        return known


@dataclass(frozen=True, slots=True)
class Dialect:
    """How to speak to the aircraft on the line.

    Attributes:
        fc_release: release of the FlightCtrl; None while unknown.
        nc_release: release of the NaviCtrl; None where there is none or it is unknown.
        layouts: layout of each (board, command letter) that the frame itself does not tell.
        extern_control: class to fly with; None: do not.
        extern_control_layout: its layout.
        dead_man: how the FlightCtrl lets go by itself.
        stick_filter: external control passes the receiver's stick filter.
        read_only_reason: why nothing that acts may be sent; None where it may.
        unsupported: reason by (board, message key) for requests this firmware does not know.
        via_navictrl: a NaviCtrl answers: the FlightCtrl sits behind it.
        confirms_control: external control is confirmed, by a FlightCtrl on the line or a NaviCtrl that takes it.
        settings_revision: revision of the parameter sets; None while unknown.
        settings_read_only_reason: why parameter sets must not be written; None where they may.
        has_osd_sets: the NaviCtrl streams the data sets 10..16.
        resets_in_flight: a reset is obeyed with motors running.
        label_checksum: checksum of the FlightCtrl's debug labels, where it named one.
    """

    fc_release: Release | None = None
    nc_release: Release | None = None
    layouts: Mapping[tuple[Board, str], str] = field(default_factory=lambda: MappingProxyType({}))
    extern_control: type[WireMessage] | None = None
    extern_control_layout: ControlLayout | None = None
    dead_man: DeadMan = DeadMan.UNKNOWN
    stick_filter: bool = False
    read_only_reason: str | None = "no board has named its release yet"
    unsupported: Mapping[tuple[Board, str], str] = field(default_factory=lambda: MappingProxyType({}))
    via_navictrl: bool = False
    confirms_control: bool = False
    settings_revision: int | None = None
    settings_read_only_reason: str | None = "no parameter set has been read yet"
    has_osd_sets: bool = False
    resets_in_flight: bool = True
    label_checksum: int | None = None

    def message(self, board: Board, name: str) -> type[WireMessage]:
        """Return the class of a message in the layout this board speaks.

        Raises:
            ProtocolError: the board has no such message.
        """
        found = [cls for (owner, _, _), cls in MESSAGES.items() if owner == board and cls.spec.name == name]
        if not found:
            msg = f"{board.word} has no message {name!r}"
            raise ProtocolError(msg)
        wanted = self.layouts.get((board, found[0].spec.id))
        return next((cls for cls in found if cls.spec.layout == wanted), found[0])


def decide(evidence: Evidence) -> Dialect:
    """Return the dialect the evidence proves; read-only with a reason where it does not prove enough."""
    fc_release, nc_release = evidence.releases.get(Board.FC), evidence.releases.get(Board.NC)
    fc = fc_generation(fc_release) if fc_release else None
    nc = nc_generation(nc_release) if nc_release else None
    control = _control_layout(evidence, fc)
    reason = _read_only_reason(evidence, fc, nc, control)
    if reason is not None:
        control = None
    return Dialect(
        fc_release=fc_release,
        nc_release=nc_release,
        layouts=MappingProxyType(_layouts(fc, nc, control)),
        extern_control=_CONTROL[control] if control else None,
        extern_control_layout=control,
        dead_man=_dead_man(fc, control),
        stick_filter=fc is not None and fc.stick_filter and control != "v1",
        read_only_reason=reason,
        unsupported=MappingProxyType(_unsupported(evidence)),
        via_navictrl=nc_release is not None,
        confirms_control=control is not None and (nc.takes_control if nc is not None else nc_release is None),
        settings_revision=evidence.settings_revision,
        settings_read_only_reason=_settings_reason(evidence, fc),
        has_osd_sets=(nc is not None and nc.has_sets) or not evidence.osd_versions.isdisjoint(OSD_SETS),
        resets_in_flight=fc is None or fc.resets_in_flight,
        label_checksum=evidence.label_checksum,
    )


def _control_layout(evidence: Evidence, fc: FcGeneration | None) -> ControlLayout | None:
    """The layout of the release; where it is not verified (2.09), the length of what the board reads back."""
    if fc is None or fc.control is not None:
        return fc.control if fc else None
    return {"long": "v1", "short": "v2"}.get(evidence.control_length or "")  # type: ignore[return-value]


def _read_only_reason(
    evidence: Evidence, fc: FcGeneration | None, nc: NcGeneration | None, control: ControlLayout | None
) -> str | None:
    releases = evidence.releases
    if evidence.foreign:
        return evidence.foreign
    if not releases:
        return "no board has named its release yet"
    if Board.NC in releases and nc is None:
        return f"NaviCtrl {releases[Board.NC]} is in no table"
    if Board.FC not in releases:
        return "the FlightCtrl has not named its release: which external control it reads is not known"
    if fc is None:
        return f"FlightCtrl {releases[Board.FC]} is in no table"
    if control is None:
        return f"FlightCtrl {releases[Board.FC]} may read either external control: read it back (g) to know"
    if evidence.control_length not in {None, _CONTROL_LENGTHS[control]}:
        return (
            f"FlightCtrl {releases[Board.FC]} should hold external control {control}, "
            f"but what it reads back is of the {evidence.control_length} form"
        )
    return None


def _dead_man(fc: FcGeneration | None, control: ControlLayout | None) -> DeadMan:
    if fc is not None and fc.control is None and control == "v1":
        return DeadMan.POLLING_5S1
    return fc.dead_man if fc else DeadMan.UNKNOWN


def _layouts(
    fc: FcGeneration | None, nc: NcGeneration | None, control: ControlLayout | None
) -> dict[tuple[Board, str], str]:
    layouts: dict[tuple[Board, str], str] = {}
    if fc is not None:
        layouts[Board.FC, "C"] = fc.attitude
    if control is not None:
        layouts[Board.FC, "b"] = layouts[Board.FC, "G"] = control
    if nc is not None:
        layouts[Board.NC, "C"] = nc.attitude
        layouts[Board.NC, "s"] = layouts[Board.NC, "w"] = layouts[Board.NC, "X"] = nc.point
    return layouts


def _settings_reason(evidence: Evidence, fc: FcGeneration | None) -> str | None:
    revision, release = evidence.settings_revision, evidence.releases.get(Board.FC)
    if revision is None:
        return "no parameter set has been read yet (`settings_request` with index 255 reads the active one)"
    if release is None or fc is None:
        return "the FlightCtrl's release is not known"
    if evidence.foreign:
        return evidence.foreign
    if revision not in fc.revisions:
        known = ", ".join(str(number) for number in sorted(fc.revisions))
        return f"parameter revision {revision} does not belong to FlightCtrl {release} ({known})"
    return None


def _unsupported(evidence: Evidence) -> dict[tuple[Board, str], str]:
    """Requests a board's release does not know; a message counts as known when one of its layouts is."""
    missing: dict[tuple[Board, str], str] = {}
    known: set[tuple[Board, str]] = set()
    for (board, _, _), cls in MESSAGES.items():
        spec, release = cls.spec, evidence.releases.get(board)
        if spec.direction is not Direction.TO_BOARD or release is None:
            continue
        place = (board, spec.key)
        if spec.is_fork:
            missing[place] = "only a public fork of the firmware knows it"
        elif release[:2] < (since := spec.since.get(board, (0, 0))):
            missing[place] = f"needs {since[0]}.{since[1]:02d}, the board has {release}"
        else:
            known.add(place)
    unsupported = {place: reason for place, reason in missing.items() if place not in known}
    for version in sorted(evidence.osd_versions - OSD_VERSIONS):
        unsupported[Board.NC, "osd_request"] = f"NaviData version {version} is not documented"
    return unsupported
