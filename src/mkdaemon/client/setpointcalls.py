"""Every kind of setpoint as a method with its types.

Made by `python -m tools.docs` from telemetry/setpoint.py; do not edit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from mkdaemon.telemetry.setpoint import SetpointFrame


class SetpointCalls:
    """One setpoint of each kind: `lease.set.velocity(...)`."""

    def __init__(self, put: Callable[[str, Mapping[str, Any], float], None]) -> None:
        self._put = put

    def stick(self, *, pitch: float, roll: float, yaw: float, throttle: float, ttl: float = 0.3) -> None:
        """Stick offsets, FLU signs.

        Args:
            pitch: Nose down positive [stick].
            roll: Right side down positive [stick].
            yaw: Nose left positive [stick].
            throttle: More lift positive [stick from the centre]. Stock firmware takes the smaller of this and the
                pilot's.
            ttl: Age at which it no longer holds [s].

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            CommandRejectedError: `bad_field`: a number is out of range.
        """
        self._put("stick", {"pitch": pitch, "roll": roll, "yaw": yaw, "throttle": throttle}, ttl)

    def attitude(self, *, roll: float, pitch: float, yaw_rate: float, thrust: float, ttl: float = 0.3) -> None:
        """Attitude and thrust, FLU signs.

        Args:
            roll: Right side down positive [rad].
            pitch: Nose down positive [rad].
            yaw_rate: Nose left positive [rad/s].
            thrust: Thrust along the body's up axis, as a share of the weight: 1 carries the aircraft when level.
            ttl: Age at which it no longer holds [s].

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            CommandRejectedError: `bad_field`: a number is out of range.
        """
        self._put("attitude", {"roll": roll, "pitch": pitch, "yaw_rate": yaw_rate, "thrust": thrust}, ttl)

    def velocity(
        self,
        *,
        target: str = "",
        velocity: tuple[float, float, float],
        frame: SetpointFrame | Literal["home", "pad", "body"],
        yaw_rate: float = 0.0,
        ttl: float = 0.3,
    ) -> None:
        """Velocity.

        Args:
            target: Name of the target; empty for the one in sight, which is refused where there are two.
            velocity: In the axes of `frame` [m/s].
            frame: What the velocity is given in.
            yaw_rate: Nose left positive [rad/s].
            ttl: Age at which it no longer holds [s].

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            CommandRejectedError: `bad_field`: a number is out of range.
        """
        self._put("velocity", {"target": target, "velocity": velocity, "frame": frame, "yaw_rate": yaw_rate}, ttl)

    def position(
        self,
        *,
        target: str = "",
        position: tuple[float, float, float],
        frame: SetpointFrame | Literal["home", "pad", "body"],
        yaw: float | None = None,
        ttl: float = 0.3,
    ) -> None:
        """Position and heading.

        Args:
            target: Name of the target; empty for the one in sight, which is refused where there are two.
            position: In the axes of `frame`, from its origin [m].
            frame: What the position is given in.
            yaw: Heading about the up axis of `frame`, counter-clockwise from its first axis [rad]; None to keep the
                heading.
            ttl: Age at which it no longer holds [s].

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            CommandRejectedError: `bad_field`: a number is out of range.
        """
        self._put("position", {"target": target, "position": position, "frame": frame, "yaw": yaw}, ttl)

    def hold(self, *, target: str = "", ttl: float = 0.3) -> None:
        """Stay where the aircraft is when the first of them arrives.

        Args:
            target: Name of the target; empty for the one in sight, which is refused where there are two.
            ttl: Age at which it no longer holds [s].

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            CommandRejectedError: `bad_field`: a number is out of range.
        """
        self._put("hold", {"target": target}, ttl)

    def take_off(self, *, target: str = "", height: float, ttl: float = 0.3) -> None:
        """Take off and hold over the middle of the target.

        The pilot has started the motors.

        Args:
            target: Name of the target; empty for the one in sight, which is refused where there are two.
            height: Above the target [m]; never above the configured fence.
            ttl: Age at which it no longer holds [s].

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            CommandRejectedError: `bad_field`: a number is out of range.
        """
        self._put("takeoff", {"target": target, "height": height}, ttl)

    def land(self, *, target: str = "", yaw: float | None = None, ttl: float = 0.3) -> None:
        """Land on the target in sight.

        Streamed until touchdown; then the aircraft is released.

        Args:
            target: Name of the target; empty for the one in sight, which is refused where there are two.
            yaw: Heading about the up axis of the target, counter-clockwise from its first axis [rad]; None to keep it.
            ttl: Age at which it no longer holds [s].

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            CommandRejectedError: `bad_field`: a number is out of range.
        """
        self._put("land", {"target": target, "yaw": yaw}, ttl)

    def path(self, *, target: str = "", path: str, run: int = 0, paused: bool = False, ttl: float = 0.3) -> None:
        """Fly along a path that was uploaded, from its first point on.

        Args:
            target: Name of the target; empty for the one in sight, which is refused where there are two.
            path: Its id: the answer to `do/path_upload`.
            run: Number of this flight along it, chosen by the client: another one begins at the first point again.
            paused: Stop on the path, and hold there; false goes on.
            ttl: Age at which it no longer holds [s].

        Raises:
            LeaseLostError: the lease has ended; the text says why.
            CommandRejectedError: `bad_field`: a number is out of range.
        """
        self._put("path", {"target": target, "path": path, "run": run, "paused": paused}, ttl)
