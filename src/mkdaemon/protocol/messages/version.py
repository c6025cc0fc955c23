"""Version exchange: identifies the board on the line and its dialect.

All layouts are ten bytes; the release in the first two tells them apart, so a version reply needs no dialect.
Source: docs/protocol.md, "VersionInfo"; vectors "version ...".
"""

from __future__ import annotations

from typing import Annotated

from mkdaemon.protocol.fields import U8
from mkdaemon.protocol.flags import FlightFault0, FlightFault1, NaviFault0, VersionFlags
from mkdaemon.protocol.generations import Release
from mkdaemon.protocol.sources import Source
from mkdaemon.protocol.spec import Policy
from mkdaemon.protocol.wire import Board, WireMessage, answer, request

_BOARDS = (Board.FC, Board.NC, Board.MAG)


@request(
    _BOARDS,
    "v",
    reply="V",
    firmware="all",
    source=(Source.FC_RECEIVE, Source.NC_RECEIVE),
    policy={Board.FC: Policy(0.15, 4), Board.NC: Policy(0.3, 5)},
    any_address=True,
)
class VersionRequest(WireMessage):
    """Ask a board for its firmware release."""


@request(
    Board.FC,
    "v",
    name="VersionRequest",
    layout="which",
    reply="V",
    firmware="FC 2.x on ATmega1284",
    source=Source.FC_RECEIVE,
    policy=Policy(0.15, 4),
)
class VersionRequestWhich(WireMessage):
    """Ask a FlightCtrl for its own release or for that of the NaviCtrl behind it."""

    which: Annotated[int, U8(mk="Which")] = 2
    """2: the NaviCtrl's release, as the FlightCtrl learnt it over SPI; anything else: its own."""


def _release(payload: bytes) -> tuple[int, int]:
    return payload[0], payload[1]


def _is_fc210(payload: bytes) -> bool:
    return _release(payload) >= (2, 9)


def _is_fc200(payload: bytes) -> bool:
    return (0, 91) <= _release(payload) < (2, 9)


def _is_navi_200(payload: bytes) -> bool:
    return payload[0] >= 2


def _is_classic(payload: bytes) -> bool:
    return payload[0] < 2


class VersionReply(WireMessage):
    """Common head of every version reply."""

    major: Annotated[int, U8(mk="SWMajor")]
    minor: Annotated[int, U8(mk="SWMinor")]
    protocol_major: Annotated[int, U8(mk="ProtoMajor")]
    """Serial protocol generation: 7..11; anything else is not MikroKopter firmware."""

    @property
    def release(self) -> str:
        """The release as MikroKopter writes it, for example `2.12a`."""
        patch: int = self.patch  # type: ignore[attr-defined]  # each layout has it at another place
        return str(Release(self.major, self.minor, patch))


class _Labelled(VersionReply):
    label_checksum: Annotated[int, U8(mk="LabelTextCRC")]
    """8-bit sum of all 512 label characters; labels known for it need not be read again."""


class _Reserved(VersionReply):
    reserved_1: Annotated[int, U8(mk="reserved1")]


class _FcState(WireMessage):
    patch: Annotated[int, U8(mk="SWPatch")]
    fault_0: Annotated[FlightFault0, U8(mk="HardwareError[0]", enum=FlightFault0)]
    fault_1: Annotated[FlightFault1, U8(mk="HardwareError[1]", enum=FlightFault1)]
    hardware: Annotated[int, U8(mk="HWMajor", unit="0.1")]
    """Board revision times ten, for example 22."""
    motor_controller: Annotated[int, U8(mk="BL_Firmware", unit="0.01")]
    """Lowest BL-Ctrl release times hundred; 255 unknown."""
    flags: Annotated[VersionFlags, U8(mk="Flags", enum=VersionFlags)]


@answer(
    Board.FC,
    "V",
    name="Version",
    layout="fc210",
    firmware="FC 2.09 and later",
    source=Source.FC_SEND,
    recognise=_is_fc210,
    tells_firmware=True,
)
class VersionFc210(_FcState, _Labelled):
    """Release and faults of a FlightCtrl."""


@answer(
    Board.FC,
    "V",
    name="Version",
    layout="fc200",
    firmware="FC 0.91, 2.00a to 2.08",
    source=Source.FC_SEND,
    recognise=_is_fc200,
    tells_firmware=True,
)
class VersionFc200(_FcState, _Reserved):
    """Release and faults of a FlightCtrl."""

    motor_controller: Annotated[int, U8(mk="reserved2", unit="0.01")]
    """0; the BL-Ctrl release times hundred from about 2.06e on."""


class _Classic(VersionReply):
    protocol_minor: Annotated[int, U8(mk="ProtoMinor")]
    patch: Annotated[int, U8(mk="SWPatch")]


@answer(
    Board.FC,
    "V",
    name="Version",
    layout="classic",
    firmware="FC up to 0.90",
    source=(Source.FC_SEND, Source.NC_SEND),
    recognise=_is_classic,
    tells_firmware=True,
)
class VersionClassic(_Classic):
    """Release and faults of a FlightCtrl."""

    fault_0: Annotated[FlightFault0, U8(mk="HardwareError[0]", enum=FlightFault0)]
    fault_1: Annotated[FlightFault1, U8(mk="HardwareError[1]", enum=FlightFault1)]
    fault_rest: Annotated[tuple[int, ...], U8(mk="HardwareError[2..4]", count=3)]


@answer(
    Board.NC,
    "V",
    name="Version",
    layout="classic",
    firmware="NC up to 0.3x",
    source=Source.NC_SEND,
    recognise=_is_classic,
    tells_firmware=True,
)
class NaviVersionClassic(_Classic):
    """Release and faults of a NaviCtrl."""

    fault_0: Annotated[NaviFault0, U8(mk="HardwareError[0]", enum=NaviFault0)]
    fault_rest: Annotated[tuple[int, ...], U8(mk="HardwareError[1..4]", count=4)]


@answer(
    Board.NC,
    "V",
    name="Version",
    layout="fc200",
    firmware="NC 2.x",
    source=Source.INFERRED,
    recognise=_is_navi_200,
    tells_firmware=True,
)
class NaviVersion200(_Reserved):
    """Release and faults of a NaviCtrl."""

    patch: Annotated[int, U8(mk="SWPatch")]
    fault_0: Annotated[NaviFault0, U8(mk="HardwareError[0]", enum=NaviFault0)]
    fault_1: Annotated[int, U8(mk="HardwareError[1]")]
    hardware: Annotated[int, U8(mk="HWMajor", unit="0.1")]
    """Board revision times ten."""
    reserved_2: Annotated[int, U8(mk="reserved2")]
    flags: Annotated[VersionFlags, U8(mk="Flags", enum=VersionFlags)]


@answer(Board.MAG, "V", name="Version", layout="classic", firmware="MK3Mag", source=Source.TOOLS, tells_firmware=True)
class CompassVersion(_Classic):
    """Release of a MK3Mag."""

    fault: Annotated[tuple[int, ...], U8(mk="HardwareError", count=5)]
