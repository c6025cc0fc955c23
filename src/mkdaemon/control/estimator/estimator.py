"""The estimate of the aircraft against a target, from pictures, the attitude the boards report, and what was sent.

The local frame is the target's: origin in its middle, z up, x to the right of its print. Everything is relative to it,
so a target that moves needs nothing special: its motion is the disturbance `d`. Equations: docs/control.md,
"Estimator"; sources of the numbers: docs/lab/control.md, "Estimator".
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from mkdaemon.config.control import HIGHEST_HOVER, LOWEST_HOVER
from mkdaemon.control.estimator.cameras import Cameras
from mkdaemon.control.estimator.commands import CommandHistory, StickFrame
from mkdaemon.control.estimator.model import GRAVITY, LEVEL_STATES, TH, AircraftModel, E, F, H, P, S, T, V
from mkdaemon.control.estimator.rollback import GATE, MEMORY, STEP, Drive, Measurement, RollbackFilter
from mkdaemon.control.estimator.stickresponse import StickResponse
from mkdaemon.control.estimator.tuning import NOMINAL, ROBUST, Tuning
from mkdaemon.control.estimator.values import (
    GAS_CENTRE,
    Estimate,
    StickCommand,
    TargetView,
    ViewFault,
    fault_of,
    upright,
)
from mkdaemon.control.linear import Array

COMPASS_MEMORY: Final = 1.0
"""Headings kept for late pictures [s]."""
ROUNDED: Final = 1.0
"""Rounding: a sent throttle this close to the wanted one counts as the wanted one [count of 254]."""
REMEMBERED: Final = round(MEMORY / STEP)
"""Steps that the filter can go back; what is older is caught up in one [steps]."""
UNKNOWN_TILT: Final = 0.175
"""Standard deviation of the tilt that the pilot's sticks may have commanded in a silence [rad]: half of the largest
tilt that we ever command, `AutopilotConfig.max_tilt`."""
UNKNOWN_THRUST: Final = 0.3
"""Standard deviation of the pilot's thrust meanwhile, over the weight: two of them cover 0.63 to 1.26 of hover
throttle."""
UPRIGHT: Final = 0.5
"""Smallest upward share of the body's own up with which an image's tilt is taken: 60 degrees of tilt."""
UNSENT: Final = 0.3
"""After a pause of stick frames of this length the pilot flies with unknown sticks: the reported tilt is taken as the
commanded one [s]."""
HELD: Final = 0.5
"""The last frame that arrived acts at least this long [s]: the earliest FlightCtrl drops it then, others later."""
LOST_FOR: Final = 0.1
"""Mean length of a burst of lost stick frames [s]: four frames."""
LOST: Final = 0.06
"""Variance of the sticks that act over the square of their change within that time: a radio that loses 1 % in such
bursts lets the old ones act on. Without it one burst at the beginning of a step of 1 m had ten measurements refused in
a quarter of a second, and an overshoot of 122 %; docs/lab/control.md, "Estimator"."""
LEAST_LAG: Final = 0.001
"""Smaller changes of the line's delay are ignored [s]."""
HOVER_LOWEST: Final = LOWEST_HOVER + GAS_CENTRE
"""Smallest accepted hover throttle [count of 254]."""
HOVER_HIGHEST: Final = HIGHEST_HOVER + GAS_CENTRE
"""Largest accepted hover throttle [count of 254]."""

BLIND: Final = 0.5
"""After this time without an image the estimate is dead reckoning, whose errors grow [s]."""


def _leant(tilt: Array, seen: Array) -> Array:
    """Shift of a large tilt beyond the linear `m_z t`, by axis (2,) [m]: 9 mm at 11 degrees and 0.5 m beside.

    With `t` = u tan of the tilt: p = -m + u ((1 - cos) (m u) - m_z sin), and p + m_z t is what the filter takes.

    Args:
        tilt: estimated, towards x and y (2,).
        seen: the target in the body axes turned level by heading alone (3,) [m].
    """
    slant = math.sqrt(1.0 + float(tilt @ tilt))
    shift: Array = tilt * (float(tilt @ seen[:2]) / (slant * (slant + 1.0)) + float(seen[2]) * (1.0 - 1.0 / slant))
    return shift


class Estimator:
    """Follows one target.

    Attributes:
        first: view that it began with.
        model: the plant as estimated.
        line: the same, with the delays of the line as estimated when this estimate started.
        hover_gas: estimated hover throttle [count of 254].
        innovation: mean square of the recent innovations over their variance; about 1 if the model fits.
        refused: unusable measurements since the start, by their fault.
        caution: distrust of the model: 1 at the start, 0 once the innovations are as small as the model predicts, and
            between the two otherwise.
    """

    def __init__(
        self,
        model: AircraftModel,
        view: TargetView,
        hover_gas: float,
        *,
        compass: float = 0.0,
        velocity: Array | None = None,
        thrust: float = 0.0,
        nominal: Tuning = NOMINAL,
        robust: Tuning = ROBUST,
    ) -> None:
        """Begin with the first view of the target.

        Args:
            model: of the aircraft.
            view: first view of the target.
            hover_gas: first guess [count of 254].
            compass: yaw that the boards reported last [rad].
            velocity: against the target (3,) [m/s]; at rest if none is given.
            thrust: of the motors, less the weight [share of the weight].
            nominal: tuning at caution 0.
            robust: tuning at caution 1.

        Raises:
            ValueError: the view is unusable, see `fault_of`.
        """
        fault = fault_of(view, view.at)
        if fault is not None:
            msg = f"no estimate begins with this view: {fault.value}"
            raise ValueError(msg)
        self.first, self.model = view, model
        self.hover_gas = min(max(hover_gas, HOVER_LOWEST), HOVER_HIGHEST)
        self.innovation = 1.0
        self.caution = self._believed = 1.0
        self.refused: Counter[ViewFault] = Counter()
        self._nominal, self._tuning, self._robust = nominal, robust, robust
        self._cameras, self._heights = Cameras(robust.patience), Cameras(robust.patience)
        self._yaw_offset = view.heading - compass
        self._headings: deque[tuple[float, float]] = deque([(view.at, compass)])
        self._seen_at = view.at
        self._was_blind = False
        self._calibration = np.zeros(3)  # variances of what all images have in common, by axis [m2]
        self._commands = CommandHistory()
        self.line = model
        self._lag = 0.0
        self._response = StickResponse(model, view.at)
        self._has_other_filter = False
        self._sent_at = -math.inf
        self._is_held = False
        self._last_command: StickCommand | None = None
        self._level, self._vertical = self._filters(view, np.zeros(3) if velocity is None else velocity, thrust)
        self.target_seen(view, view.at)

    def _filters(self, view: TargetView, velocity: Array, thrust: float) -> tuple[RollbackFilter, RollbackFilter]:
        """Return the filters of both horizontal axes and of the vertical one, begun with the first view."""
        tuning = self._tuning
        level, upright = np.zeros((2, LEVEL_STATES)), np.zeros((1, 4))
        seen = view.point - self._turn_matrix(view.at) @ view.position_flu
        level[:, P] = (view.place if view.is_placed else seen)[:2]
        level[:, V] = velocity[:2]
        upright[0, [H, S, F]] = view.height, velocity[2], thrust
        spread = np.diag(tuning.first_upright_spread) ** 2
        f, g, counted = self.model.counted(STEP)
        return (
            RollbackFilter(f, g, tuning.level_noise(STEP), level, tuning.first_covariance, view.at, counted),
            RollbackFilter(*self.model.vertical(STEP), tuning.upright_noise(STEP), upright, spread, view.at),
        )

    @property
    def seen_at(self) -> float:
        """Capture time of the newest image that was used [s]."""
        return self._seen_at

    @property
    def motion_covariance(self) -> Array:
        """Of x, y, z (3, 3): variance of position [m2], covariance with velocity [m2/s], variance of that [m2/s2]."""
        level, upright = self._level.covariances, self._vertical.covariances[0]
        axes = [(axis.item(P, P), axis.item(P, V), axis.item(V, V)) for axis in level]
        found = np.array([*axes, (upright.item(H, H), upright.item(H, S), upright.item(S, S))])
        found[:, 0] += self._calibration
        return found

    @property
    def velocity_sd(self) -> float:
        """Standard deviation of the horizontal velocity, the larger of both axes [m/s]."""
        return math.sqrt(max(self._level.covariances[:, V, V].tolist()))

    @property
    def stick_gain(self) -> float:
        """Measured tilt for a stick count, over the model's."""
        return self._response.gain

    @property
    def rejected(self) -> int:
        """Measurements outside their gates, since the start."""
        return self._level.rejected + self._vertical.rejected

    @property
    def contradicting(self) -> tuple[str, ...]:
        """Cameras whose images contradict those of others and are not used."""
        return tuple(sorted({*self._cameras.contradicting, *self._heights.contradicting}))

    def stands_on(self, camera: str) -> bool:
        """Whether the images of this camera alone have made the estimate lately."""
        return self._cameras.is_alone(camera)

    def uses(self, camera: str) -> bool:
        """Whether images of this camera, among others, have made the estimate lately: they do not contradict it."""
        return self._cameras.uses(camera) and camera not in self.contradicting

    def sent(self, command: StickCommand) -> None:
        """Take note of a stick frame that was written."""
        self._sent_at, self._last_command, self._is_held = command.at, command, False
        self._response.sent(command.at + self.line.uplink, self._asked(command))
        self.under_way(command)

    def under_way(self, command: StickCommand) -> None:
        """Take note of a stick frame that acts if it arrives; the answer to it teaches nothing."""
        c, s = self._turn(command.at)
        pitch, roll = (float(tilt) for tilt in self._asked(command) * self._response.gain)
        self._commands.add(
            StickFrame(
                command.at + self.model.uplink,
                (pitch * c + roll * s, pitch * s - roll * c),
                (command.acting_gas / self.hover_gas) ** 2 * upright(self._level.states[:, T]) - 1.0,
            )
        )

    def _asked(self, command: StickCommand) -> Array:
        """Pitch and roll (2,) that a stick frame asks for [rad]."""
        return np.array([command.pitch, command.roll]) * self.model.rad_per_count

    @property
    def is_elsewhere(self) -> bool:
        """Whether the target was seen again after dead reckoning, and all images since then contradict the estimate."""
        return self._was_blind and self._cameras.are_refused

    def sticks_known(self, arrived: float, since: Iterable[StickCommand]) -> None:
        """Take that stick frames arrive again, and repeat the estimate that was made without them.

        Args:
            arrived: when the newest confirmed frame was written [s].
            since: that frame and later ones.
        """
        self._commands.forget_after(arrived + self.model.uplink)
        for command in since:
            self.sent(command)
        self._redrive(arrived)

    def sticks_lost(self, arrived: float, coming: Iterable[StickCommand]) -> None:
        """Take that stick frames were lost: what was estimated with them is estimated again.

        Args:
            arrived: when the newest one was written that the board confirmed [s]; it acts on.
            coming: later ones of which nothing is known: they are taken to act.
        """
        self._commands.forget_after(arrived + self.model.uplink)
        self._sent_at, self._is_held = arrived, True
        for command in coming:
            self.under_way(command)
        self._redrive(arrived)

    def _redrive(self, arrived: float) -> None:
        """Estimate again what follows a stick frame that was written at a moment [s]."""
        self._level.redrive(arrived + self.model.uplink, self._drive)
        self._vertical.redrive(arrived + self.model.uplink, lambda at: ((self._commands.at(at).thrust,), None))

    def attitude_received(self, at: float, pitch: float, roll: float, yaw: float) -> None:
        """Take the attitude that the boards report; an impossible one is counted and ignored.

        Args:
            at: when it was measured, by `line`: its `attitude_age` before it arrived [s; monotonic].
            pitch: nose down positive [rad].
            roll: right side down positive [rad].
            yaw: counter-clockwise, ENU or any other fixed zero [rad].
        """
        is_finite = all(math.isfinite(number) for number in (at, pitch, roll, yaw))
        if not is_finite or max(abs(pitch), abs(roll)) > math.pi:
            self.refused[ViewFault.NO_ROTATION if is_finite else ViewFault.NOT_FINITE] += 1
            return
        self._hear_response(at, np.array([pitch, roll]))
        at -= self.model.attitude_age - self.line.attitude_age
        self._headings.append((at, yaw))
        while self._headings[0][0] < at - COMPASS_MEMORY:
            self._headings.popleft()
        self.advance(at)
        c, s = self._turn(at)
        believed = np.array([pitch * c + roll * s, pitch * s - roll * c])
        if at - self._sent_at > (HELD if self._is_held else UNSENT):
            self._commands.insert(StickFrame(at, (float(believed[0]), float(believed[1])), 0.0))
        row = np.zeros(LEVEL_STATES)
        row[TH] = 1.0
        self._level.measure(Measurement(at, row, believed, self._tuning.attitude_sd**2))

    def target_seen(self, view: TargetView, now: float) -> None:
        """Take a view of the target, also a late one; an unusable view is counted and ignored.

        Args:
            view: what it showed.
            now: when it arrives [s; monotonic].
        """
        fault = fault_of(view, now)
        if fault is None and not self._level.remembers(view.at):
            fault = ViewFault.TOO_OLD
        if fault is not None:
            self.refused[fault] += 1
            return
        self._believe()
        self._was_blind |= view.at - self._seen_at > BLIND
        shared_by = self._cameras.seen(view.camera, view.at, is_placed=view.is_placed)
        self._heights.seen(view.camera, view.at, is_placed=view.is_placed)
        is_trusted = view.camera not in self.contradicting and not self._cameras.is_on_trial(view.camera)
        if is_trusted:
            self._align(view)
            self._seen_at = max(self._seen_at, min(view.at, now))
        turn = self._turn_matrix(view.at)
        if view.is_placed:
            seen, spread, common = -view.place, view.covariance[:3, :3], view.calibration_covariance
        else:
            seen, spread = turn @ view.position_flu, turn @ view.sight_covariance @ turn.T
            common = turn @ view.calibration_covariance @ turn.T
        if is_trusted:
            self._calibration = common.diagonal() / shared_by
        # What all images of one camera have in common is no noise, and where there is another, it has its own.
        spread, bias = spread - common, common.diagonal() * (0.0 if shared_by == 1 else 2.0)
        wrong = self._see_place(view, seen, spread, bias, is_trusted=is_trusted)
        if is_trusted:
            self._see_tilt(view, shared_by)
        wrong += self._see_height(view, seen, spread, bias, is_trusted=is_trusted)
        for camera in wrong:  # they were used until now, this view among them
            self._level.forget(camera)
            self._vertical.forget(camera)

    def _see_place(
        self, view: TargetView, seen: Array, spread: Array, bias: Array, *, is_trusted: bool
    ) -> tuple[str, ...]:
        """Take the horizontal place (3,) of the view's point, as if level [m], its covariance (3, 3), its bias' (3,).

        What was measured in the target frame depends on no tilt. Returns the cameras that it shows to be wrong.
        """
        tuning = self._tuning
        speed = max(map(abs, self._level.states[:, V].tolist()))
        timing = (speed * tuning.stamp_sd) ** 2
        row = np.zeros(LEVEL_STATES)
        row[P], row[T] = 1.0, 0.0 if view.is_placed else seen[2]
        variance = np.maximum(spread.diagonal()[:2], 0.0) + tuning.view_floor**2 + timing
        doubt = tuning.doubt if self._cameras.doubts(view.camera, view.at) else None
        gate = GATE if is_trusted or doubt is not None else 0.0  # a contradicting camera is compared, not used
        place = (0.0 if view.is_placed else _leant(self._level.states_at(view.at)[:, T], seen)) - seen[:2]
        place = place + view.point[:2]
        measurement = Measurement(view.at, row, place, variance, gate, bias[:2], view.camera)
        ratio = self._level.measure(measurement, doubt)
        if ratio is None:
            return ()
        is_refused = max(map(abs, ratio.tolist())) > GATE
        self._was_blind &= is_refused
        if is_trusted:
            self._judge(sum(each**2 for each in ratio.tolist()) / len(ratio))
        return self._cameras.judged(view.camera, is_refused=is_refused)

    def _see_tilt(self, view: TargetView, shared_by: int) -> None:
        """Take the tilt that an image shows, where it is upright and certain enough.

        The same attitude of the boards, and how the target lies, is in every camera's tilt: it counts once.
        """
        tuning, up = self._tuning, view.target_from_flu[:, 2]
        variance = float(view.covariance[3, 3] + view.covariance[4, 4]) / 2.0
        variance += tuning.tilt_floor**2
        if up[2] > UPRIGHT and variance < tuning.tilt_worst**2:
            row = np.zeros(LEVEL_STATES)
            row[T] = 1.0
            self._level.measure(Measurement(view.at, row, up[:2] / up[2], shared_by * variance, source=view.camera))

    def _see_height(
        self, view: TargetView, seen: Array, spread: Array, bias: Array, *, is_trusted: bool
    ) -> tuple[str, ...]:
        """Take the height: the place (3,) of the target, as if level [m], along the normal of the estimated tilt.

        Returns the cameras that it shows to be wrong.
        """
        tuning, tilt = self._tuning, np.zeros(2) if view.is_placed else self._level.states_at(view.at)[:, T]
        # Height over the target's plane: h = -n . r, with r the target from the aircraft and n the plane's normal, both
        # in axes turned level by heading alone. var(h) = n' S n + x^2 var(tilt x) + y^2 var(tilt y) + floor^2.
        normal = np.array([-tilt[0], -tilt[1], 1.0]) / math.sqrt(1.0 + float(tilt @ tilt))
        row = np.zeros(4)
        row[H] = 1.0
        # A wrong tilt turns the far target upright.
        leaning = 0.0 if view.is_placed else float(seen[:2] ** 2 @ self._level.covariances[:, T, T])
        variance = max(0.0, float(normal @ spread @ normal)) + tuning.height_floor**2 + leaning
        doubt = tuning.upright_doubt if self._heights.doubts(view.camera, view.at) else None
        gate = GATE if is_trusted or doubt is not None else 0.0
        measurement = Measurement(view.at, row, -normal @ seen[:, None], variance, gate, bias[2:], view.camera)
        ratio = self._vertical.measure(measurement, doubt)
        if ratio is None:
            return ()
        return self._heights.judged(view.camera, is_refused=max(map(abs, ratio.tolist())) > GATE)

    def advance(self, now: float) -> None:
        """Bring the estimate up to a moment [s; monotonic].

        After a silence longer than the filter's memory it coasts: the time before that memory is one step with unknown
        sticks, and the covariance grows accordingly.
        """
        forgotten = math.floor((now - self._level.time) / STEP) - REMEMBERED
        if forgotten > 0:
            self._level.coast(forgotten, UNKNOWN_TILT**2)
            self._vertical.coast(forgotten, UNKNOWN_THRUST**2)
            self.caution = 1.0
            self._believe()
        while self._level.time + STEP <= now:
            middle = self._level.time + STEP / 2.0
            self._level.advance(*self._drive(middle))
            self._vertical.advance((self._commands.at(middle).thrust,))

    def _drive(self, at: float) -> Drive:
        """The sticks that act at a time [s], and their variance."""
        acting, before = self._commands.at(at), self._commands.at(at - LOST_FOR)
        return acting.tilt, LOST * np.subtract(acting.tilt, before.tilt) ** 2

    def estimate(self, at: float) -> Estimate:
        """Return the estimate at a moment, which may lie ahead: the commands under way are known [s; monotonic]."""
        self.advance(at - MEMORY)
        known = self._level.time
        steps = max(0, round((at - known) / STEP))
        acting = [self._commands.at(known + (k + 0.5) * STEP) for k in range(steps)]
        variances = np.array([*self._level.covariances[:, P, P].tolist(), self._vertical.covariances.item(0, H, H)])
        return Estimate(
            at=at,
            yaw=self._heading_at(at),
            hover_gas=self.hover_gas,
            axes=self._level.ahead([command.tilt for command in acting]),
            vertical=self._vertical.ahead([(command.thrust,) for command in acting])[0],
            position_sd=np.sqrt(variances + self._calibration),
            age=at - self._seen_at,
        )

    @property
    def throttle_cap(self) -> float | None:
        """Limit of our throttle by the pilot's stick [count of 254]; None without a limit."""
        return None if self._last_command is None else self._last_command.use.cap

    def recentre_hover(self, rate: float, asked: float) -> None:
        """Move a share of the unexplained vertical acceleration into the hover throttle: the model is true there.

        Not while another throttle acts than was asked for: the pilot's, or that of a limit. What cannot act would be
        learnt without end.

        Args:
            rate: share a call.
            asked: throttle that was asked for last [count of 254].
        """
        command = self._last_command
        if command is None or not command.use.is_ours or abs(command.gas - asked) > ROUNDED:
            return
        excess = float(self._vertical.states[0, E])
        change = rate * min(max(-excess / GRAVITY, -0.2), 0.2)
        gas = min(max(self.hover_gas * (1.0 + change / 2.0), HOVER_LOWEST), HOVER_HIGHEST)
        change = 2.0 * (gas / self.hover_gas - 1.0)
        self.hover_gas = gas
        self._vertical.shift(E, np.array([change * GRAVITY]))

    def _turn(self, at: float) -> tuple[float, float]:
        """Cosine and sine of the heading at a moment."""
        yaw = self._heading_at(at)
        return math.cos(yaw), math.sin(yaw)

    def _turn_matrix(self, at: float) -> Array:
        """Body axes to those of the local frame at a moment, as if it were level (3, 3)."""
        c, s = self._turn(at)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def _heading_at(self, at: float) -> float:
        """Heading in the target frame [rad]: the compass turned by the slowly estimated offset between the two."""
        heading = next((value for time, value in reversed(self._headings) if time <= at), self._headings[0][1])
        return math.remainder(heading + self._yaw_offset, math.tau)

    def _align(self, view: TargetView) -> None:
        """Let the image correct the offset between compass and target."""
        error = math.remainder(view.heading - self._heading_at(view.at), math.tau)
        variance = float(view.covariance[5, 5]) + self._tuning.yaw_floor**2
        self._yaw_offset += error * min(1.0, self._tuning.yaw_gain * self._tuning.yaw_floor**2 / variance)

    def _hear_response(self, at: float, tilt: Array) -> None:
        """Compare pitch and roll (2,) with what was asked for, and go on with the filter and delays that this shows."""
        response = self._response
        response.attitude_received(at, tilt)
        if response.has_other_filter != self._has_other_filter:
            self._change_filter()
        if abs(response.lag - self._lag) > LEAST_LAG:
            self._lag = response.lag
            line = self.line.later(self._lag)
            self.model = replace(self.model, uplink=line.uplink, attitude_age=line.attitude_age)

    def _change_filter(self) -> None:
        """Go on with the stick filter that the aircraft has; the next image counts as after a refusal."""
        self._has_other_filter = self._response.has_other_filter
        self.model = self.model.with_other_filter()
        self._level.set_dynamics(*self.model.counted(STEP))
        self._cameras.expect_change()

    def _judge(self, size: float) -> None:
        """Let the squared innovation of an image, over what was expected, decide how much the model counts.

        An integral regulator of the noise: innovations that are as expected have a mean square of one (Bar-Shalom et
        al., "Estimation with Applications to Tracking and Navigation", 2001, chapter 5.4).
        """
        tuning = self._tuning
        size = min(size, tuning.innovation_cap)
        self.innovation += tuning.innovation_rate * (size - self.innovation)
        self.caution = min(max(self.caution + tuning.caution_rate * (size - 1.0), 0.0), 1.0)

    def _believe(self) -> None:
        """Continue with the tuning for the present caution.

        Called once for each image and before it: then the filter has nothing to repeat.
        """
        if self._believed == self.caution:
            return
        self._believed = self.caution
        self._tuning = self._nominal.towards(self._robust, self.caution)
        self._level.set_noise(self._tuning.level_noise(STEP))
        self._vertical.set_noise(self._tuning.upright_noise(STEP))
