"""Declaration of one parameter of the FlightCtrl's parameter sets."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class ParameterKind(Enum):
    """Interpretation of a parameter's bytes."""

    NUMBER = "number"
    POTI = "number or poti"
    """248..255 stand for poti 8..1."""
    BITS = "bits"
    TEXT = "text"
    LIST = "list"
    SPARE = "spare"


@dataclass(frozen=True, slots=True)
class Bit:
    """One bit of a parameter, in the revisions where it means this."""

    mask: int
    name: str
    mk: str
    since: int = 0
    until: int = 255


@dataclass(frozen=True, slots=True)
class SettingParameter:
    """One parameter, in the revisions that have it.

    Attributes:
        name: English name; stays the same where the firmware renamed a field without changing its use.
        mk: the firmware's word.
        meaning: what it does.
        kind: how to read it.
        since: first revision that has it.
        until: last revision that has it.
        unit: unit of one count, in words.
        high: largest useful value, where known.
        lengths: (revision from which on, bytes), ascending; empty for one byte.
        bits: meaning of the bits.
    """

    name: str
    mk: str
    meaning: str
    kind: ParameterKind
    since: int
    until: int
    unit: str
    high: int
    lengths: tuple[tuple[int, int], ...]
    bits: tuple[Bit, ...]

    def length(self, revision: int) -> int:
        """Bytes it has in a revision; 0 where the revision does not have it."""
        if not self.since <= revision <= self.until:
            return 0
        return next((count for first, count in reversed(self.lengths) if first <= revision), 1)


def parameter(
    name: str,
    mk: str,
    meaning: str,
    *,
    since: int = 73,
    until: int = 255,
    unit: str = "",
    high: int = 255,
    poti: bool = False,
    kind: ParameterKind = ParameterKind.NUMBER,
    lengths: tuple[tuple[int, int], ...] = (),
    bits: tuple[Bit, ...] = (),
) -> SettingParameter:
    """Declare one parameter; `bits` make it a field of bits, `poti` a number or poti."""
    kind = ParameterKind.POTI if poti else ParameterKind.BITS if bits else kind
    return SettingParameter(name, mk, meaning, kind, since, until, unit, high, lengths, bits)
