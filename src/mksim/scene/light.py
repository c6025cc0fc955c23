"""Light, lens and sensor: everything between the reflectance of the scene and the grey value of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from mksim.scene.analogvideo import AnalogVideo, through_air
from mksim.scene.curl import Curl
from mksim.scene.gloss import Gloss
from mksim.scene.hindrances import Drops, Flicker, Fog, Propellers
from mksim.scene.lensfaults import Dirt
from mksim.scene.processing import NO_PROCESSING, Processing
from mksim.scene.shadows import LeafShadow, VehicleShadow
from mksim.scene.view import RayGrid

Image32 = npt.NDArray[np.float32]
Array = npt.NDArray[np.float64]

FULL_LIGHT = 235.0
"""Grey value of a perfect reflector at exposure 1."""
NOISE_POOL = 1 << 22


@dataclass(frozen=True, slots=True)
class Shadow:
    """A straight shadow edge on the plane of the target; the side to the left of its direction lies in shade.

    Attributes:
        ratio: brightness in the light over brightness in the shade, for example 4 for 4:1.
        point: a point of the edge [m; target x, y].
        direction: of the edge, counter-clockwise from target x [rad].
        softness: width of the penumbra [m]; 0 is a hard edge, still one pixel wide.
    """

    ratio: float
    point: tuple[float, float] = (0.0, 0.0)
    direction: float = 0.0
    softness: float = 0.0


@dataclass(frozen=True, slots=True)
class Glare:
    """A specular highlight on the print; it adds light that no longer depends on the ink.

    Attributes:
        point: middle [m; target x, y].
        radius: where the highlight has fallen to half its peak [m].
        strength: peak, in units of white paper in full light; from 1 on its middle is white.
    """

    point: tuple[float, float]
    radius: float
    strength: float = 2.0


@dataclass(frozen=True, slots=True)
class Cover:
    """Something flat lying on the target: an occluder.

    Attributes:
        polygon: corners `(n, 2)` [m; target x, y].
        reflectance: share of the light it sends back, evenly.
    """

    polygon: tuple[tuple[float, float], ...]
    reflectance: float = 0.3


@dataclass(frozen=True, slots=True)
class LightConditions:
    """What light, lens, sensor and coding do to one image. The default is a good camera on an overcast day.

    Attributes:
        exposure: brightness; 1 puts white paper at grey 200, 0.06 at 12, 1.3 and more saturates.
        psf_px: standard deviation of the lens's point spread [px].
        defocus_px: diameter of the circle of confusion [px].
        vignetting: loss of light in the corner of the image, 0 to 1.
        gradient: brightest over darkest part of the image, for example 32.
        gradient_angle: direction of increasing light in the image, clockwise from its x axis [rad].
        shadow: hard or soft shadow edge.
        leaves: shadow of a tree.
        vehicle: shadow of the vehicle.
        glare: specular highlights.
        gloss: a coat on the print.
        curl: how the print is bent.
        covers: occluders.
        dirt: on the lens.
        fog: between camera and scene.
        drops: of rain on the lens.
        propellers: that reach into the image.
        flicker: of the light.
        fringe_px: distance of red and blue in the corner of the image [px].
        noise_sd: read noise [grey].
        shot_gain: photon noise, variance per grey value [grey]; 0.0255 is a full well of 10,000 electrons.
        processing: what the camera's processor makes of the light.
        analog: the image comes over an analog link, as two fields; none is a digital camera.
        jpeg_quality: recompress at this quality, 1-100; none leaves the image as the sensor gave it.
        target_in_view: false takes every target away.
    """

    exposure: float = 1.0
    psf_px: float = 0.6
    defocus_px: float = 0.0
    vignetting: float = 0.15
    gradient: float = 1.0
    gradient_angle: float = 0.0
    shadow: Shadow | None = None
    leaves: LeafShadow | None = None
    vehicle: VehicleShadow | None = None
    glare: tuple[Glare, ...] = ()
    gloss: Gloss | None = None
    curl: Curl | None = None
    covers: tuple[Cover, ...] = ()
    dirt: Dirt | None = None
    fog: Fog | None = None
    drops: Drops | None = None
    propellers: Propellers | None = None
    flicker: Flicker | None = None
    fringe_px: float = 0.0
    noise_sd: float = 1.5
    shot_gain: float = 0.0255
    processing: Processing = NO_PROCESSING
    analog: AnalogVideo | None = None
    jpeg_quality: int | None = None
    target_in_view: bool = True


CLEAN = LightConditions(vignetting=0.0, noise_sd=0.0, shot_gain=0.0)
"""No noise and even light: what geometry tests use."""


def shade(image: Image32, shadow: Shadow, rays: RayGrid, plane_from_ray: Array) -> None:
    """Darken the shadowed side in place; `plane_from_ray` `(3, 3)` carries rays to homogeneous plane points."""
    c, s = np.cos(shadow.direction), np.sin(shadow.direction)
    left = np.array([-s, c, s * shadow.point[0] - c * shadow.point[1]])
    a, b, d = (left @ plane_from_ray).astype(np.float32)
    depth = plane_from_ray[2].astype(np.float32)
    x, y = rays.x, rays.y
    inverse_depth = depth[0] * x + depth[1] * y + depth[2]
    pixel = 1.0 / (rays.intrinsics.fx * max(float(inverse_depth[::16, ::16].mean()), 1e-4))
    width = np.float32(max(shadow.softness, pixel))
    sky = inverse_depth <= np.float32(1e-4)
    lit = a * x + b * y + d
    lit /= np.maximum(inverse_depth, np.float32(1e-4), out=inverse_depth)
    lit *= -1 / width
    lit += np.float32(0.5)
    np.clip(lit, 0.0, 1.0, out=lit)
    dark = np.float32(1.0 / shadow.ratio)
    lit *= 1 - dark
    lit += dark
    lit[sky] = 1.0
    image *= lit


def add_glare(image: Image32, glare: Glare, centre_px: Array, radius_px: float) -> None:
    """Add one highlight in place; its profile is a Gaussian, clipped by the sensor. None where it is not in front."""
    if not np.isfinite([*centre_px, radius_px]).all() or radius_px <= 0.0:
        return
    height, width = image.shape
    sigma = radius_px / np.sqrt(2 * np.log(2))
    x0, y0 = (int(np.clip(v - 4 * sigma, 0, n)) for v, n in zip(centre_px, (width, height), strict=True))
    x1, y1 = (int(np.clip(v + 4 * sigma + 1, 0, n)) for v, n in zip(centre_px, (width, height), strict=True))
    x = np.exp(-0.5 * ((np.arange(x0, x1) - centre_px[0]) / sigma) ** 2).astype(np.float32)
    y = np.exp(-0.5 * ((np.arange(y0, y1) - centre_px[1]) / sigma) ** 2).astype(np.float32)
    image[y0:y1, x0:x1] += np.float32(glare.strength) * y[:, None] * x[None, :]


def lens_blur(image: Image32, conditions: LightConditions) -> Image32:
    """Point spread of the lens, then the disc of defocus."""
    if conditions.psf_px > 0.0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), conditions.psf_px), dtype=np.float32)
    if conditions.defocus_px > 0.0:
        image = np.asarray(cv2.filter2D(image, -1, _disc(conditions.defocus_px / 2)), dtype=np.float32)
    return image


def _disc(radius: float) -> Image32:
    """A disc whose rim is integrated over 8 x 8 sub-pixels."""
    reach = int(np.ceil(radius + 0.5))
    fine = (np.arange((2 * reach + 1) * 8) + 0.5) / 8 - reach - 0.5
    inside = (fine[:, None] ** 2 + fine[None, :] ** 2 <= radius**2).astype(np.float32)
    kernel = inside.reshape(2 * reach + 1, 8, 2 * reach + 1, 8).mean(axis=(1, 3))
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


def streak(displacement_px: Array) -> Image32:
    """Kernel of an even, centred motion by `displacement_px` `(2,)`."""
    reach = int(np.ceil(np.abs(displacement_px).max() / 2)) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), dtype=np.float64)
    count = 4 * max(int(np.ceil(np.linalg.norm(displacement_px))), 1) + 1
    for along in (np.arange(count) + 0.5) / count - 0.5:
        x, y = along * displacement_px + reach
        column, row = int(np.floor(x)), int(np.floor(y))
        fx, fy = x - column, y - row
        kernel[row : row + 2, column : column + 2] += np.outer((1 - fy, fy), (1 - fx, fx))
    kernel /= kernel.sum()
    return kernel.astype(np.float32)


class Sensor:
    """Exposure, vignetting, noise and quantisation; the noise is a seeded pool, read at a seeded place each image."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 0x5E50])
        self._pool = _pool(seed)
        self._fields: dict[tuple[float, ...], Image32] = {}

    def expose(self, light: Image32, conditions: LightConditions) -> npt.NDArray[np.uint8]:
        """Turn light `(h, w)`, 1 is a perfect reflector in full light, into an image `(h, w)` uint8."""
        grey = light * self._field(light.shape, conditions)
        if conditions.noise_sd > 0.0 or conditions.shot_gain > 0.0:
            spread = cv2.sqrt(
                np.maximum(grey, 0.0) * np.float32(conditions.shot_gain) + np.float32(conditions.noise_sd**2)
            )
            start = int(self._rng.integers(0, NOISE_POOL - grey.size))
            grey += self._pool[start : start + grey.size].reshape(grey.shape) * spread
        grey = conditions.processing.apply(grey)
        if conditions.analog is not None:
            grey = through_air(grey, conditions.analog, self._rng)
        pixels = np.clip(np.rint(grey, out=grey), 0.0, 255.0, out=grey).astype(np.uint8)
        return pixels if conditions.jpeg_quality is None else through_jpeg(pixels, conditions.jpeg_quality)

    def _field(self, shape: tuple[int, ...], conditions: LightConditions) -> Image32:
        """Grey value of a perfect reflector in each pixel; kept, it changes rarely."""
        key = (*shape, conditions.exposure, conditions.vignetting, conditions.gradient, conditions.gradient_angle)
        found = self._fields.get(key)
        if found is None:
            if len(self._fields) > 16:
                self._fields.clear()
            found = self._fields[key] = _brightness(shape, conditions)
        return found


@lru_cache(maxsize=2)
def _pool(seed: int) -> Image32:
    """The noise that a sensor draws from; kept, scenes share their seed."""
    pool: Image32 = np.random.default_rng([seed, 0xF001]).standard_normal(NOISE_POOL, dtype=np.float32)
    pool.setflags(write=False)
    return pool


def _brightness(shape: tuple[int, ...], conditions: LightConditions) -> Image32:
    """Exposure times vignetting times an exponential gradient around its geometric mean."""
    height, width = shape
    x = (np.arange(width) - (width - 1) / 2)[None, :]
    y = (np.arange(height) - (height - 1) / 2)[:, None]
    corner2 = (width / 2) ** 2 + (height / 2) ** 2
    fall = 1.0 - conditions.vignetting * ((x * x + y * y) / corner2)
    c, s = np.cos(conditions.gradient_angle), np.sin(conditions.gradient_angle)
    span = abs(c) * width + abs(s) * height
    along, across = conditions.gradient ** (x * c / span), conditions.gradient ** (y * s / span)
    return np.asarray(FULL_LIGHT * conditions.exposure * fall * along * across, dtype=np.float32)


def through_jpeg(pixels: npt.NDArray[np.uint8], quality: int) -> npt.NDArray[np.uint8]:
    """What is left of an image after JPEG at `quality`."""
    _, coded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
