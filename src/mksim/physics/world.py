"""The world the simulated boards fly in: one fixed step is one loop of the FlightCtrl.

`World` owns no clock: every call of `step` advances simulated time by `DT`. The same seed and the same stick inputs
give the same flight, bit for bit. `HeightControl` is the FlightCtrl's: while it is on, gas is a climb-rate stick.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Final

from mksim.config import FlightConfig, WindClass
from mksim.faults import ActiveFault, RunningFaults
from mksim.physics.airframe import GRAVITY, Airframe, FlatGround, GroundContact
from mksim.physics.attitude_loop import LOOP_PERIOD, AttitudeGains, AxisLoop, YawLoop
from mksim.physics.battery import SimulatedBattery
from mksim.physics.hand_flight import HandFlight, lean
from mksim.physics.motors import FACTORY_CHAIN, GasChain, Motors
from mksim.physics.pilot import RC_PERIOD, FlightView, SimulatedPilot
from mksim.physics.sensors import Sensors
from mksim.physics.solidwall import SolidWall
from mksim.physics.truth import Truth
from mksim.physics.wind import Wind

DEAD_BAND: Final = 12.0
"""Gas counts around the hover stick that hold the height [count]."""
CLIMB_PER_COUNT: Final = 0.03
"""Climb rate per count beyond the dead band [m/s]."""
MAX_CLIMB: Final = 2.0
"""Fastest climb or descent [m/s]."""
_HEIGHT_GAIN: Final = 0.8
_SPEED_GAIN: Final = 22.0
_SPEED_INTEGRAL: Final = 8.0
_LEAST_SHARE: Final = 0.6
"""Never below this share of hover gas: attitude authority goes with gas."""
_MOST_SHARE: Final = 1.5


class HeightControl:
    """Barometer and variometer to collective count."""

    __slots__ = ("_height", "_hover", "_trim", "is_on")

    def __init__(self, hover_count: float) -> None:
        self._hover = hover_count
        self._trim = 0.0
        self._height = 0.0
        self.is_on = False

    def switch_off(self) -> None:
        """Hand the gas back to the stick."""
        self.is_on = False

    def update(self, gas: float, height: float, climb: float, dt: float) -> float:
        """Return the collective [count].

        Args:
            gas: stick [count].
            height: barometric [m].
            climb: variometer [m/s].
            dt: [s].
        """
        if not self.is_on:
            self.is_on, self._height, self._trim = True, height, 0.0
        offset = gas - self._hover
        if abs(offset) > DEAD_BAND:
            beyond = offset - DEAD_BAND if offset > 0 else offset + DEAD_BAND
            wanted = max(-MAX_CLIMB, min(MAX_CLIMB, beyond * CLIMB_PER_COUNT))
            self._height = height
        else:
            wanted = max(-MAX_CLIMB, min(MAX_CLIMB, _HEIGHT_GAIN * (self._height - height)))
        error = wanted - climb
        self._trim = max(-0.3 * self._hover, min(0.3 * self._hover, self._trim + _SPEED_INTEGRAL * error * dt))
        count = self._hover + self._trim + _SPEED_GAIN * error
        return max(_LEAST_SHARE * self._hover, min(_MOST_SHARE * self._hover, count))


DT: Final = LOOP_PERIOD
"""One step [s]."""
SLOW_STEPS: Final = 10
"""Steps between two updates of wind, battery and slow sensors (20.5 ms)."""
_SLOW: Final = SLOW_STEPS * DT
_RC_STEPS: Final = round(RC_PERIOD / DT)
_FLYING_GAS: Final = 40.0
"""Gas from which the FlightCtrl counts itself flying and lets its integral work [count]."""


@dataclass(frozen=True, slots=True)
class StickInput:
    """What the FlightCtrl's control law consumes: sticks after mixing, in counts and FIRMWARE signs.

    Attributes:
        pitch: nose down positive [count].
        roll: LEFT side down positive [count].
        yaw: nose left positive [count].
        gas: collective before voltage compensation, 0..254; hover about 125 [count].
        motors_running: armed.
        height_control: gas is a climb-rate stick.
        chain: how gas becomes a motor set point.
        frame: counts the receiver frames with which they were sampled; None samples with the world's own.
    """

    pitch: float
    roll: float
    yaw: float
    gas: float
    motors_running: bool
    height_control: bool = False
    chain: GasChain = FACTORY_CHAIN
    frame: int | None = None


MOTORS_OFF: Final = StickInput(0.0, 0.0, 0.0, 0.0, motors_running=False)
"""An aircraft that stands there."""


@dataclass(frozen=True, slots=True)
class StartState:
    """Where a flight begins.

    Attributes:
        east: [m].
        north: [m].
        height: of the feet above the ground [m]; above zero the rotors already turn at hover.
        yaw: ENU, zero towards east [rad].
    """

    east: float = 0.0
    north: float = 0.0
    height: float = 0.0
    yaw: float = math.pi / 2.0


class World:
    """Aircraft, air, sensors, pilot and faults.

    Attributes:
        now: simulated time [s].
        sensors: what the boards see.
        truth: what is.
        pilot: the person with the transmitter.
        faults: what is broken.
    """

    def __init__(
        self,
        cfg: FlightConfig,
        *,
        seed: int,
        start: StartState | None = None,
        ground: GroundContact | None = None,
        gains: AttitudeGains | None = None,
    ) -> None:
        """Set the aircraft up.

        Args:
            cfg: everything that can be chosen.
            seed: of every random stream.
            start: where; default standing at the origin, nose north.
            ground: what is below; default flat.
            gains: of the attitude loop; default the Easy set on a 2.12a.
        """
        begin = start or StartState()
        self._config = cfg
        self._step = 0
        self.now = 0.0
        self.faults = RunningFaults()
        self._faults_seen = 0
        self._gust_seen: ActiveFault | None = None
        self._airframe = Airframe(cfg.airframe, ground or FlatGround())
        self._airframe.place(begin.east, begin.north, begin.height, begin.yaw)
        self._walls = tuple(SolidWall(wall, cfg.airframe) for wall in cfg.walls)
        self._gains = gains or AttitudeGains.from_parameters()
        self._pitch = AxisLoop(self._gains, cfg.loop)
        self._roll = AxisLoop(self._gains, cfg.loop)
        self._motors = Motors(cfg.airframe, cfg.battery.cells)
        if begin.height > 0.0:
            self._motors.spin_up(cfg.airframe.hover_count)
        self._acc_scale = random.Random(f"{seed} accelerometer scale").uniform(
            cfg.sensors.acc_scale_min, cfg.sensors.acc_scale_max
        )
        self._height_control = HeightControl(cfg.airframe.hover_count)
        self._battery = SimulatedBattery(cfg.battery)
        # one stream each: switching one thing off leaves the noise of the others as it was
        self._wind = Wind(cfg.wind, rng=random.Random(f"{seed} wind"), period=_SLOW, from_deg=cfg.wind_from_deg)
        self.sensors = Sensors(cfg, rng=random.Random(f"{seed} sensors"), slow_period=_SLOW, airframe=self._airframe)
        self.truth = Truth(self._airframe, self._wind)
        self.pilot = SimulatedPilot(cfg.pilot, rescue=lambda: HandFlight(height=1.5, hold_time=3.0, flying=True))
        self._view = FlightView(self._airframe, self._pitch, self._roll, self._gains, self._battery)
        self._away: tuple[float, float] | None = None
        self._lean = (0.0, 0.0)
        self._frame: int | None = None
        self.sensors.update_slow(self._airframe, self._battery, 0.0)
        self.sensors.update_inertial(self._airframe)
        self._yaw = YawLoop(self._gains, cfg.loop, self.sensors.compass_yaw)
        self._report()

    @property
    def gains(self) -> AttitudeGains:
        """Constants the attitude loop flies with."""
        return self._gains

    def set_attitude_gains(self, gains: AttitudeGains) -> None:
        """Fly on with another parameter set."""
        self._gains = self._view.gains = gains
        for loop in (self._pitch, self._roll, self._yaw):
            loop.set_gains(gains)

    def steer(self, away: tuple[float, float] | None) -> None:
        """Let the NaviCtrl lean the aircraft towards a place, metres east and north of it; None without a command."""
        self._away = away

    def change_wind(self, wind: WindClass) -> None:
        """Let it blow with another strength from now on."""
        self._wind.change(wind)

    def calibrate(self) -> None:
        """Zero the FlightCtrl's angles, as its calibration gesture does."""
        self._pitch.believed = self._roll.believed = 0.0
        self._pitch.integral = self._roll.integral = 0.0

    def step(self, sticks: StickInput) -> None:
        """Advance one `DT` with these sticks."""
        self._tend(is_armed=sticks.motors_running)
        self._fly(sticks)
        for wall in self._walls:
            wall.stop(self._airframe)
        self._report()
        self._step += 1
        self.now = self._step * DT

    def _tend(self, *, is_armed: bool) -> None:
        """Everything that is not flying: faults, air, battery, slow sensors, pilot."""
        now, step = self.now, self._step
        self.faults.advance(now)
        if self.faults.generation != self._faults_seen:
            self._apply_faults()
        if step % SLOW_STEPS == 0:
            self._wind.update(now)
            self._battery.update(self._motors.load, _SLOW)
            self.sensors.update_slow(self._airframe, self._battery, now)
        if step % _RC_STEPS == 0:
            self._view.motors_running = is_armed
            self.pilot.update(self._view, now)
            self._lean = (0.0, 0.0) if self._away is None else lean(self._view, self._away)

    def _fly(self, sticks: StickInput) -> None:
        """Fly one step by the law of the simulated FlightCtrl, and measure."""
        self._control(sticks)
        motors, wind = self._motors, self._wind
        self._airframe.step(
            motors.thrust,
            (motors.torque_x, motors.torque_y, motors.torque_z),
            (wind.east, wind.north, wind.up),
            self.now,
            DT,
        )
        self.sensors.update_inertial(self._airframe)

    def _control(self, sticks: StickInput) -> None:
        """Run the FlightCtrl's law and the motors."""
        sensors = self.sensors
        running = sticks.motors_running and not self._airframe.crashed
        flying = running and sticks.gas > _FLYING_GAS
        pitch, roll, yaw, motors = self._pitch, self._roll, self._yaw, self._motors
        rate_z = sensors.gyro_z
        # small-angle tilt from the lateral accelerations, as the FlightCtrl takes it
        scale = self._acc_scale / GRAVITY
        leaned_pitch, leaned_roll = -sensors.acc_x * scale, sensors.acc_y * scale
        pitch_coupling, roll_coupling = -rate_z * roll.believed, rate_z * pitch.believed
        navi_pitch, navi_roll = self._lean
        is_new = self._step % _RC_STEPS == 0 if sticks.frame is None else sticks.frame != self._frame
        if is_new:
            self._frame = sticks.frame
            pitch.take_stick(sticks.pitch + navi_pitch)
            roll.take_stick(navi_roll - sticks.roll)
        pitch.update(sensors.gyro_y, leaned_pitch, pitch_coupling, flying=flying)
        roll.update(sensors.gyro_x, leaned_roll, roll_coupling, flying=flying)
        yaw.update(sticks.yaw, rate_z, sensors.compass_yaw, flying=flying)
        if not running:
            self._height_control.switch_off()
            motors.coast(DT)
            return
        gas = sticks.gas
        if sticks.height_control:
            gas = self._height_control.update(gas, sensors.baro_height, sensors.vertical_speed, DT)
        else:
            self._height_control.switch_off()
        motors.update(
            gas, roll.acceleration, pitch.acceleration, yaw.acceleration, self._battery.voltage, sticks.chain, DT
        )

    def _report(self) -> None:
        self.sensors.report(self._pitch.believed, self._roll.believed, self._yaw.heading, self._motors.setpoints)

    def _apply_faults(self) -> None:
        """Bring the world in line with the faults that run now."""
        faults, sensors = self.faults, self.sensors
        self._faults_seen = faults.generation
        health = [1.0, 1.0, 1.0, 1.0]
        if faults.is_active("motor_weak"):
            health[int(faults.number("motor_weak", "motor")) - 1] = faults.number("motor_weak", "share")
        self._motors.health = health
        self.pilot.rc_lost = faults.is_active("rc_lost")
        self.pilot.gate_fault = faults.is_active("gate_closed")
        self.pilot.turn_gps_switch(faults.word("gps_switch", "to") if faults.is_active("gps_switch") else None)
        self._battery.drop = faults.number("battery_drop", "volts") if faults.is_active("battery_drop") else 0.0
        sensors.gps_lost = faults.is_active("gps_lost")
        sensors.compass_fault_deg = faults.number("compass_bias", "deg") if faults.is_active("compass_bias") else 0.0
        biased = faults.is_active("imu_bias")
        sensors.gyro_fault = math.radians(faults.number("imu_bias", "rate_deg")) if biased else 0.0
        sensors.lean_fault = math.radians(faults.number("imu_bias", "lean_deg")) if biased else 0.0
        gust = faults.active.get("wind_gust")
        if gust is None:
            self._wind.stop_gust()
        elif gust is not self._gust_seen:
            self._wind.start_gust(
                gust.began,
                speed=faults.number("wind_gust", "speed"),
                from_deg=faults.number("wind_gust", "from_deg"),
                duration=gust.ends - gust.began,
            )
        self._gust_seen = gust
