"""Rigid-body motion of the aircraft: thrust, drag, ground effect, ground contact, crash.

Plain floats instead of arrays: one step is a few hundred multiplications, and an array operation costs more than all
of them together.
"""

from __future__ import annotations

import math
from typing import Final, Protocol

from mksim.config import AirframeConfig

GRAVITY: Final = 9.81
"""Gravity [m/s2]."""
_CONTACT_STIFFNESS: Final = 900.0
"""Righting acceleration of the legs per radian [1/s2]; settles a leaning aircraft in 0.1 s."""
_CONTACT_DAMPING: Final = 60.0
"""Damping of that motion [1/s]."""
_ROUNDING: Final = 1e-9
"""What rounding makes of a contact [m; m/s]: feet on a surface at any height stay on it."""
_SLOPE_REACH: Final = 1e-3
"""The slope of the ground is taken over twice this [m]."""
_MAX_RATE: Final = 35.0
"""Bound on body rates [rad/s] (2000 deg/s, where any gyro of the time is long saturated)."""


class GroundContact(Protocol):
    """What is under the aircraft: flat earth or a moving platform."""

    def at(self, east: float, north: float, now: float) -> tuple[float, float, float, float]:
        """Return height [m] and velocity east, north, up [m/s] of the surface below a point."""


class FlatGround:
    """Ground at height zero, at rest."""

    def at(self, east: float, north: float, now: float) -> tuple[float, float, float, float]:
        """Return zeros."""
        return 0.0, 0.0, 0.0, 0.0


class Airframe:
    """Position, velocity, attitude and body rates, stepped with a fixed period.

    The reference point is the centre of gravity, `leg_height` above the ground when the aircraft stands.

    Attributes:
        east: position [m].
        north: position [m].
        up: position [m].
        v_east: velocity [m/s].
        v_north: velocity [m/s].
        v_up: velocity [m/s].
        rate_x: body rate about forward [rad/s].
        rate_y: about left [rad/s].
        rate_z: about up [rad/s].
        enu_from_flu: the nine elements of the rotation, row by row.
        force_x: specific force an accelerometer at the centre of gravity feels, forward [m/s2].
        force_y: left [m/s2].
        force_z: up [m/s2].
        on_ground: the legs touch.
        crashed: latched; see `crash_reason`.
    """

    __slots__ = (
        "_config",
        "_leg",
        "_qw",
        "_qx",
        "_qy",
        "_qz",
        "crash_reason",
        "crashed",
        "east",
        "enu_from_flu",
        "force_x",
        "force_y",
        "force_z",
        "ground",
        "north",
        "on_ground",
        "rate_x",
        "rate_y",
        "rate_z",
        "up",
        "v_east",
        "v_north",
        "v_up",
    )

    def __init__(self, config: AirframeConfig, ground: GroundContact) -> None:
        self._config = config
        self._leg = config.leg_height
        self.ground = ground
        self.east = self.north = 0.0
        self.up = config.leg_height
        self.v_east = self.v_north = self.v_up = 0.0
        self._qw, self._qx, self._qy, self._qz = 1.0, 0.0, 0.0, 0.0
        self.rate_x = self.rate_y = self.rate_z = 0.0
        self.force_x, self.force_y, self.force_z = 0.0, 0.0, GRAVITY
        self.on_ground = True
        self.crashed = False
        self.crash_reason = ""
        self.enu_from_flu = self._rotation()

    def place(self, east: float, north: float, height: float, yaw: float) -> None:
        """Set the aircraft down, level and at rest.

        Args:
            east: [m].
            north: [m].
            height: of the feet above the ground [m].
            yaw: ENU [rad].
        """
        surface = self.ground.at(east, north, 0.0)[0]
        self.east, self.north, self.up = east, north, surface + height + self._leg
        self._qw, self._qx, self._qy, self._qz = math.cos(yaw / 2.0), 0.0, 0.0, math.sin(yaw / 2.0)
        self.on_ground = height <= 0.0
        self.enu_from_flu = self._rotation()

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """ENU from FLU as (w, x, y, z)."""
        return self._qw, self._qx, self._qy, self._qz

    @property
    def tilt(self) -> float:
        """Angle between body up and up [rad]."""
        return math.acos(max(-1.0, min(1.0, self.enu_from_flu[8])))

    @property
    def pitch(self) -> float:
        """True pitch, nose down positive [rad]."""
        return math.asin(max(-1.0, min(1.0, -self.enu_from_flu[6])))

    @property
    def roll(self) -> float:
        """True roll, right side down positive [rad]."""
        return math.atan2(self.enu_from_flu[7], self.enu_from_flu[8])

    @property
    def yaw(self) -> float:
        """True yaw, nose left positive, zero towards east [rad]."""
        return math.atan2(self.enu_from_flu[3], self.enu_from_flu[0])

    def step(
        self,
        thrust: float,
        torque: tuple[float, float, float],
        wind: tuple[float, float, float],
        now: float,
        dt: float,
    ) -> None:
        """Advance by `dt`.

        Args:
            thrust: along body up, out of ground effect [N].
            torque: about the body axes [N m; FLU].
            wind: air velocity [m/s; ENU].
            now: time at the start of the step [s]; moves the ground.
            dt: [s].
        """
        config = self._config
        r = self.enu_from_flu
        surface, ground_east, ground_north, ground_up = self.ground.at(self.east, self.north, now)
        height = self.up - surface
        # m a = T z_body - m D (v - wind) - m g z, with linear drag D [1/s]; z_body is the third column of r.
        push = thrust / config.mass * self._ground_effect(height)
        drag = config.drag
        a_east = r[2] * push - drag * (self.v_east - wind[0])
        a_north = r[5] * push - drag * (self.v_north - wind[1])
        a_up = r[8] * push - drag * (self.v_up - wind[2]) - GRAVITY
        # Semi-implicit Euler: the new velocity moves the position, so that the contact does not gain energy.
        v_east, v_north, v_up = self.v_east + a_east * dt, self.v_north + a_north * dt, self.v_up + a_up * dt
        clearance = height - self._leg
        self.on_ground = clearance <= _ROUNDING and v_up <= ground_up + _ROUNDING
        load = 0.0
        if self.on_ground:
            self._check_impact(self.v_up - ground_up, math.hypot(v_east - ground_east, v_north - ground_north))
            # The legs carry what accelerates the aircraft down; a hard touchdown counts as one weight.
            load = max(0.0, -a_up) if v_up - ground_up > -0.5 else GRAVITY
            v_up = ground_up
            v_east, v_north = self._apply_friction(v_east - ground_east, v_north - ground_north, load * dt)
            v_east, v_north = v_east + ground_east, v_north + ground_north
            self.up = surface + self._leg
        # Accelerometers measure dv/dt - gravity, with the contact forces of this step.
        self._set_specific_force(
            (v_east - self.v_east) / dt, (v_north - self.v_north) / dt, (v_up - self.v_up) / dt + GRAVITY
        )
        self.v_east, self.v_north, self.v_up = v_east, v_north, v_up
        self.east += v_east * dt
        self.north += v_north * dt
        self.up += v_up * dt
        self._rotate(torque, load, now, dt)

    def collide(self, reason: str) -> None:
        """Break the aircraft against something upright; from there it falls."""
        if not self.crashed:
            self.crashed, self.crash_reason = True, reason
        self.v_east = self.v_north = 0.0

    def _ground_effect(self, height: float) -> float:
        """Thrust gain near the ground (Cheeseman and Bennett, ARC R&M 3021, 1955)."""
        cap = self._config.ground_effect_cap
        ratio = self._config.rotor_radius / (4.0 * height) if height > 0.05 else 1.0
        if ratio < 0.04:
            return 1.0
        square = ratio * ratio
        return cap if square >= 1.0 - 1.0 / cap else 1.0 / (1.0 - square)

    def _check_impact(self, v_up: float, slide: float) -> None:
        """Decide whether this contact breaks the aircraft."""
        config = self._config
        if self.crashed:
            return
        if -v_up > config.crash_sink:
            self.crashed, self.crash_reason = True, f"hit the ground at {-v_up:.1f} m/s"
        elif slide > config.crash_slide:
            self.crashed, self.crash_reason = True, f"touched the ground sliding at {slide:.1f} m/s"
        elif self.tilt > math.radians(config.crash_tilt_deg):
            self.crashed, self.crash_reason = True, f"touched the ground tilted by {math.degrees(self.tilt):.0f} deg"

    def _apply_friction(self, v_east: float, v_north: float, load_dt: float) -> tuple[float, float]:
        """Coulomb friction over one step on a velocity relative to the ground."""
        speed = math.hypot(v_east, v_north)
        stop = (2.0 if self.crashed else self._config.friction) * load_dt
        if speed <= stop:
            return 0.0, 0.0
        keep = 1.0 - stop / speed
        return v_east * keep, v_north * keep

    def _set_specific_force(self, f_east: float, f_north: float, f_up: float) -> None:
        """Turn a specific force from ENU to body."""
        r = self.enu_from_flu
        self.force_x = r[0] * f_east + r[3] * f_north + r[6] * f_up
        self.force_y = r[1] * f_east + r[4] * f_north + r[7] * f_up
        self.force_z = r[2] * f_east + r[5] * f_north + r[8] * f_up

    def _rotate(self, torque: tuple[float, float, float], load: float, now: float, dt: float) -> None:
        """Advance attitude and rates; `load` is the legs' share of the weight [m/s2]."""
        config = self._config
        jx, jy, jz = config.inertia_roll, config.inertia_pitch, config.inertia_yaw
        p, q, s = self.rate_x, self.rate_y, self.rate_z
        # Euler's equations in the body axes: J dw/dt = torque - w x J w, J diagonal.
        alpha_x = (torque[0] - (jz - jy) * q * s) / jx
        alpha_y = (torque[1] - (jx - jz) * s * p) / jy
        alpha_z = (torque[2] - (jy - jx) * p * q) / jz
        if load > 0.0 and not self.crashed:
            alpha_x, alpha_y, alpha_z = self._add_leg_torque(alpha_x, alpha_y, alpha_z, load, now, dt)
        if self.crashed:
            p = q = s = alpha_x = alpha_y = alpha_z = 0.0
        p = max(-_MAX_RATE, min(_MAX_RATE, p + alpha_x * dt))
        q = max(-_MAX_RATE, min(_MAX_RATE, q + alpha_y * dt))
        s = max(-_MAX_RATE, min(_MAX_RATE, s + alpha_z * dt))
        self.rate_x, self.rate_y, self.rate_z = p, q, s
        # dq/dt = q * (0, w) / 2 with the body's rates w; normalised, because an Euler step lengthens q.
        # Source: J. Diebel, "Representing Attitude", Stanford 2006, section 6.
        half = 0.5 * dt
        w, x, y, z = self._qw, self._qx, self._qy, self._qz
        w, x, y, z = (
            w - half * (x * p + y * q + z * s),
            x + half * (w * p + y * s - z * q),
            y + half * (w * q + z * p - x * s),
            z + half * (w * s + x * q - y * p),
        )
        scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
        self._qw, self._qx, self._qy, self._qz = w * scale, x * scale, y * scale, z * scale
        self.enu_from_flu = self._rotation()

    def _add_leg_torque(
        self, alpha_x: float, alpha_y: float, alpha_z: float, load: float, now: float, dt: float
    ) -> tuple[float, float, float]:
        """Add what the legs do: turn the aircraft to the ground's slope as far as their load and radius allow."""
        config = self._config
        # A leg pushes and cannot pull: the largest righting moment is the load on one edge of the feet. Within it the
        # contact replaces the torque of the rotors by a damped spring towards the slope.
        moment = config.mass * load * config.foot_radius
        most_x, most_y = moment / config.inertia_roll, moment / config.inertia_pitch
        roll, pitch = self._slope(now)
        right_x = -_CONTACT_STIFFNESS * (self.roll - roll) - _CONTACT_DAMPING * self.rate_x
        right_y = -_CONTACT_STIFFNESS * (self.pitch - pitch) - _CONTACT_DAMPING * self.rate_y
        # About yaw, Coulomb friction stops the rotation within this step if it can.
        most_z = config.friction * moment / config.inertia_yaw
        stop_z = -alpha_z - self.rate_z / dt
        return (
            alpha_x + max(-most_x, min(most_x, right_x - alpha_x)),
            alpha_y + max(-most_y, min(most_y, right_y - alpha_y)),
            alpha_z + max(-most_z, min(most_z, stop_z)),
        )

    def _slope(self, now: float) -> tuple[float, float]:
        """Roll and pitch of an aircraft that stands flat on the ground below [rad]."""
        east, north, reach, at = self.east, self.north, _SLOPE_REACH, self.ground.at
        # Gradient of the surface by central differences; then its parts along the body's forward and left axes.
        # Roll is positive for a surface that rises to the left, pitch (nose down) for one that falls ahead.
        to_east = (at(east + reach, north, now)[0] - at(east - reach, north, now)[0]) / (2.0 * reach)
        to_north = (at(east, north + reach, now)[0] - at(east, north - reach, now)[0]) / (2.0 * reach)
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return math.atan(to_north * cos - to_east * sin), -math.atan(to_east * cos + to_north * sin)

    def _rotation(self) -> tuple[float, float, float, float, float, float, float, float, float]:
        """Rotation of the quaternion, row by row: R = (w^2 - v.v) I + 2 v v' + 2 w [v]x, for a unit quaternion."""
        w, x, y, z = self._qw, self._qx, self._qy, self._qz
        xx, yy, zz = x * x, y * y, z * z
        xy, xz, yz = x * y, x * z, y * z
        wx, wy, wz = w * x, w * y, w * z
        return (
            1.0 - 2.0 * (yy + zz),
            2.0 * (xy - wz),
            2.0 * (xz + wy),
            2.0 * (xy + wz),
            1.0 - 2.0 * (xx + zz),
            2.0 * (yz - wx),
            2.0 * (xz - wy),
            2.0 * (yz + wx),
            1.0 - 2.0 * (xx + yy),
        )
