"""The on-board camera of the simulated aircraft: true state at mid exposure in, stamped and delayed frames out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from mkdaemon.vision.camera.calibration_file import Camera, Intrinsics, load_camera, mount_rotation
from mkdaemon.vision.tags.tagmap import TagMap
from mkdaemon.vision.tags.targetfile import load
from mksim.config import PlatformConfig, SceneConfig, SimConfig, WallConfig
from mksim.physics.airframe import GroundContact
from mksim.physics.deck import MovingDeck, TiltedDeck
from mksim.physics.world import World
from mksim.scene.autoexposure import AutoExposure
from mksim.scene.hardships import LEAF_PERIOD, LEAF_SWAY_M, fair_conditions, shadow_of_vehicle
from mksim.scene.kinds import CAMERA_KINDS
from mksim.scene.light import Cover, Glare, LightConditions, Shadow
from mksim.scene.motion import Platform
from mksim.scene.nested import nested_map
from mksim.scene.scene import Scene, SceneTarget
from mksim.scene.view import CameraView
from mksim.scene.walls import wall_surfaces

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

BUILT_IN = Camera(
    name="simulated camera",
    intrinsics=Intrinsics(
        width=640, height=480, fx=425.0, fy=425.0, cx=319.5, cy=239.5, k1=-0.12, k2=0.02, line_time=0.0
    ),
)
"""74 x 59 deg with light barrel distortion; the same figures as configs/cameras/sim.toml."""
SHADOW_PERIOD = 60.0
DECK_RADIUS_M = 0.6
"""Room to stand around the middle of a moving target."""
GLARE_PERIODS = (11.0, 17.0)


@dataclass(frozen=True, slots=True)
class BodyState:
    """Where the aircraft truly is at one moment.

    Attributes:
        time: simulated time [s].
        position_enu: of the body's origin `(3,)` [m].
        velocity_enu: `(3,)` [m/s].
        enu_from_flu: `(3, 3)`.
        rates_flu: about body axes `(3,)` [rad/s].
    """

    time: float
    position_enu: Array
    velocity_enu: Array
    enu_from_flu: Array
    rates_flu: Array


def platform_of(cfg: PlatformConfig) -> Platform:
    """The configured motion of the target; a deck under it can follow `pose_at(t).position_enu`."""
    return Platform(
        cfg.kind,
        cfg.start_enu,
        math.radians(cfg.heading_deg),
        cfg.speed,
        cfg.radius,
        cfg.acceleration,
        pitch=math.radians(cfg.tilt_deg),
        delay=cfg.delay,
    )


def deck_of(cfg: PlatformConfig) -> GroundContact:
    """The configured target as something to stand on."""
    if cfg.tilt_deg:
        tilt, heading = math.radians(cfg.tilt_deg), math.radians(cfg.heading_deg)
        return TiltedDeck(cfg.start_enu, tilt=tilt, heading=heading, radius=DECK_RADIUS_M)
    motion = platform_of(cfg)
    return MovingDeck(lambda time: motion.pose_at(time).position_enu, radius=DECK_RADIUS_M)


def landing_world(config: SimConfig) -> World | None:
    """The world with the scene's platform as something to stand on; None where it lies still on the ground."""
    platform = config.scene.platform
    if platform.kind == "still" and platform.start_enu[2] == 0.0 and not platform.tilt_deg:
        return None
    return World(config.flight, seed=config.seed, ground=deck_of(platform))


class SceneCamera:
    """Renders what the camera of the aircraft sees.

    Args:
        cfg: camera, target and light.
        seed: of ground, noise and everything else.
        tagmap: the targets, in place of those that `cfg` names.
        walls: that stand around them.

    Attributes:
        arm_flu: the lens in the body frame `(3,)` [m].

    Raises:
        ConfigError: a camera or target file is wrong.
    """

    def __init__(
        self, cfg: SceneConfig, seed: int, tagmap: TagMap | None = None, *, walls: Sequence[WallConfig] = ()
    ) -> None:
        self.cfg = cfg
        self.camera = load_camera(cfg.camera) if cfg.camera is not None else BUILT_IN
        self.platform = platform_of(cfg.platform)
        self.targets = (tagmap or (load(cfg.targets) if cfg.targets else nested_map())).targets
        self._flu_from_cam = mount_rotation(self.camera.mount)
        self.arm_flu = np.array(self.camera.mount.position_flu)
        self._size = self.targets[0].tags[0].size
        placed = [SceneTarget.of(self.targets[0], self.platform)]
        placed += [SceneTarget.of(target, Platform()) for target in self.targets[1:]]
        faces = wall_surfaces(walls, seed)
        self._scene = Scene(placed, ground=cfg.ground, seed=seed, fine=False, live=True, walls=faces)
        self._kind = CAMERA_KINDS[cfg.kind]
        self._auto = AutoExposure(self._kind.auto) if self._kind.auto is not None else None
        self._fair = fair_conditions(cfg.light, self._kind.conditions, self._size, seed)

    def view(self, state: BodyState) -> CameraView:
        """The camera at the middle of its exposure: it rides on the body, so turning also moves it."""
        arm = state.enu_from_flu @ self.arm_flu
        spin_enu = state.enu_from_flu @ state.rates_flu
        return CameraView(
            self.camera.intrinsics,
            state.enu_from_flu @ self._flu_from_cam,
            state.position_enu + arm,
            velocity_enu=state.velocity_enu + np.cross(spin_enu, arm),
            rate_cam=self._flu_from_cam.T @ state.rates_flu,
            exposure_time=self.cfg.exposure_ms / 1000.0,
            time=state.time,
            line_time=self._kind.line_time,
        )

    def conditions(self, time: float, *, light: float = 1.0, covered: float = 0.0) -> LightConditions:
        """Light at a time.

        Args:
            time: simulated [s].
            light: share of the light that is left; below 1 while `light_off` runs.
            covered: share of the target that is hidden, while `tag_covered` runs.
        """
        cfg, size = self.cfg.light, self._size
        covers: tuple[Cover, ...] = ()
        if covered > 0.0:
            left, reach = -0.75 * size, 1.5 * size * min(covered, 1.0)
            covers = (Cover(((left, -size), (left + reach, -size), (left + reach, size), (left, size))),)
        shadow = None
        if cfg.shadow_ratio > 1.0:
            along = size * math.sin(2 * math.pi * time / SHADOW_PERIOD)
            shadow = Shadow(cfg.shadow_ratio, (along, 0.0), direction=1.0)
        glare: tuple[Glare, ...] = ()
        if cfg.glare > 0.0:
            x, y = (0.6 * size * math.sin(2 * math.pi * time / period) for period in GLARE_PERIODS)
            glare = (Glare((x, y), cfg.glare * size),)
        leaves = self._fair.leaves
        if leaves is not None:
            leaves = replace(leaves, shift=(LEAF_SWAY_M * math.sin(2 * math.pi * time / LEAF_PERIOD), 0.0))
        brightness = 1.0 if self._auto is None else self._auto.brightness
        return replace(
            self._fair,
            exposure=cfg.exposure * light * brightness,
            shadow=shadow,
            leaves=leaves,
            glare=glare,
            covers=(*self._fair.covers, *covers),
        )

    def expose(self, state: BodyState, *, light: float = 1.0, covered: float = 0.0) -> Grey:
        """One image `(h, w)` uint8 of the true state at mid exposure."""
        view, conditions = self.view(state), self.conditions(state.time, light=light, covered=covered)
        if self.cfg.light.vehicle_shadow:
            conditions = replace(conditions, vehicle=shadow_of_vehicle(view, self.platform.pose_at(state.time)))
        pixels = self._scene.render(view, conditions)
        if self._auto is not None:
            self._auto.image_seen(pixels, conditions.processing.gamma)
        return pixels
