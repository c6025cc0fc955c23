"""Which aircraft do we speak to: from what its boards answered to what may be sent to them.

Pure: `Evidence` gathers what was received, `decide` turns it into a `Dialect` by the tables of `generations`. What is
not known is not guessed: the dialect is read-only then, and says why.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from mkdaemon.errors import ProtocolError
from mkdaemon.protocol.evidence import ControlForm, Evidence
from mkdaemon.protocol.generations import (
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

_CONTROL: Final[dict[ControlLayout, type[WireMessage]]] = {
    "v1": ExternControlV1,
    "v2": ExternControlV2,
    "v3": ExternControlV3,
}
_FORMS: Final[dict[ControlLayout, ControlForm]] = {
    "v1": ControlForm.LONG,
    "v2": ControlForm.SHORT,
    "v3": ControlForm.SHORT,
}
_BY_FORM: Final[dict[ControlForm | None, ControlLayout]] = {ControlForm.LONG: "v1", ControlForm.SHORT: "v2"}


@dataclass(frozen=True, slots=True)
class Dialect:
    """Layouts in use with the aircraft on the line.

    Attributes:
        fc_release: release of the FlightCtrl; None while unknown.
        nc_release: release of the NaviCtrl; None where there is none or it is unknown.
        layouts: layout of each (board, command letter) that the frame itself does not tell.
        extern_control: class to fly with; None: do not.
        extern_control_layout: its layout.
        dead_man: how the FlightCtrl drops stick commands by itself.
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
    return _BY_FORM.get(evidence.control_form)


def _read_only_reason(
    evidence: Evidence, fc: FcGeneration | None, nc: NcGeneration | None, control: ControlLayout | None
) -> str | None:
    releases = evidence.releases
    if evidence.foreign is not None:
        return evidence.foreign.reason
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
    if evidence.control_form is not None and evidence.control_form is not _FORMS[control]:
        return (
            f"FlightCtrl {releases[Board.FC]} should hold external control {control}, "
            f"but what it reads back is of the {evidence.control_form.value} form"
        )
    return None


def _dead_man(fc: FcGeneration | None, control: ControlLayout | None) -> DeadMan:
    if fc is not None and fc.control is None and control == "v1":
        return DeadMan.POLLING_5S3
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
    if evidence.foreign is not None:
        return evidence.foreign.reason
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
