"""Dangers of requests, and the conditions for sending them: a column of the message's declaration.

`protocol` declares it, `control.admission` decides by it; the two never see each other, so the type lives below both.
Source of the rules: docs/safety.md, "The output limiter"; docs/protocol.md, "Danger".
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


class Confirm(StrEnum):
    """Cases in which a request must carry `confirm`."""

    NO = "no"
    IN_FLIGHT = "in flight"
    """While motors run, or their state is unknown."""
    ALWAYS = "always"


class Switch(StrEnum):
    """Switches of the configuration section `commands`; each is off by default."""

    RESET = "allow_reset"
    RECEIVER_BRIDGE = "allow_receiver_bridge"
    FACTORY_RESET = "allow_factory_reset"
    COMPASS_CALIBRATION = "allow_compass_calibration"
    FORK_ARMING = "allow_fork_arming"


@dataclass(frozen=True, slots=True, kw_only=True)
class Danger:
    """The danger of a request, and its conditions.

    Attributes:
        effect: the harm it can do, as the end of a sentence.
        confirm: when the request must carry `confirm`.
        stopped: motors must be known to stand still.
        proven: the last version reply must have come from the board asked.
        switch: what the configuration must turn on; None for nothing.
        never: why it is never sent for a client; empty where it may be.
        instead: what the client can do instead, where it is never sent.
        harmless: a field and the value with which the request does no harm; None where every value can.
        turns_motors: motors that turn because of such a request, sent a moment ago, do not refuse the next one.
    """

    effect: str
    confirm: Confirm = Confirm.NO
    stopped: bool = False
    proven: bool = False
    switch: Switch | None = None
    never: str = ""
    instead: str = ""
    harmless: tuple[str, object] | None = None
    turns_motors: bool = False

    def applies(self, fields: Mapping[str, object]) -> bool:
        """Whether a request with these field values is dangerous."""
        return self.harmless is None or fields.get(self.harmless[0]) != self.harmless[1]
