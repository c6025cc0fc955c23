"""The true state of the simulated flight: for the renderer, the tests and `sim/truth`, never for flight code."""

from __future__ import annotations

import numpy as np

from mkdaemon.frames import Matrix, Vector
from mksim.physics.airframe import Airframe
from mksim.physics.wind import Wind


class Truth:
    """A view of the airframe and the air: each property is computed when it is read."""

    __slots__ = ("_airframe", "_wind")

    def __init__(self, airframe: Airframe, wind: Wind) -> None:
        self._airframe = airframe
        self._wind = wind

    @property
    def position_enu(self) -> Vector:
        """Centre of gravity `(3,)` [m]; `leg_height` above the ground when standing."""
        a = self._airframe
        return np.array([a.east, a.north, a.up])

    @property
    def velocity_enu(self) -> Vector:
        """`(3,)` [m/s]."""
        a = self._airframe
        return np.array([a.v_east, a.v_north, a.v_up])

    @property
    def enu_from_flu(self) -> Matrix:
        """Rotation `(3, 3)`."""
        return np.array(self._airframe.enu_from_flu).reshape(3, 3)

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """ENU from FLU, (w, x, y, z)."""
        return self._airframe.quaternion

    @property
    def rates(self) -> Vector:
        """Body rates `(3,)` about forward, left, up [rad/s; FLU]."""
        a = self._airframe
        return np.array([a.rate_x, a.rate_y, a.rate_z])

    @property
    def pitch(self) -> float:
        """Nose down positive [rad]."""
        return self._airframe.pitch

    @property
    def roll(self) -> float:
        """Right side down positive [rad]."""
        return self._airframe.roll

    @property
    def yaw(self) -> float:
        """ENU, nose left positive [rad]."""
        return self._airframe.yaw

    @property
    def tilt(self) -> float:
        """Angle between body up and up [rad]."""
        return self._airframe.tilt

    @property
    def wind_enu(self) -> Vector:
        """Air velocity `(3,)` [m/s]."""
        return np.array([self._wind.east, self._wind.north, self._wind.up])

    @property
    def on_ground(self) -> bool:
        """The legs carry weight."""
        return self._airframe.on_ground

    @property
    def airborne(self) -> bool:
        """The legs do not touch."""
        return not self._airframe.on_ground

    @property
    def crashed(self) -> bool:
        """Broken; stays so."""
        return self._airframe.crashed

    @property
    def crash_reason(self) -> str:
        """Why, in words; empty while whole."""
        return self._airframe.crash_reason
