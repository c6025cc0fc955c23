"""Reports of the flight core and their rates: phases, status, refused setpoints, frames not sent."""

from __future__ import annotations

from typing import Any, Final

from mkdaemon.control.actions import (
    Action,
    PublishError,
    PublishEstimate,
    PublishNavi,
    PublishPath,
    PublishStatus,
    ReportCommand,
    ReportFailsafe,
    ReportMode,
    Warn,
)
from mkdaemon.control.authority import Authority
from mkdaemon.control.estimator.values import ViewFault
from mkdaemon.control.heights import heights_found
from mkdaemon.control.modes import IN_FLIGHT
from mkdaemon.control.naviwatch import NaviWatch
from mkdaemon.control.output import StickOutput
from mkdaemon.control.pilots_hands import pilots_hands
from mkdaemon.control.vehicle import VehicleFacts
from mkdaemon.errors import CommandRejectedError
from mkdaemon.telemetry.command import CommandResult, refused
from mkdaemon.telemetry.control import Cause, ErrorValue, EstimateValue, Phase, ReleaseOutcome, trouble_words
from mkdaemon.telemetry.path import PathProgress
from mkdaemon.telemetry.refusals import Token, refuse
from mkdaemon.telemetry.selfcal import HEIGHTS_LIKELY
from mkdaemon.telemetry.setpoint import Setpoint
from mkdaemon.telemetry.status import Status
from mkdaemon.telemetry.vision import VisionPose

_IS_CONFIRMED: Final = {
    ReleaseOutcome.CONFIRMED: True,
    ReleaseOutcome.UNCONFIRMED: False,
    ReleaseOutcome.NOT_SENT: False,
    ReleaseOutcome.NOT_OBSERVABLE: None,
}
_FAILSAFES: Final = {Phase.STALE: "neutral", Phase.LANDING: "land"}
"""Phases that are a step of the ladder, and what it is called."""
STATUS_PERIOD: Final = 1.0
"""Status is published at least this often [s]."""
TROUBLE_PERIOD: Final = 0.2
"""And this often while a flight has no pose: the time until the release runs down [s]."""
NEW_GAIN: Final = 0.1
"""Smallest change of the stick gain that is reported."""
REPORT_PERIOD: Final = 1.0
"""Refused setpoints, and stick frames the line does not take, are reported at most this often [s]."""


class Reports:
    """Collects what the next tick hands out."""

    def __init__(self, authority: Authority, output: StickOutput, facts: VehicleFacts) -> None:
        self._authority = authority
        self._output = output
        self._phase = authority.phase
        self._status: tuple[object, ...] | None = None
        self._status_at = float("-inf")
        self._refused = self._poses_refused = 0
        self._waiting: list[Action] = []
        self._warned: set[str] = set()
        self._reported_at: dict[str, float] = {}
        self._believed: EstimateValue | None = None
        self._causes: tuple[Cause, ...] = ()
        self._releases_in: float | None = None
        self._path: tuple[str, str, bool] | None = None
        self._navi = NaviWatch(facts)
        self._facts = facts

    def take(self) -> list[Action]:
        """Return what was collected, once."""
        waiting, self._waiting = self._waiting, []
        return waiting

    def first_setpoint(self, setpoint: Setpoint) -> None:
        """Report the first setpoint of an epoch."""
        accepted = CommandResult(status=Status.ACCEPTED)
        self._waiting.append(ReportCommand(setpoint.suffix, setpoint.__dict__, accepted))

    def setpoint_refused(
        self, key: str, fields: dict[str, Any], error: CommandRejectedError, now: float, *, is_by_holder: bool
    ) -> None:
        """Count a setpoint that was refused or could not be read, and report it, but not too often.

        The holder's are reported separately, so that a stranger's cannot hide them.

        Args:
            key: where it came, without `mk/<vehicle>/`.
            fields: what it carried.
            error: why it was refused.
            now: [s].
            is_by_holder: the holder of the lease signed it.
        """
        self._refused += 1
        if self._is_due(f"setpoint refused {is_by_holder}", now):
            self._waiting.append(ReportCommand(key, fields, refused(error)))

    def pose_refused(self, pose: VisionPose, fault: ViewFault, now: float) -> None:
        """Count an unusable pose, and report it at a limited rate."""
        self._poses_refused += 1
        if self._is_due("pose refused", now):
            self._waiting.append(Warn(f"pose of {pose.camera} against {pose.target} not used: {fault.value}"))

    def target_changed(self, before: str, after: str) -> None:
        """Report that another target is followed, because the one before was out of sight for long."""
        self._waiting.append(Warn(f"target {after} is followed now: {before} was out of sight for too long"))

    def frame_not_sent(self, error: CommandRejectedError, now: float) -> None:
        """Report a stick frame that the line does not take, but not too often."""
        if self._is_due("frame not sent", now):
            self._waiting.append(Warn(f"stick frame not sent: {error}"))

    def estimate(self, value: EstimateValue | None, error: ErrorValue | None) -> None:
        """Report the estimate, and its distance from the goal if there is one."""
        if value is None:
            return
        self._waiting.append(PublishEstimate(value))
        self._report_model(value)
        if error is not None:
            self._waiting.append(PublishError(error))

    def path(self, value: PathProgress | None, now: float) -> None:
        """Report how far a flight along a path is [s], where it stands otherwise than before, or not lately."""
        news = None if value is None else (value.id, value.stage, value.is_paused)
        if value is not None and (self._is_due("path", now) or news != self._path):
            self._waiting.append(PublishPath(value))
        self._path = news

    def _report_model(self, value: EstimateValue) -> None:
        """Warn when the aircraft's answer to its sticks is found to be another than its model's, or that one again."""
        before = self._believed or value
        if value.stick_filter != before.stick_filter:
            filters = f"{1000 * value.stick_filter:.0f} ms, and not {1000 * before.stick_filter:.0f} ms"
            self._waiting.append(Warn(f"the stick filter is {filters}: the aircraft answers its sticks so"))
        is_gain_new = abs(value.stick_gain - before.stick_gain) >= NEW_GAIN
        if is_gain_new:
            gains = f"{value.stick_gain:.2f} times that of its parameter set, and not {before.stick_gain:.2f} times"
            self._waiting.append(Warn(f"the angle per stick count is {gains}: the aircraft answers its sticks so"))
        if self._believed is None or is_gain_new or value.stick_filter != before.stick_filter:
            self._believed = value

    def _is_due(self, about: str, now: float) -> bool:
        """Whether something is to be reported again; then it is not for a while."""
        is_due = now - self._reported_at.get(about, float("-inf")) >= REPORT_PERIOD
        if is_due:
            self._reported_at[about] = now
        return is_due

    def _warn_once(self, about: str, text: str) -> None:
        """Warn when something begins to be so; without a text it is not."""
        if text and about not in self._warned:
            self._waiting.append(Warn(text))
        self._warned = self._warned | {about} if text else self._warned - {about}

    def eyes_reported(self) -> None:
        """Warn once when the barometer begins to contradict the heights that images show."""
        found = heights_found(self._facts.eyes)
        is_wrong = found is not None and found.odds >= HEIGHTS_LIKELY
        self._warn_once("heights", f"{found.refusal.reason} {found.refusal.fix}" if found and is_wrong else "")

    def trouble(self, causes: tuple[Cause, ...], pose_age: float | None, exit_after: float) -> None:
        """Take why a flight has no pose, and warn once when it begins to have none.

        Args:
            causes: the chain; empty while there is a pose.
            pose_age: time since the last one [s].
            exit_after: with this age the aircraft is released [s].
        """
        self._causes = causes
        self._releases_in = max(0.0, exit_after - pose_age) if causes and pose_age is not None else None
        self._warn_once("trouble", trouble_words(causes, self._releases_in))

    def released(self, reason: str, outcome: ReleaseOutcome | None) -> None:
        """Report the end of a failsafe release; None if it did not end in time."""
        self._waiting.append(ReportFailsafe("release", reason, None if outcome is None else _IS_CONFIRMED[outcome]))

    def phase_changed(self) -> None:
        """Report the phase if it is another one than reported last."""
        before, after = self._phase, self._authority.phase
        if after is before:
            return
        self._phase = after
        self._waiting.append(ReportMode(before, after, self._authority.reason))
        if after is Phase.UNANSWERED:
            error = refuse(Token.NO_ANSWER, detail=self._authority.reason)
            self._waiting.append(Warn(f"{error.reason} {error.fix}"))
        if action := _FAILSAFES.get(after):
            self._waiting.append(ReportFailsafe(action, self._authority.reason))
        self._believed = None

    def status(
        self, layout: str | None, battery: CommandRejectedError | None, pose_age: float | None, now: float
    ) -> None:
        """Report the status, and the NaviCtrl's own flight, if they have changed or are due.

        Args:
            layout: of external control; None where there is none.
            battery: why the battery is low, and what to do; None while it is not.
            pose_age: time since the newest pose [s]; None where there was none.
            now: [s].
        """
        self._warn_once("battery", "" if battery is None else f"{battery.reason} {battery.fix}")
        authority = self._authority
        navi = self._navi.look(now)
        if navi is not None:
            self._waiting.append(PublishNavi(navi))
        lease = authority.lease(now)
        progress = authority.progress
        lid = self._output.lid.pilots_throttle if authority.phase in IN_FLIGHT else None
        sinks = "the aircraft sinks until the pilot raises it above hover"
        self._warn_once("lid", "" if lid is None else f"the pilot's throttle ({lid:+.0f}) caps ours: {sinks}")
        news = (
            authority.phase,
            authority.reason,
            lease.epoch if lease else None,
            progress,
            lid is None,
            authority.aborts,
            tuple(cause.kind for cause in self._causes),
        )
        period = TROUBLE_PERIOD if self._causes else STATUS_PERIOD
        if news == self._status and now - self._status_at < period:
            return
        self._status, self._status_at = news, now
        self._waiting.append(
            PublishStatus(
                phase=authority.phase,
                reason=authority.reason,
                causes=self._causes,
                trouble=trouble_words(self._causes, self._releases_in),
                releases_in=self._releases_in,
                lease=lease,
                setpoint_age=authority.setpoint_age(now),
                refused=self._refused,
                aborts=authority.aborts,
                external_control=layout,
                frames_handed_over=self._output.handed_over,
                frames_sent=self._output.sent,
                frames_dropped=self._output.dropped(is_flying=authority.phase in IN_FLIGHT),
                frames_confirmed=self._output.confirmed,
                pose_age=pose_age,
                manoeuvre=None if progress is None else progress.manoeuvre,
                stage="" if progress is None else progress.stage,
                is_done=progress is not None and progress.is_done,
                outcome=authority.outcome,
                poses_refused=self._poses_refused,
                pilots_throttle=lid,
                hands=pilots_hands(authority.phase, progress, is_capped=lid is not None),
            )
        )
