"""A source of poses as an eye: from reports to poses of the vehicle against a target. Pure.

Each report is judged when it comes (`MotionJudge`); a pose goes on to the flight core about thirty times a second, as
those of a camera do, for which the estimator is tuned: the error of a faster source is the same in the next report.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from mkdaemon.config.positions import PositionSource
from mkdaemon.frames import (
    Matrix,
    Vector,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
)
from mkdaemon.positions.motionjudge import MotionJudge
from mkdaemon.positions.rivals import Rival, Rivals
from mkdaemon.stamp import Stamp
from mkdaemon.telemetry.base import Telemetry
from mkdaemon.telemetry.position import PositionReport, report_key
from mkdaemon.telemetry.vision import REPORTED, EyeState, PoseRefusal, PoseRefused, VisionPose, VisionStats

PERIOD: Final = 0.03
"""Between two poses that go on [s]."""
EARLY: Final = 0.002
"""One that is this early is on time [s]."""
SILENT: Final = 0.5
"""A source without a report for longer is missing [s]."""
JUDGED: Final = 0.5
"""After this time without a usable report a source counts as refused [s]."""
MEASURED: Final = 1.0
"""Rates and ages are those of the last second [s]."""
REMEDIES: Final = {
    PoseRefusal.MALFORMED: "they are no poses; docs/keys.md has the fields of PositionReport",
    PoseRefusal.UNSIGNED: "they are not signed with the secret of `secret_file`; give the sender the same one",
    PoseRefusal.LATE: "they are older than max_age; look for a slow network, or a queue in the sender",
    PoseRefusal.OUT_OF_ORDER: "older than the ones before; two programs send under this name, or one's clock is set",
    PoseRefusal.REPEATED: "the same numbers come again and again; its system does not measure",
    PoseRefusal.OFF_COURSE: "they jumped; another body's pose, or another frame",
    PoseRefusal.MOTION: "",
    PoseRefusal.DISPUTED: "",
}
"""What is wrong with refused reports, and what to do; of motion and disputes the state says it."""

DISPUTED: Final = ", and nothing shows yet which is wrong: measure both frames again, or fly by one (trusted_for = [])"
"""What to do about a dispute."""


class _Spot(NamedTuple):
    """A target that poses are published against: origin (3,) [m] and axes (3, 3), in the frame of `target`."""

    name: str
    origin: Vector
    axes: Matrix


def _turned(rpy_deg: tuple[float, float, float]) -> Matrix:
    return rotation_from_euler(*(math.radians(angle) for angle in rpy_deg))


class PositionEye:
    """One source of poses.

    Attributes:
        cfg: its section.
        rival: what other sources need to know of it.
    """

    def __init__(self, cfg: PositionSource) -> None:
        """Prepare; nothing was reported, and it is the only source of its target."""
        self.cfg = cfg
        self.rival = Rival(cfg.name, math.hypot(cfg.position_sd, cfg.frame_sd), MotionJudge())
        self._rivals = Rivals(self.rival, ())
        self._axes, self._origin = _turned(cfg.rpy_deg), np.array(cfg.position)
        self._body_from_flu, self._body = _turned(cfg.body_rpy_deg).T, np.array(cfg.body_position)
        spots = [_Spot(cfg.target, np.zeros(3), np.eye(3))]
        for place in cfg.places:
            yaw = math.radians(place.yaw_deg)
            spots.append(_Spot(place.name, np.array(place.position), rotation_from_euler(0.0, 0.0, yaw)))
        self._spots = tuple(spots)
        self._refused: Counter[str] = Counter()
        self._newest = (-1, -1)
        self._arrived_at = self._used_at = self._passed_at = self._taken_at = -math.inf
        self._recent: deque[tuple[float, float, bool]] = deque()
        self._processed = 0
        self._why = PoseRefusal.MALFORMED
        self._has_attitude = False

    def attitude_received(self, at: float, pitch: float, roll: float) -> None:
        """Take an attitude of the boards; see `MotionJudge`."""
        self._has_attitude = True
        self.rival.judge.attitude_received(at, pitch, roll)

    def compare_with(self, others: Iterable[PositionEye]) -> None:
        """Compare its poses with those of other sources from now on: those of its target that are flown by."""
        is_flown = "flight" in self.cfg.trusted_for
        peers = [each for each in others if each.cfg.target == self.cfg.target and "flight" in each.cfg.trusted_for]
        self._rivals = Rivals(self.rival, [each.rival for each in peers if is_flown and each is not self])

    def refused(self, why: PoseRefusal, now: float) -> None:
        """Count a report that is refused before it is read, at a time [s]."""
        self._arrived_at = now
        self._refuse(why)

    def _refuse(self, why: PoseRefusal) -> None:
        self._refused[why.value] += 1
        self._why = why

    def take(
        self, report: PositionReport, sent: float, now: float, stamp: Stamp, *, is_flown: bool
    ) -> list[tuple[str, Telemetry]]:
        """Take a report; return the keys and values that follow from it.

        Args:
            report: as it came.
            sent: when, by our clock, or when it arrived where it does not say [s].
            now: [s].
            stamp: the time to publish with, of `now`.
            is_flown: the aircraft flies.
        """
        self._arrived_at = now
        at = sent - report.age
        late = now - at
        order = (report.epoch, report.sequence)
        why: PoseRefusal | None = None
        if order <= self._newest or at <= self._taken_at:
            why = PoseRefusal.OUT_OF_ORDER
        elif late > self.cfg.max_age:
            why = PoseRefusal.LATE
        if why is None:
            if report.epoch != self._newest[0]:
                self.rival.judge = self.rival.judge.restarted()
                self._rivals.restart()
            self._newest, self._taken_at = order, at
            place, rotation = self._pose(report)
            why = self.rival.judge.take(at, place, rotation, is_flown=is_flown)
        if why is None:
            covariance = self._covariance(report)
            self.rival.spread = math.sqrt(max(0.0, float(covariance.diagonal()[:3].max())))
            if not self._rivals.compare(at):
                why = PoseRefusal.MOTION if self.rival.judge.contradiction else PoseRefusal.DISPUTED
        self._processed += 1
        self._recent.append((now, late, why is None))
        while self._recent[0][0] < now - MEASURED:
            self._recent.popleft()
        measured = stamp.model_copy(update={"monotonic": at, "wall": stamp.wall - late})
        seen = {"camera": self.cfg.name, "sequence": report.sequence, "stamp": measured, "stamped_by": "header"}
        if why is not None:
            self._refuse(why)
            if now - self._passed_at < PERIOD - EARLY:
                return []
            self._passed_at = now
            refused = PoseRefused(
                **seen, target=self.cfg.target, refusal=why, decode_age=None, has_attitude=self._has_attitude
            )
            return [(f"vision/{self.cfg.name}/refused", refused)]
        self._used_at = now
        if at - self._passed_at < PERIOD - EARLY:
            return []
        self._passed_at = at
        return [
            (f"vision/{self.cfg.name}/pose", self._published(spot, place, rotation, covariance, late, seen))
            for spot in self._spots
        ]

    def _pose(self, report: PositionReport) -> tuple[Vector, Matrix]:
        """Where the vehicle is in the target frame (3,) [m], and target from FLU (3, 3)."""
        rotation = self._axes @ rotation_from_quaternion(report.quaternion) @ self._body_from_flu
        return self._origin + self._axes @ np.array(report.position) - rotation @ self._body, rotation

    def _covariance(self, report: PositionReport) -> Matrix:
        """Of the vehicle's pose in the target frame (6, 6), the frame's own error included."""
        covariance = np.diag([self.cfg.position_sd**2] * 3 + [math.radians(self.cfg.angle_sd_deg) ** 2] * 3)
        if report.covariance is not None:
            axes = np.kron(np.eye(2), self._axes)
            covariance = axes @ np.array(report.covariance).reshape(6, 6) @ axes.T
        covariance[:3, :3] += self.cfg.frame_sd**2 * np.eye(3)
        return covariance

    def _published(
        self, spot: _Spot, place: Vector, rotation: Matrix, covariance: Matrix, late: float, seen: dict[str, object]
    ) -> VisionPose:
        """The pose against one target."""
        back = spot.axes.T
        here, turned, both = back @ (place - spot.origin), back @ rotation, np.kron(np.eye(2), back)
        return VisionPose(
            **seen,
            target=spot.name,
            position_target=here.tolist(),
            quaternion_target_from_flu=quaternion_from_rotation(turned),
            position_flu=(-turned.T @ here).tolist(),
            quaternion_flu_from_target=quaternion_from_rotation(turned.T),
            covariance=(both @ covariance @ both.T).ravel().tolist(),
            calibration_sd=(self.cfg.frame_sd, self.cfg.frame_sd, 0.0),
            position_cam=(0.0, 0.0, 0.0),
            quaternion_cam_from_target=(1.0, 0.0, 0.0, 0.0),
            source=REPORTED,
            mode=REPORTED,
            points=0,
            rms_px=0.0,
            ambiguity=None,
            decided_by="",
            decode_age=0.0,
            delivered=late,
            latency=late,
        )

    def stats(self, now: float, stamp: Stamp) -> VisionStats:
        """State and figures at a time [s], to publish with a stamp."""
        state, reason = self._state(now)
        recent = [each for each in self._recent if each[0] > now - MEASURED]
        late = 1000.0 * np.array([each[1] for each in recent] or [0.0])
        return VisionStats(
            stamp=stamp,
            camera=self.cfg.name,
            state=state,
            reason=reason,
            alarms={},
            source=report_key(self.cfg.name),
            width=0,
            height=0,
            fps=len(recent) / MEASURED,
            processed=self._processed,
            dropped=0,
            lost=0,
            damaged=self._refused[PoseRefusal.MALFORMED.value],
            reopened=0,
            faults=0,
            restarts=0,
            posed=sum(each[2] for each in recent) / max(len(recent), 1),
            refused=dict(self._refused),
            detect_p50_ms=0.0,
            detect_p99_ms=0.0,
            latency_p50_ms=float(np.median(late)),
            latency_p99_ms=float(np.quantile(late, 0.99)),
            settings_refused=(),
            trusted_for=self.cfg.trusted_for,
        )

    def _state(self, now: float) -> tuple[EyeState, str]:
        """Whether the aircraft can be flown by it, and what is in the way if not."""
        silent = now - self._arrived_at
        if silent > SILENT:
            last = "no report yet" if math.isinf(silent) else f"the last report is {silent:.0f} s old"
            return EyeState.MISSING, f"{last}: start its sender (mkdaemon gateway mocap), show it the body"
        if self.rival.judge.contradiction is not None:
            return EyeState.CONTRADICTED, self.rival.judge.contradiction.value
        if self._rivals.against and self._why is PoseRefusal.DISPUTED:
            others = " and ".join(self._rivals.against)
            return EyeState.DISPUTED, f"{others} shows the aircraft {self._rivals.apart:.2f} m from there{DISPUTED}"
        if now - self._used_at <= JUDGED and not self.rival.judge.has_strayed:
            return EyeState.OK, ""
        state = EyeState.CONTRADICTED if self._why is PoseRefusal.OFF_COURSE else EyeState.REFUSED
        return state, REMEDIES[self._why]
