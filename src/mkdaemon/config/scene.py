"""Configuration of the simulated camera and of what it sees."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from mkdaemon.config.base import Section
from mkdaemon.config.camera import CameraName

KindName = Literal["ideal", "c270", "c920", "pi_v2", "pi_gs", "elp", "ov9281"]
"""What a simulated camera can be; the table is `sim/scene/kinds.py`."""


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
    """It stands at its start for so long first [s]."""


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
    jpeg_quality: int | None = Field(default=None, ge=1, le=100)
    """Images are compressed and decompressed at this quality; unset leaves them."""


class SceneConfig(Section):
    """A simulated camera: the source `zenoh:mk/<vehicle>/sim/camera/<name>` of a daemon."""

    enabled: bool = False
    """Whether images are rendered; one core carries 640x480 at 30 Hz."""
    name: CameraName = "down"
    """Last part of its key."""
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
