"""The section [sim] of a configuration file: which boards, on what line, in what flight, seen by which camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import Field, field_validator, model_validator

from mkdaemon.config.base import Section
from mkdaemon.config.camera import CameraName
from mkdaemon.config.reader import load_section
from mkdaemon.config.root import DaemonSections


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

    rate_lag: float = Field(default=0.022, ge=0.01, le=0.2)
    """Lag of the closed pitch and roll rate loops [s]."""
    yaw_torque_lag: float = Field(default=0.06, ge=0.01, le=0.5)
    """Lag of the yaw torque behind the yaw rate loop [s]: with the loop's gains a step overshoots by 40 %."""
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


class WallConfig(Section):
    """An upright wall, seen by the camera from both sides, and solid: an aircraft whose rotors touch it falls."""

    start: tuple[float, float]
    """One end of its foot: east, north [m]."""
    end: tuple[float, float]
    """The other end [m]; seen from where `start` is on the left, it is on the right."""
    height: float = Field(default=2.5, gt=0.0, le=50.0)
    """Of its upper edge above its lower one [m]."""
    bottom: float = Field(default=0.0, ge=0.0, le=50.0)
    """Height of its lower edge above the ground [m]."""
    surface: Literal["grass", "asphalt", "tiles", "clutter"] = "tiles"
    """What it looks like, as the kinds of ground."""

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if not 0.1 <= math.dist(self.start, self.end) <= 100.0:
            raise ValueError(f"a wall from {self.start} to {self.end} is not between 0.1 and 100 m long")
        return self


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
    walls: tuple[WallConfig, ...] = Field(default=(), max_length=50)
    """Walls around the aircraft; tags on them are those of a target file."""
    origin_latitude_deg: float = Field(default=53.2301, ge=-85.0, le=85.0)
    """Latitude of the world's origin [deg]."""
    origin_longitude_deg: float = Field(default=7.4591, ge=-180.0, le=180.0)
    """Longitude of the world's origin [deg]."""
    origin_altitude: float = 10.0
    """Altitude of the world's origin above the ellipsoid [m]."""


class RadioKind(StrEnum):
    """What carries the bytes."""

    WIRED = "wired"
    XBEE = "xbee"


class ChannelConfig(Section):
    """One direction of the link."""

    kind: RadioKind = RadioKind.WIRED
    """A cable, or a pair of XBee modules in transparent mode."""
    baud: float = Field(default=57600.0, ge=1200.0)
    """Line rate on both ends [bit/s]; ten bits a byte."""
    latency_min: float = Field(default=0.013, ge=0.0)
    """XBee: shortest way of a packet through the air [s]."""
    latency_mean: float = Field(default=0.023, ge=0.0)
    """XBee: mean [s]; the standard deviation comes out at 9.4 ms with the defaults, 9 to 10 was measured."""
    latency_max: float = Field(default=0.062, ge=0.0)
    """XBee: the spikes [s]."""
    loss: float = Field(default=0.01, ge=0.0, le=0.5)
    """XBee: share of packets lost."""
    lost_alone: float = Field(default=0.25, ge=0.0, le=1.0)
    """XBee: share of the lost packets that are lost alone; the others are lost in bursts."""
    mean_burst: float = Field(default=4.0, ge=1.0)
    """XBee: packets lost in a burst, on average."""
    outages_per_minute: float = Field(default=0.0, ge=0.0)
    """Drop-outs of the whole direction, at random [1/min]."""
    outage_duration: float = Field(default=1.0, gt=0.0)
    """Length of a drop-out [s], on average."""
    usb_timer: float = Field(default=0.0, ge=0.0, le=0.255)
    """Latency timer of a USB serial adapter, towards the host only [s]: 0.016 as shipped, 0.001 at best, 0 without."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        span = self.latency_max - self.latency_min
        if not 0.0 < self.latency_mean - self.latency_min < 0.5 * span:
            raise ValueError(
                f"latency_mean {self.latency_mean} must lie between latency_min {self.latency_min} and half way to "
                f"latency_max {self.latency_max}"
            )
        return self


class RadioConfig(Section):
    """Both directions."""

    to_board: ChannelConfig = ChannelConfig()
    """Host to aircraft."""
    to_host: ChannelConfig = ChannelConfig(usb_timer=0.001)
    """Aircraft to host."""


KindName = Literal["ideal", "c270", "c920", "pi_v2", "pi_gs", "elp", "ov9281", "analog"]
"""What a simulated camera can be; the table is `mksim/scene/kinds.py`."""


class PlatformConfig(Section):
    """How the landing target moves."""

    kind: Literal["still", "straight", "circle", "ramp"] = "still"
    """Standing; at constant speed; in a circle; from rest up to its speed."""
    start_enu: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where it is at the start: east, north, up [m]."""
    heading_deg: float = 0.0
    """Direction of travel and of its x axis, counter-clockwise from east [deg]."""
    speed: float = Field(default=0.0, ge=0.0, le=20.0)
    """Speed on its way [m/s]."""
    radius: float = Field(default=2.0, gt=0.0)
    """Of the circle [m]."""
    acceleration: float = Field(default=0.2, gt=0.0)
    """Of the ramp [m/s2]."""
    delay: float = Field(default=0.0, ge=0.0)
    """It stands still at its start for this time [s]."""
    tilt_deg: float = Field(default=0.0, ge=0.0, le=20.0)
    """Slope of a standing target, down along its x axis [deg]; set `start_enu` so that its low edge is above
    the ground."""

    @model_validator(mode="after")
    def _tilted_at_rest(self) -> Self:
        if self.tilt_deg and self.kind != "still":
            raise ValueError(f"tilt_deg {self.tilt_deg:g} needs a target at rest, kind = still, not {self.kind}")
        return self


class LightConfig(Section):
    """Light and sensor; the faults `light_off` and `tag_covered` come on top."""

    exposure: float = Field(default=1.0, gt=0.0, le=50.0)
    """Brightness; 1 puts white paper at grey 200."""
    noise_sd: float = Field(default=1.5, ge=0.0, le=100.0)
    """Read noise [grey]."""
    vignetting: float = Field(default=0.15, ge=0.0, le=1.0)
    """Loss of light in the corners."""
    defocus_px: float = Field(default=0.0, ge=0.0, le=40.0)
    """Circle of confusion [px]."""
    gradient: float = Field(default=1.0, ge=1.0, le=100.0)
    """Brightest over darkest part of the image."""
    shadow_ratio: float = Field(default=1.0, ge=1.0, le=20.0)
    """Hard shadow across the target that drifts over it in a minute; 1 for none."""
    glare: float = Field(default=0.0, ge=0.0, le=1.0)
    """Radius of a highlight that wanders over the target, as a share of its largest tag; 0 for none."""
    leaves_height: float = Field(default=0.0, ge=0.0, le=50.0)
    """Height of a tree's leaves whose shadows sway over the target [m]; 0 for none."""
    vehicle_shadow: bool = False
    """The vehicle throws its shadow on the target: sun from 10 degrees beside the zenith."""
    gloss: float = Field(default=0.0, ge=0.0, le=1.0)
    """Roughness of a glossy print [rad]: 0.05 shows a small bright sun, 0.12 a wide pale one; 0 for matte."""
    curl: float = Field(default=0.0, ge=-0.1, le=0.1)
    """How far the middle of the print rises over its rims, as a share of its largest tag; 0 lies flat."""
    grass: int = Field(default=0, ge=0, le=1000)
    """Blades of grass over the rim of the target."""
    dirt: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of the light that marks on the lens scatter; 0 a clean lens."""
    visibility: float = Field(default=0.0, ge=0.0, le=10_000.0)
    """Distance over which fog leaves 2 % of a contrast [m]; 0 for clear air."""
    drops: int = Field(default=0, ge=0, le=1000)
    """Drops of rain on the lens."""
    propellers: bool = False
    """Two propellers reach into the upper corners of the image; a rolling shutter bends them."""
    flicker: float = Field(default=0.0, ge=0.0, le=10_000.0)
    """Rate at which lamps are dimmed to a fifth and back [Hz]; a rolling shutter makes bands of it; 0 for daylight."""
    jpeg_quality: int | None = Field(default=None, ge=1, le=100)
    """Images are compressed and decompressed at this quality; unset leaves them."""


class SceneConfig(Section):
    """A simulated camera: the source `zenoh:mk/<vehicle>/sim/camera/<name>` of a daemon."""

    enabled: bool = False
    """Whether images are rendered; one core carries 640x480 at 30 Hz."""
    name: CameraName = "down"
    """Last part of its key."""
    secret_file: Path | None = None
    """File with the secret that signs its images, as `secret_file` of the daemon's camera; unset signs none."""
    camera: Path | None = None
    """Camera file it renders with; unset is 640x480, 74 x 59 deg, looking down."""
    targets: tuple[Path, ...] = ()
    """Target files; the first target moves with `platform`, others stand at the origin. Unset is the nested target."""
    platform: PlatformConfig = PlatformConfig()
    """How the target moves."""
    light: LightConfig = LightConfig()
    """Light and sensor."""
    kind: KindName = "ideal"
    """What the camera is beside its lens: shutter, noise, processing; automatic exposure unless `ideal` or `ov9281`."""
    ground: Literal["grass", "asphalt", "tiles", "clutter"] = "tiles"
    """What the ground looks like."""
    fps: float = Field(default=30.0, gt=0.0, le=240.0)
    """Images a second [Hz]."""
    exposure_ms: float = Field(default=6.0, ge=0.0, le=100.0)
    """Shutter time; motion during it blurs [ms]."""
    latency_ms: float = Field(default=60.0, ge=0.0, le=1000.0)
    """From the middle of the exposure to the host [ms]."""
    latency_jitter_ms: float = Field(default=5.0, ge=0.0, le=500.0)
    """Standard deviation of the latency [ms]."""
    stamp_error_ms: float = Field(default=0.0, ge=-1000.0, le=1000.0)
    """Error of the capture time in the header, late positive [ms]."""
    video: Path | None = None
    """Also write all images to this video, which must not be there yet."""
    v4l2_loop: Path | None = None
    """Also write all images to this v4l2loopback device, for other programs."""


class MocapConfig(Section):
    """A simulated motion capture system: the sender of a source of `[[positions]]`."""

    enabled: bool = False
    """Whether it reports the aircraft, 100 times a second."""
    name: CameraName = "mocap"
    """Name of the source."""
    secret_file: Path | None = None
    """File with the secret that signs its reports, as `secret_file` of the source; unset signs none."""


_LAST_PORT: Final = 65535


class PilotPlan(StrEnum):
    """What the simulated safety pilot does with the sticks.

    Attributes:
        does: the same in words, for `--help`.
    """

    does: str

    def __new__(cls, value: str, does: str) -> Self:
        """A member with its words."""
        member = str.__new__(cls, value)
        member._value_, member.does = value, does
        return member

    CIRCLE = "circle", "arms, takes off and flies a slow circle by hand until the battery is low"
    HOVER = "hover", "arms, takes off and hovers by hand"
    SUPERVISE = "supervise", "hovers by hand, hands over (`mkctl stick`, `goto`, `land`) and takes back"
    START = "start", "starts the motors for a take-off (`mkctl take-off`), takes back, stops them after the landing"
    WAIT = "wait", "leaves the motors and the take-off to the client, takes back in the air"
    NOTHING = "nothing", "leaves the sticks alone, throttle down, the others centred"


class GasLaw(StrEnum):
    """How the throttle of external control meets the pilot's."""

    STOCK = "stock"
    """The smaller of the two; with THROTTLE_ADD their sum."""
    FORK = "fork"
    """The value as it is, as one public fork has it; that fork also adds the commands x e r o."""


class SimConfig(Section):
    """The simulated aircraft; only `mkdaemon sim` reads this section and names a mistake in it."""

    seed: int = Field(default=1, ge=0)
    """Of every random stream: the same seed and the same input give the same bytes."""
    board: Literal["nc", "fc"] = "nc"
    """Whose serial port is offered: the NaviCtrl's, with the FlightCtrl behind it, or the FlightCtrl's alone."""
    fc: Literal["early", "2.08", "2.12a", "2.14"] = "2.12a"
    """FlightCtrl release: three generations of external control and dead-man."""
    nc: Literal["0.24", "2.14"] = "0.24"
    """NaviCtrl release."""
    gas_law: GasLaw = GasLaw.STOCK
    """Stock firmware, or the fork."""
    gate_parameter: int = Field(default=255, ge=0, le=255)
    """ExternalControl in the sets of a new EEPROM: 255 is poti 1, the pilot's switch; 0 as from the factory."""
    calibrated: bool = False
    """The sensors were calibrated before the simulation begins; otherwise the gesture is needed first."""
    eeprom: Path | None = None
    """File that keeps parameter sets, mixer and motor controller settings; none forgets them at the end."""
    pilot_plan: PilotPlan = PilotPlan.CIRCLE
    """What the pilot does."""
    pilot_wait: float = Field(default=20.0, ge=0.0, le=600.0)
    """Before he touches the sticks, unless `mkctl sim start` asks him earlier [s]: a daemon looks behind a NaviCtrl for
    the FlightCtrl only with motors off."""
    nc_loop: float = Field(default=0.1e-3, ge=0.05e-3, le=5e-3)
    """Period of the NaviCtrl's main loop [s]; 1 ms loses half of the control frames at 50 Hz."""
    flight: FlightConfig = FlightConfig()
    """Airframe, air, battery, sensors, pilot."""
    radio: RadioConfig = RadioConfig()
    """The way between host and board."""
    scene: SceneConfig = SceneConfig()
    """The on-board camera and what it sees."""
    mocap: MocapConfig = MocapConfig()
    """A motion capture system around it."""
    listen: str | None = Field(default=None, pattern=r"^[^:]+:\d{1,5}$")
    """Also offer the port over TCP, `host:port`; it carries one client at a time."""
    connect: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    """Zenoh endpoints for truth and faults; if none answers, the simulator runs without them."""
    truth_rate_hz: float = Field(default=50.0, ge=0.0, le=488.0)
    """How often the true state is published [1/s]; 0 never."""

    @field_validator("listen")
    @classmethod
    def _is_a_port(cls, text: str | None) -> str | None:
        if text is not None and int(text.rpartition(":")[2]) > _LAST_PORT:
            raise ValueError(f"'{text}': a TCP port is 0 to {_LAST_PORT}")
        return text


class SimulatorFile(DaemonSections):
    """A whole configuration file as the simulator's programs read it: the daemon's sections, and its own."""

    sim: SimConfig = SimConfig()
    """The simulated aircraft of `mkdaemon sim` and `mkdaemon demo`."""


def load_simulator(path: Path | None, overrides: Mapping[str, Any] | None = None) -> SimulatorFile:
    """Read a configuration file, the section [sim] with it, and lay overrides over it.

    Args:
        path: the TOML file; None for defaults only.
        overrides: values by dotted key; see `mkdaemon.config.reader.load`.

    Raises:
        ConfigError: see `mkdaemon.config.reader.load`.
    """
    return load_section(SimulatorFile, path, overrides)
