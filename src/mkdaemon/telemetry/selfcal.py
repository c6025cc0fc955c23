"""Self-calibration: flights compared with a camera and a target file, part of `vision/<camera>/stats`. Changes nothing.

A difference is the truth minus the file. It counts once it is several of its standard deviations; before, it is what
was assumed.
"""

from typing import Final

from mkdaemon.telemetry.base import Telemetry

HEIGHTS_LIKELY: Final = 2.0
"""`height_odds` from which heights count as wrong; a false alarm in fewer than one flight in 100.

Of right files the odds pass K in at most one flight in K, however often one looks. Source: J. Ville, "Etude critique de
la notion de collectif" (1939)."""
HEIGHTS_SURE: Final = 4.0
"""From which nothing begins by them: less than one flight in 10,000."""


class TagSizeError(Telemetry):
    """Error of a tag's size in the target file, against the largest tag's."""

    tag_id: int
    """Of the tag."""
    size_percent: float
    """Of its size [%]."""
    size_sd_percent: float
    """[%]."""


class SelfCalibration(Telemetry):
    """Estimates from the images of one target, with standard deviations."""

    target: str
    """Name of the target they come from."""
    looks: int
    """Images used."""
    mounting_deg: tuple[float, float, float]
    """Turn of the camera from the mount believed, about body forward, left, up [deg]; a constant error of the
    vehicle's own attitude is in it. Only yaw motion of the vehicle tells it from a tilted target: until then the
    deviations are large."""
    mounting_sd_deg: tuple[float, float, float]
    """[deg]."""
    mount_believed_deg: tuple[float, float, float]
    """`mount.rpy_deg` in use [deg]."""
    mount_rpy_deg: tuple[float, float, float]
    """The same, corrected by the turns that are known to a degree [deg]."""
    focal_percent: float
    """Of the focal length [%]."""
    focal_sd_percent: float
    """[%]."""
    centre_px: tuple[float, float]
    """Of the principal point [px]."""
    centre_sd_px: tuple[float, float]
    """[px]."""
    k1: float
    """Of the radial distortion."""
    k1_sd: float
    """Deviation of `k1`."""
    sizes: tuple[TagSizeError, ...]
    """Of each tag but the largest."""
    height_percent: float
    """Error of height changes measured by vision, against the barometer [%]."""
    height_sd_percent: float
    """[%]; large in a single flight because of the barometer's drift."""
    height_covered: float
    """Between the lowest and the highest height that was compared [m]."""
    height_odds: float = 0.0
    """Decimal logarithm of how many times likelier the barometer's readings are by heights that are wrong by some share
    than by heights that are right."""
