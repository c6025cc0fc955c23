"""Configuration of the simulated flight: airframe, attitude loop, wind, battery, sensors, pilot."""

from __future__ import annotations

from enum import StrEnum

from pydantic import Field

from mkdaemon.config.base import Section


class WindClass(StrEnum):
    """Wind strengths a flight is judged in; the figures are in `mksim.physics.wind.WIND_FIGURES`."""

    NONE = "none"
    INDOOR = "indoor"
    LIGHT = "light"
    MODERATE = "moderate"


class AirframeConfig(Section):
    """Mass, geometry and aerodynamics of the aircraft."""

    mass: float = Field(default=1.25, gt=0.2, le=6.0)
    """Flying mass, payload included [kg]; 1.25 bare, 1.75 with payload."""
    inertia_roll: float = Field(default=0.011, gt=0.0)
    """Moment of inertia about body x [kg m2]."""
    inertia_pitch: float = Field(default=0.011, gt=0.0)
    """Moment of inertia about body y [kg m2]."""
    inertia_yaw: float = Field(default=0.019, gt=0.0)
    """Moment of inertia about body z [kg m2]."""
    arm: float = Field(default=0.155, gt=0.0)
    """Distance of a rotor from the centre of gravity [m]."""
    rotor_radius: float = Field(default=0.2, gt=0.0)
    """Rotor radius used by the ground effect [m]."""
    leg_height: float = Field(default=0.10, ge=0.0)
    """Height of the centre of gravity, and of the rotors, above the feet [m]."""
    foot_radius: float = Field(default=0.12, gt=0.0)
    """Distance of a foot from the centre line [m]: how well the legs hold the aircraft upright."""
    drag: float = Field(default=0.35, ge=0.0, le=2.0)
    """Linear drag over mass [1/s]: 0.35 with ducts; 0.18 reproduces the tilt run-away of an open airframe."""
    hover_count: float = Field(default=125.0, ge=80.0, le=180.0)
    """Set point that carries the flying mass out of ground effect with 3.2 V a cell [count]; the stick needs more."""
    motor_lag: float = Field(default=0.060, ge=0.005, le=0.2)
    """First-order lag of the collective thrust [s]; 0.030 to 0.090 seen."""
    torque_per_thrust: float = Field(default=0.016, gt=0.0)
    """Drag torque of a rotor over its thrust [m]: the yaw authority."""
    ground_effect_cap: float = Field(default=1.25, ge=1.0, le=1.6)
    """Largest thrust gain near the ground."""
    friction: float = Field(default=0.6, ge=0.0)
    """Coulomb friction of the feet."""
    crash_sink: float = Field(default=2.5, gt=0.0)
    """Touch-down sink rate that breaks the aircraft [m/s]."""
    crash_slide: float = Field(default=4.0, gt=0.0)
    """Horizontal touch-down speed that breaks the aircraft [m/s]."""
    crash_tilt_deg: float = Field(default=60.0, gt=10.0, lt=180.0)
    """Tilt at ground contact that puts the rotors into the ground [deg]."""


class LoopConfig(Section):
    """What the parameter set does not say about the attitude loop."""

    rate_lag: float = Field(default=0.040, ge=0.01, le=0.2)
    """Lag of the closed pitch and roll rate loops [s]."""
    yaw_torque_lag: float = Field(default=0.06, ge=0.01, le=0.5)
    """Lag of the yaw torque behind the yaw rate loop [s]: with the loop's gains a step overshoots by 40 %."""
    leak_dead_band_deg: float = Field(default=0.35, ge=0.0)
    """Difference between gyro angle and accelerometer angle that is not corrected [deg]."""
    leak_slew_deg: float = Field(default=12.8, gt=0.0)
    """Fastest correction towards the accelerometer [deg/s]."""
    truncate_sticks: bool = True
    """Integer arithmetic of the stick filter: a growing stick stalls up to 3/Stick_P counts short."""
    compass_lock: bool = True
    """The FlightCtrl holds its heading against the compass while the yaw stick rests."""
    compass_lock_gain: float = Field(default=0.8, ge=0.0, le=5.0)
    """Yaw rate per heading error of that lock [1/s]."""


class BatteryConfig(Section):
    """A lithium-polymer pack."""

    cells: int = Field(default=4, ge=2, le=8)
    """Cells in series."""
    capacity_mah: float = Field(default=3300.0, gt=100.0)
    """Full charge [mAh]."""
    charge: float = Field(default=1.0, gt=0.0, le=1.0)
    """State of charge at the start, 1 = full."""
    cell_resistance: float = Field(default=0.008, ge=0.0)
    """Internal resistance of a cell [ohm]."""
    hover_current: float = Field(default=12.0, gt=0.0)
    """Current at hover [A]."""
    avionics_current: float = Field(default=0.6, ge=0.0)
    """Current of everything but the motors [A]."""
    low_cell_v: float = Field(default=3.2, gt=2.5, lt=4.2)
    """Cell voltage at which the simulated pilot lands [V]; the boards' own level is in their parameter set."""


class SensorConfig(Section):
    """Noise and biases; ranges are drawn once per seed."""

    gyro_noise_deg: float = Field(default=0.3, ge=0.0)
    """White noise of a gyro at the loop rate [deg/s], one sigma."""
    gyro_bias_deg: float = Field(default=0.1, ge=0.0)
    """Rate bias left after calibration, drawn within +- this [deg/s]."""
    acc_noise: float = Field(default=0.15, ge=0.0)
    """White noise of the accelerometers at the loop rate [m/s2], one sigma."""
    acc_scale_min: float = Field(default=0.79, gt=0.5, le=1.0)
    """Smallest scale of the accelerometer tilt the FlightCtrl leaks towards; the scale is drawn once per seed."""
    acc_scale_max: float = Field(default=1.0, gt=0.5, le=1.5)
    """Largest scale of it: 0.79 to 1 are accelerometers of 216 to 170 counts a g."""
    acc_mount_deg: float = Field(default=1.5, ge=0.0, le=10.0)
    """Mount error of the accelerometer, drawn within 0 to this in a random direction [deg]."""
    fc_angle_scale: float = Field(default=1.0, ge=0.5, le=1.5)
    """What the boards report over what the FlightCtrl believes; 0.89 to 1.13 on real gyros."""
    baro_noise: float = Field(default=0.15, ge=0.0)
    """Slow wander of the barometer [m], one sigma, correlation 10 s."""
    baro_step: float = Field(default=0.05, ge=0.0)
    """Resolution of the barometric height [m]."""
    gps_wander: float = Field(default=1.5, ge=0.0)
    """Slow wander of the GPS position on each horizontal axis [m], one sigma, correlation 60 s."""
    gps_noise: float = Field(default=0.3, ge=0.0)
    """White noise of the GPS position on each axis [m], one sigma."""
    compass_noise_deg: float = Field(default=1.5, ge=0.0)
    """White noise of the compass [deg], one sigma."""
    compass_bias_deg: float = Field(default=5.0, ge=0.0, le=180.0)
    """Constant compass error, drawn within +- this [deg]."""
    voltage_noise: float = Field(default=0.03, ge=0.0)
    """Noise of the voltage reading [V], one sigma."""

    @classmethod
    def ideal(cls) -> SensorConfig:
        """Return sensors without noise, bias or steps: what an open-loop check wants."""
        return cls(acc_scale_min=1.0, acc_scale_max=1.0, **dict.fromkeys(_NOISES, 0.0))


_NOISES = tuple(
    name for name in SensorConfig.model_fields if name not in ("fc_angle_scale", "acc_scale_min", "acc_scale_max")
)


class PilotConfig(Section):
    """The simulated safety pilot."""

    reaction: float = Field(default=0.7, ge=0.0, le=5.0)
    """Time from seeing trouble to the hand on the sticks [s]."""
    watches: bool = False
    """The pilot takes over by himself when the aircraft leaves the limits below."""
    watch_tilt_deg: float = Field(default=40.0, gt=0.0)
    """Tilt that makes him act [deg]."""
    watch_distance: float = Field(default=15.0, gt=0.0)
    """Distance from the start that makes him act [m]."""
    watch_speed: float = Field(default=6.0, gt=0.0)
    """Speed that makes him act [m/s]."""
    gate: int = Field(default=255, ge=0, le=255)
    """Value of the external-control switch at the start; above 128 the gate is open."""


class FlightConfig(Section):
    """Everything the simulated flight depends on."""

    airframe: AirframeConfig = AirframeConfig()
    """The aircraft."""
    loop: LoopConfig = LoopConfig()
    """The attitude loop beyond its parameter set."""
    wind: WindClass = WindClass.INDOOR
    """Strength of the wind."""
    wind_from_deg: float | None = Field(default=None, ge=0.0, lt=360.0)
    """Direction the wind comes from, clockwise from north [deg]; unset draws one per seed."""
    battery: BatteryConfig = BatteryConfig()
    """The pack."""
    sensors: SensorConfig = SensorConfig()
    """The sensors."""
    pilot: PilotConfig = PilotConfig()
    """The safety pilot."""
    origin_latitude_deg: float = Field(default=53.2301, ge=-85.0, le=85.0)
    """Latitude of the world's origin [deg]."""
    origin_longitude_deg: float = Field(default=7.4591, ge=-180.0, le=180.0)
    """Longitude of the world's origin [deg]."""
    origin_altitude: float = 10.0
    """Altitude of the world's origin above the ellipsoid [m]."""
