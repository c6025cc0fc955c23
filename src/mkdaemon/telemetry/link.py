"""The link's own values: state, health and traffic."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Stamped, Telemetry
from mkdaemon.telemetry.tone import Tone, ToneEnum


class LinkCondition(ToneEnum):
    """The one word for the line. This is the one table of conditions."""

    UP = "up", "up", Tone.OK
    """Both directions are proven, every wanted stream is on time, losses are below the limit."""
    DEGRADED = "degraded", "degraded", Tone.WARN
    """Both directions are proven, but a stream is stale, losses are high, or bytes arrive damaged."""
    ONE_WAY = "one_way", "one way", Tone.BAD
    """We hear the board; nothing shows that it hears us."""
    MUTE = "mute", "mute", Tone.BAD
    """The port is open and we ask, but no byte comes."""
    GARBAGE = "garbage", "only garbage", Tone.BAD
    """Bytes come, none of them a frame: wrong baud, noise, or only plain text."""
    DOWN = "down", "port unusable", Tone.BAD
    """The port is there but cannot be used: lost, in use, forbidden, or it takes no bytes."""
    ABSENT = "absent", "no port", Tone.BAD
    """There is no such port at the moment."""
    CLOSED = "closed", "port closed", Tone.WARN
    """We have closed the port in order."""

    @property
    def is_usable(self) -> bool:
        """Both directions work, perhaps with losses."""
        return self in (LinkCondition.UP, LinkCondition.DEGRADED)

    @property
    def hears_board(self) -> bool:
        """Right frames arrive."""
        return self.is_usable or self is LinkCondition.ONE_WAY

    @property
    def is_silent(self) -> bool:
        """The port is open, and no right frame arrives."""
        return self in (LinkCondition.MUTE, LinkCondition.GARBAGE)


class LinkState(Stamped):
    """State of the line, with the reason and since when."""

    condition: LinkCondition
    """State of the link."""
    reason: str
    """One sentence: what was observed, and what to do about it."""
    since: Stamp
    """When this condition began."""
    port: str
    """The port in use or looked for."""
    baud: int
    """Line rate in use [baud]."""
    hears_board: bool
    """Valid frames arrive, as `condition` says."""
    board_hears_us: bool
    """`condition` says so, and a reply or confirmation within the last half second answers something we sent."""
    boards: tuple[str, ...] = ()
    """Boards that answered since the port was opened: fc, nc, mag."""
    firmware: str = ""
    """What the boards said about themselves, in words."""
    external_control: str = ""
    """Layout of external control frames in use; empty where external control is refused."""
    redirected_to: str = ""
    """Board a NaviCtrl passes the line through to at the moment; empty for none."""
    openings: int = 0
    """How often the port was opened since the start."""


class Why(StrEnum):
    """Known reasons of an unanswered frame: the counts of `Fates` that together are `unanswered`."""

    LOST = "lost"
    REPLACED = "replaced"
    OUTAGE = "outage"
    WITHDRAWN = "withdrawn"


class Fates(Telemetry):
    """Outcomes of all sent frames of one kind, since the start.

    `sent` is `answered` + `late` + `unanswered` + `waiting` + `silent`. `unanswered` is `lost` + `replaced` + `outage`
    + `withdrawn`: why it is thought to have stayed without an answer. Nothing is left out.
    """

    sent: int = 0
    """Written to the port."""
    answered: int = 0
    """Answered in time."""
    late: int = 0
    """Answered after the time-out."""
    unanswered: int = 0
    """Not answered at all."""
    waiting: int = 0
    """Sent a moment ago: the answer can still come in time."""
    silent: int = 0
    """Sent without an expected answer: a NaviCtrl 0.24 confirms no stick frame, some requests have no reply."""
    lost: int = 0
    """Unanswered while the line worked: the frame or its answer was lost, or the board did not take it."""
    replaced: int = 0
    """Unanswered because the board was sending something else until a newer frame replaced the number to confirm: a
    FlightCtrl keeps one."""
    outage: int = 0
    """Unanswered while the line was lost, or while this program did not run."""
    withdrawn: int = 0
    """Unanswered when the requester stopped waiting."""

    @property
    def words(self) -> str:
        """The counts as one line, those of 0 left out: `250 of 253 answered, 1 late, 2 unanswered (2 lost)`."""
        reasons = ", ".join(f"{count} {why}" for why in Why if (count := getattr(self, why)))
        parts = [f"{self.answered} of {self.sent} answered"]
        parts += [f"{self.late} late"] if self.late else []
        parts += [f"{self.unanswered} unanswered ({reasons})"] if self.unanswered else []
        parts += [f"{self.silent} need no answer"] if self.silent else []
        parts += [f"{self.waiting} waiting"] if self.waiting else []
        return ", ".join(parts)

    def since(self, before: "Fates") -> "Fates":
        """Outcomes of the frames sent after an earlier count."""
        return Fates(**{name: count - getattr(before, name) for name, count in self})


class RoundTripStats(Telemetry):
    """Answered and unanswered probes over the moving window."""

    sent: int = 0
    """Probes of the window whose outcome is known."""
    lost: int = 0
    """Of those, not answered in time, whatever the reason."""
    replaced: int = 0
    """Of the lost ones: the board confirms only a newer frame, see `Fates`; the verdict on the line leaves them out."""
    loss_percent: float = 0.0
    """100 * lost / sent."""
    sent_total: int = 0
    """Probes whose outcome is known, since the start."""
    lost_total: int = 0
    """Of those, not answered in time, whatever the reason."""
    last_ms: float | None = None
    """Latest round trip [ms]."""
    mean_ms: float | None = None
    """Weighted mean; every new value counts an eighth [ms]."""
    p50_ms: float | None = None
    """Median round trip [ms]."""
    p95_ms: float | None = None
    """95th percentile [ms]."""
    p99_ms: float | None = None
    """99th percentile [ms]."""
    late: int = 0
    """Answers that came after their time-out, since the start."""
    duplicate: int = 0
    """Answers that came twice or to nothing we asked, since the start."""


class KindHealth(Telemetry):
    """Arrival of one kind of frame, against the requested rate."""

    key: str
    """The message, as in Zenoh keys: osd, attitude, debug, ..."""
    board: str
    """Board that sends it."""
    frames: int
    """Frames since the port was opened."""
    rate: float
    """Rate over the moving window [Hz]."""
    asked_rate: float | None
    """Requested rate [Hz]; None without a subscription."""
    age: float
    """Time since the latest frame [s]."""
    is_stale: bool
    """Three periods were missed."""


class LinkHealth(Stamped):
    """Everything measured about the line; published at 5 Hz and at once when the condition changes."""

    state: LinkState
    """State of the link that follows from these numbers."""
    echo: RoundTripStats
    """Link test frames: `z` on a NaviCtrl, version requests on a FlightCtrl, which has no link test."""
    confirm: RoundTripStats
    """External control frames and their confirmations (`B`): the control path."""
    link_tests: Fates = Fates()
    """Outcomes of the link tests."""
    requests: Fates = Fates()
    """Outcomes of the requests, each attempt counted."""
    stick_frames: Fates = Fates()
    """Outcomes of the external control frames."""
    heard_age: float | None = None
    """Time since the latest right frame [s]; None before the first."""
    answer_age: float | None = None
    """Time since the latest proof that the board hears us [s]; None before the first."""
    garbage_bytes_per_s: float = 0.0
    """Bytes that did not become frames [bytes/s]."""
    checksum_error_rate: float = 0.0
    """Frames with a wrong checksum [1/s]."""
    backlog_bytes: int = 0
    """Bytes the port has not taken yet."""
    kinds: tuple[KindHealth, ...] = ()
    """Every kind of frame received or requested."""

    @property
    def fates(self) -> dict[str, Fates]:
        """Outcomes of all sent frames by kind; kinds that were never sent are left out."""
        found = {title: getattr(self, name) for name, title in FATES.items()}
        return {title: fates for title, fates in found.items() if fates.sent}


FATES: Final = {
    name: name.replace("_", " ") for name, field in LinkHealth.model_fields.items() if field.annotation is Fates
}
"""What is counted, as a field of `LinkHealth` and in words: link tests, requests, stick frames."""


def fates_of(health: Mapping[str, object]) -> dict[str, Fates]:
    """Outcomes of all sent frames by kind; kinds that were never sent are left out.

    Args:
        health: fields of a `link/health`. Counts that it lacks, as from an older daemon, and what is no count are 0.
    """
    found: dict[str, Fates] = {}
    for name, title in FATES.items():
        counts = health.get(name)
        if isinstance(counts, Mapping):
            fates = Fates(**{key: count for key, count in counts.items() if type(count) is int and key in _COUNTS})
            found |= {title: fates} if fates.sent else {}
    return found


_COUNTS: Final = frozenset(Fates.model_fields)


class LinkTraffic(Stamped):
    """Traffic of the line, and its planned share."""

    rx_bytes: int
    """Bytes received since the start."""
    tx_bytes: int
    """Bytes sent since the start."""
    rx_frames: int
    """Valid frames received since the start."""
    tx_frames: int
    """Frames sent since the start."""
    rx_share: float
    """Share of the line used towards us over the last second [0..1]."""
    tx_share: float
    """Share of the line used towards the board over the last second [0..1]."""
    rx_planned: float
    """Share the wanted streams and replies need [0..1]."""
    tx_planned: float
    """Share the renewals, echoes and setpoints need [0..1]."""
    renewal: float | None = None
    """Time between two renewals of the streams, so that they run out less than once in 100 hours [s]; None in older
    recordings."""
    delivered_share: float | None = None
    """Share of requests that the board hears, by the link tests and a cautious prior [0..1]; None in older
    recordings."""
    request_distance: float = 0.0
    """Idle line that a request to the FlightCtrl keeps from the frame before, as the radio asks for [s]; 0 by cable."""
    rx_kinds: dict[str, int]
    """Frames received since the start, by board and command letter (`nc.O`)."""
    tx_kinds: dict[str, int]
    """Frames sent since the start, by board and command letter."""
    dropped: dict[str, int]
    """Losses since the start by reason (`checksum`, `length`, `characters`, `text`, `expired`)."""
